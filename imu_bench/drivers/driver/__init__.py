# SPDX-License-Identifier: Apache-2.0
"""
What every sensor driver is made of.

A sensor file declares, in this order: document, identity, register map, fields, channels,
sequences, typical values, witnesses; then the little code that reads its stream.  Everything
else (parameters, their descriptors, YAML validation, the README row, the emulator, the
conformance test) comes from these declarations.
"""

from imu_bench.config.schema import Setting
from imu_bench.drivers.driver.base import choice, Driver
from imu_bench.drivers.driver.fifo import BurstDriver, FifoDriver, SlotDriver
from imu_bench.drivers.driver.polled import PolledDriver
from imu_bench.registers import Identity, Typical, Witness

__all__ = [
    'BurstDriver',
    'Driver',
    'FifoDriver',
    'Identity',
    'PolledDriver',
    'Setting',
    'SlotDriver',
    'Typical',
    'Witness',
    'choice',
]
