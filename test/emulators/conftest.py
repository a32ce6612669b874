# SPDX-License-Identifier: Apache-2.0
"""A chip's surroundings that hold still: every sample is the same."""

from imu_bench.acquisition import Acquisition
from imu_bench.drivers import load
from imu_bench.emulators import create
from imu_bench.emulators.faults import wrap
from imu_bench.errors import BusError, IdentityError
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


class _Driven:
    """A driver on an emulated bus with faults, and what came out of it."""

    def __init__(self, clock, source, name, kind='i2c', faults=(), options=None, **settings):
        self.clock = clock
        self.source = source
        driver = load(name)
        self.buses = wrap(
            create(name, kind, source, clock, **(options or {})), driver, clock, faults
        )
        self.driver = driver(self.buses, clock, settings)
        self.errors = []
        self.main, self.fields, self.temperatures = [], [], []
        clock.sleep(0.05)

    def bring_up(self):
        self.driver.configure()
        self.driver.start()
        return self

    def run(self, seconds):
        end = due = self.clock.now_ns()
        end += round(seconds * 1e9)
        while due < end:
            due += round(self.driver.poll_period_s * 1e9)
            self.clock.sleep_until(due)
            try:
                for run in self.driver.read():
                    self.keep(run)
            except (BusError, IdentityError) as error:
                self.errors.append(type(error))

    def keep(self, run):
        if run.acceleration is not None:
            self.main.append(run)
        if run.magnetic_field is not None:
            self.fields.append(run)
        if run.temperature is not None:
            self.temperatures.append(run)

    def inject(self, kind, *args):
        for bus in self.buses.values():
            bus.inject(kind, *args)

    def clear(self):
        for bus in self.buses.values():
            bus.clear()

    @property
    def samples(self):
        return sum(map(len, self.main))

    @property
    def values(self):
        return np.concatenate([run.acceleration for run in self.main])


@pytest.fixture
def driven(clock, make_source):
    """Return what makes a driver on an emulated bus with faults, not configured yet."""

    def make(name, kind='i2c', faults=(), options=None, source=None, **settings):
        return _Driven(clock, source or make_source(), name, kind, faults, options, **settings)

    return make


@pytest.fixture
def running(driven):
    """Return what makes a driver on an emulated bus whose stream runs."""
    return lambda name, kind='i2c', **settings: driven(name, kind, **settings).bring_up()


class _Acquired:
    """A driver on an emulated bus with faults, and what came out of its acquisition."""

    STEP_NS = 5_000_000

    def __init__(self, clock, source, name, kind, faults=(), options=None, **settings):
        self.clock, self.source, self.kind = clock, source, kind
        driver = load(name)
        buses = create(name, kind, source, clock, **(options or {}))
        self.chip = buses[''].chip
        self.bus = wrap(buses, driver, clock, faults)['']
        clock.sleep(driver.start_up_s)
        self.driver = driver(self.bus, clock, settings)
        self.acquisition = Acquisition(self.driver, clock, name=name)
        self.errors, self.texts, self.runs = set(), set(), []

    def run(self, seconds):
        end = self.clock.now_ns() + round(seconds * 1e9)
        while self.clock.now_ns() < end:
            self.acquisition.advance(min(self.clock.now_ns() + self.STEP_NS, end))
            self.runs += self.acquisition.drain()
            error = self.acquisition.error
            if error is not None:
                self.errors.add(type(error))
                self.texts.add(str(error))
        return self

    @property
    def main(self):
        return [run for run in self.runs if run.acceleration is not None]

    @property
    def stamps(self):
        return np.concatenate([run.stamps for run in self.main])

    @property
    def stats(self):
        return self.acquisition.stats


@pytest.fixture
def acquired(clock, make_source):
    """Return what makes an acquisition of a driver on an emulated bus with faults."""

    def make(name, kind, faults=(), options=None, source=None, **settings):
        return _Acquired(clock, source or make_source(), name, kind, faults, options, **settings)

    return make
