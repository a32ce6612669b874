# SPDX-License-Identifier: Apache-2.0
"""
A computer without Linux and without ROS 2: takes away what only they have.

`PYTHONPATH=test pytest -p elsewhere test/metrology test/offline` runs tests as on such a computer.
"""

import os
import sys

MODULES = (
    'fcntl', 'grp', 'pty', 'pwd', 'resource', 'termios', 'tty',
    'daqhats', 'periphery', 'serial', 'smbus2', 'spidev',
    'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'launch', 'rclpy', 'sensor_msgs',
    'std_msgs', 'std_srvs',
)  # fmt: skip

CALLS = (
    'copy_file_range', 'eventfd', 'memfd_create', 'posix_fadvise',
    'posix_fallocate', 'sched_getaffinity', 'sched_setscheduler', 'setpriority',
)  # fmt: skip


def take_away():
    """Let imports of `MODULES` fail, and have `os` without `CALLS`."""
    for name in MODULES:
        sys.modules[name] = None
    for name in CALLS:
        if hasattr(os, name):
            delattr(os, name)


if __name__ == 'elsewhere':  # asked for with -p, and not looked through for doctests
    take_away()
