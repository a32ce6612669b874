# SPDX-License-Identifier: Apache-2.0
"""Sensors that a driver of the Linux kernel reads (Industrial I/O): sysfs and /dev/iio:deviceN."""

from imu_bench.bus.iio.sensor import IioSensor, SETTINGS
from imu_bench.bus.iio.tree import devices, IioDevice

__all__ = ['SETTINGS', 'IioDevice', 'IioSensor', 'devices']
