# SPDX-License-Identifier: Apache-2.0
"""The first serialisation of rclpy imports a parser that uses a deprecated module."""

import warnings

with warnings.catch_warnings():
    warnings.simplefilter('ignore', DeprecationWarning)
    import rosidl_generator_py  # noqa: F401, imported for its warning
