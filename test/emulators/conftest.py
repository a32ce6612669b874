# SPDX-License-Identifier: Apache-2.0
"""A chip's surroundings that hold still: every sample is the same."""

from imu_bench.emulators import create
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest


class Constant:
    """A source whose samples are all alike, at an exact rate; remembers what it was told."""

    def __init__(self, clock, rate_error=0.0, **values):
        self.rate_error = rate_error
        self.values = values
        self.restart(clock.now_ns(), 1000.0)

    def restart(self, t_ns, nominal_hz=None):
        self.nominal_hz = nominal_hz or self.nominal_hz
        self.period_ns = 1e9 / (self.nominal_hz * (1 + self.rate_error))
        self.anchor_ns, self.made = t_ns, 0

    def samples_until(self, t_ns):
        due = max(int((t_ns - self.anchor_ns) / self.period_ns + 1e-9), self.made)
        k = np.arange(self.made + 1, due + 1)
        self.made = due
        stamps = self.anchor_ns + np.rint(k * self.period_ns).astype(np.int64)
        columns = {
            name: np.broadcast_to(value, (len(k), *np.shape(value)))
            for name, value in self.values.items()
        }
        return Samples(stamps, **columns)


@pytest.fixture
def clock():
    return SimulatedClock()


@pytest.fixture
def make_source(clock):
    def make(**values):
        still = {
            'acceleration': (0.0, 0.0, 9.80665),
            'angular_velocity': (0.1, 0.0, -0.1),
            'magnetic_field': (20e-6, 0.0, -40e-6),
            'temperature': 25.0,
        }
        return Constant(clock, **still | values)

    return make


@pytest.fixture
def make_chip(clock, make_source):
    """Return main bus, magnetometer bus (None on SPI) and source of a chip that is awake."""

    def make(kind='i2c', source=None, **options):
        source = source or make_source()
        buses = create('mpu9250', kind, source, clock, **options)
        clock.sleep(0.1)
        return buses[''], buses.get('magnetometer'), source

    return make


def _start_fifo(bus, enabled=0x78, config=0x01, divider=0, user=0x40):
    bus.write(0x1A, bytes([config]))
    bus.write(0x1B, b'\x18')  # 2000 dps
    bus.write(0x1C, b'\x18')  # 16 g
    bus.write(0x1D, b'\x07')
    bus.write(0x19, bytes([divider]))
    bus.write(0x38, b'\x11')
    bus.write(0x6A, b'\x04')
    bus.write(0x6A, bytes([user]))
    bus.write(0x23, bytes([enabled]))
    bus.read(0x3A, 1)


@pytest.fixture
def start_fifo():
    """Return what configures an MPU-9250 with bare numbers and starts its FIFO."""
    return _start_fifo


@pytest.fixture
def count():
    """Return what reads the level of the FIFO of an MPU-9250."""
    return lambda bus: int.from_bytes(bus.read(0x72, 2), 'big')
