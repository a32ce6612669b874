# SPDX-License-Identifier: Apache-2.0
"""The command `imu-bench`: one file per verb, each with `register(verbs)` and `run(arguments)`."""
