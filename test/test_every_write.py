# SPDX-License-Identifier: Apache-2.0
"""
Every write of every driver on I²C, carried out without an acknowledge, and chips that were used.

A chip may carry out what it does not acknowledge, as a reset that takes effect at once; and it
may hold what another program left in it.  Either way the driver comes up and measures rightly.
"""

from contextlib import suppress

from imu_bench.drivers import load, names
from imu_bench.emulators import create
from imu_bench.emulators.faults import wrap
from imu_bench.errors import ConfigError, NoAnswer
from imu_bench.registers import Register
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

ON_I2C = [name for name in names() if 'i2c' in load(name).bus_kinds]
EVERYWHERE = [(name, kind) for name in names() for kind in load(name).bus_kinds]
WITH_REGISTERS = [
    (name, kind)
    for name in names()
    for kind in load(name).bus_kinds
    if kind in ('i2c', 'spi') and any(r.writable for r in load(name).declared(Register).values())
]
ACCELERATION = (1.0, -2.0, 3.0)
RATE_OF_TURN = (0.1, 0.2, -0.3)


class Trembling:
    """A source that hardly moves, at the rate that the chip asks for; no sample is the last."""

    def __init__(self, clock):
        self.restart(clock.now_ns(), 1000.0)

    def restart(self, t_ns, nominal_hz=None):
        self.nominal_hz = nominal_hz or self.nominal_hz
        self.anchor_ns, self.made = t_ns, 0

    def samples_ahead(self, t_ns):
        # what costs by the call is paid for many samples at once, as with a simulated sensor
        return self.samples_until(t_ns + round(64 * 1e9 / self.nominal_hz))

    def samples_until(self, t_ns):
        due = max(int((t_ns - self.anchor_ns) * self.nominal_hz * 1e-9), self.made)
        k = np.arange(self.made + 1, due + 1)
        self.made = due
        n, up = len(k), 0.05 * (k % 2)[:, None]
        return Samples(
            self.anchor_ns + np.rint(k * (1e9 / self.nominal_hz)).astype(np.int64),
            np.asarray(ACCELERATION) + up,
            np.asarray(RATE_OF_TURN) + 0.1 * up,
            magnetic_field=np.broadcast_to((20e-6, 0.0, -40e-6), (n, 3)),
            temperature=np.full(n, 25.0),
        )


class Unacknowledged:
    """A bus on which some writes are carried out and not acknowledged, counted over all parts."""

    def __init__(self, bus, silent, count):
        self._bus, self._silent, self._count = bus, silent, count

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def write(self, register, data):
        self._bus.write(register, data)
        self._count.append(register)
        if self._silent(len(self._count) - 1):
            raise NoAnswer('not acknowledged')


def comes_up(name, kind, prepare=lambda wires, clock: wires):
    """Configure and start a driver, let it measure, and compare with what there was."""
    clock = SimulatedClock()
    driver = load(name)
    wires = create(name, kind, Trembling(clock), clock)
    clock.sleep(driver.start_up_s)
    made = driver(prepare(wires, clock), clock, {})
    made.configure()
    made.start()
    started_ns = clock.now_ns()
    runs = []
    while sum(len(run) for run in runs) < 5:
        assert clock.now_ns() - started_ns < 10e9, 'no sample'
        clock.sleep(0.01)
        runs += [run for run in made.read() if run.acceleration is not None and len(run)]
    last = runs[-1]
    expected = np.where(np.isnan(last.acceleration[-1]), np.nan, ACCELERATION)
    np.testing.assert_allclose(last.acceleration[-1], expected, atol=0.02 * 9.81)
    if last.angular_velocity is not None:
        np.testing.assert_allclose(last.angular_velocity[-1], RATE_OF_TURN, atol=0.01)


def unacknowledged(silent, done):
    return lambda wires, clock: {
        part: Unacknowledged(bus, silent, done) for part, bus in wires.items()
    }


@pytest.mark.parametrize('name', ON_I2C)
def test_no_write_needs_its_acknowledge(name):
    done = []
    comes_up(name, 'i2c', unacknowledged(lambda k: False, done))
    assert done
    for number in range(len(done)):
        comes_up(name, 'i2c', unacknowledged(lambda k, number=number: k == number, []))


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize(('name', 'kind'), WITH_REGISTERS)
def test_what_another_program_left_in_the_chip_does_no_harm(name, kind, seed):
    noise = np.random.default_rng(seed)

    def used(wires, clock):
        for register in load(name).declared(Register).values():
            if register.access == 'rw' and register.part in wires:
                word = int.from_bytes(noise.bytes(register.size))
                for field in load(name).fields_of(register):
                    value = field.allowed[noise.integers(len(field.allowed))]
                    word = field.insert(word, 0 if field.self_clearing else value)
                with suppress(NoAnswer):  # behind a bus that this switched off
                    wires[register.part].write(register.number, register.pack(word))
        clock.sleep(1.0)
        return wires

    comes_up(name, kind, used)


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize(('name', 'kind'), EVERYWHERE)
def test_a_chip_that_runs_with_other_settings_is_taken_over(name, kind, seed):
    noise = np.random.default_rng(seed)
    driver = load(name)

    def other(wires, clock):
        for _ in range(100):
            chosen = {
                setting.name: setting.allowed[noise.integers(len(setting.allowed))]
                for setting in driver.settings
                # the speed of a line is that of both its ends, and the converter is what it is
                if setting.allowed and setting.name not in (*driver.described, 'converter')
            }
            with suppress(ConfigError):  # not all go together
                return driver(wires, clock, chosen)
        raise AssertionError('no settings that go together')

    def running(wires, clock):
        before = other(wires, clock)
        before.configure()
        before.start()
        clock.sleep(0.2)
        before.read()
        return wires

    comes_up(name, kind, running)


@pytest.mark.parametrize('name', ON_I2C)
def test_a_chip_that_is_busy_now_and_then_comes_up(name):
    driver = load(name)

    def busy(wires, clock):
        wrapped = wrap(wires, driver, clock)
        for wire in wrapped.values():
            wire.inject('busy')
        return wrapped

    clock = SimulatedClock()
    made = driver(busy(create(name, 'i2c', Trembling(clock), clock), clock), clock, {})
    clock.sleep(driver.start_up_s)
    for _ in range(5):
        try:
            made.configure()
            made.start()
        except NoAnswer as error:
            last = error
            continue
        break
    else:
        raise last
