# SPDX-License-Identifier: Apache-2.0
"""
The words that resets, starts and stops put on the wire, as other drivers write them.

Repositories, files and commits are those of test/oracles; the clock and the wait of the master of
an MPU-9250 are as PX4/DriverFramework writes them (drivers/mpu9250/MPU9250.cpp).
"""

from imu_bench.drivers import load
from imu_bench.registers import Write
from imu_bench.simulation.clock import SimulatedClock
import pytest


class Memory:
    """Registers that hold what is written, and what was written in order."""

    name = 'memory'

    def __init__(self, words=()):
        self.words, self.written = dict.fromkeys(range(128), 0) | dict(words), []

    def read(self, register, length):
        return bytes(self.words[register + k] for k in range(length))

    def write(self, register, data):
        for k, word in enumerate(data):
            self.words[register + k] = word
            self.written.append((register + k, word))


def written(name, sequence, before, part='', **settings):
    """Return what a sequence writes, but for the choice of a bank; a reset forgets its bit."""
    found = []
    for step in getattr(load(name), sequence):
        if isinstance(step, Write):
            wires = {'': Memory(before), 'magnetometer': Memory(before)}
            load(name)(wires, SimulatedClock(), settings).registers.run((step,))
            found += sorted(wires[part].written)
    return [(register, word) for register, word in found if (name, register) != ('iim42652', 0x76)]


CASES = [
    # eMPL; the clock of the master, 0x0D, and its wait, 0x40, as in PX4
    ('mpu9250', 'reset_steps', {}, [(0x6B, 0x80), (0x6B, 0x01), (0x6C, 0x00)]),
    ('mpu9250', 'bypass_steps', {0x6A: 0x20}, [(0x37, 0x02), (0x6A, 0x00)]),
    ('mpu9250', 'master_steps', {0x37: 2}, [(0x24, 0x4D), (0x37, 0x00), (0x6A, 0x20)]),
    (
        'mpu9250', 'stop_steps', {0x23: 0xF8, 0x38: 0x11, 0x6A: 0x60},
        [(0x23, 0x00), (0x38, 0x00), (0x6A, 0x20)],
    ),
    # Linux
    ('iim42652', 'reset_steps', {}, [(0x11, 0x01)]),
    ('iim42652', 'stop_steps', {0x16: 0x40}, [(0x16, 0x00)]),
    # ST
    ('lsm9ds1', 'reset_steps', {}, [(0x22, 0x05)]),
]  # fmt: skip

OF_MAGNETOMETER = [
    ('mpu9250', 'magnetometer_trim_steps', [(0x0B, 0x01), (0x0A, 0x1F)]),  # eMPL: 0x0F | 0x10
    ('mpu9250', 'magnetometer_off_steps', [(0x0A, 0x10)]),
    ('lsm9ds1', 'magnetometer_reset_steps', [(0x21, 0x0C)]),  # ST: reboot and soft reset
]


@pytest.mark.parametrize(
    ('name', 'sequence', 'before', 'expected'), CASES, ids=[f'{c[0]}-{c[1]}' for c in CASES]
)
def test_what_a_sequence_puts_on_the_wire(name, sequence, before, expected):
    assert written(name, sequence, before) == expected


@pytest.mark.parametrize(
    ('name', 'sequence', 'expected'),
    OF_MAGNETOMETER,
    ids=[f'{c[0]}-{c[1]}' for c in OF_MAGNETOMETER],
)
def test_what_a_sequence_puts_on_the_wire_of_the_magnetometer(name, sequence, expected):
    bypass = {'magnetometer_bypass': True} if name == 'mpu9250' else {}
    assert written(name, sequence, {}, 'magnetometer', **bypass) == expected
