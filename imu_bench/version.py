# SPDX-License-Identifier: Apache-2.0
"""The version, for whoever writes it into a file; setup.py and package.xml say the same."""

__version__ = '0.1.0'
