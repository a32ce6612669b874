# SPDX-License-Identifier: Apache-2.0
"""The ADXL355 driver: registers of its data sheet, bytes on both wires, tags, faults."""

from imu_bench import bench
from imu_bench.bus.scripted import ScriptedFrames
from imu_bench.bus.spi import SpiRegisterBus
from imu_bench.config import sensor_from_parameters
from imu_bench.drivers.adxl355 import Adxl355
from imu_bench.emulators import create
from imu_bench.errors import BusError, FrameError, IdentityError
from imu_bench.registers import Register
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock, START_NS
from imu_bench.simulation.scenario import load_scenario
import numpy as np
import pytest

# ADXL354/ADXL355 rev. C, register map: address and reset value
SHEET = """
00:AD 01:1D 02:ED 03:01 04:00 05:00 06:00 07:00 08:00 09:00 0A:00 0B:00 0C:00 0D:00 0E:00 0F:00
10:00 11:00 1E:00 1F:00 20:00 21:00 22:00 23:00 24:00 25:00 26:00 27:01 28:00 29:60 2A:00 2B:00
2C:81 2D:01 2E:00 2F:00
"""
G = 9.80665


class Ramp:
    """The x axis counts samples in steps of 1000 LSB at ±2 g; exact rate."""

    def __init__(self, clock):
        self.restart(clock.now_ns(), 1000.0)

    def restart(self, t_ns, nominal_hz=None):
        self.hz = nominal_hz or getattr(self, 'hz', 1000.0)
        self.anchor_ns, self.made = t_ns, 0

    def samples_until(self, t_ns):
        due = max(int((t_ns - self.anchor_ns) * 1e-9 * self.hz + 1e-9), self.made)
        k = np.arange(self.made + 1, due + 1)
        self.made = due
        force = np.zeros((len(k), 3))
        force[:, 0] = k % 200 * 1000 / 256000 * G
        stamps = self.anchor_ns + np.rint(k * 1e9 / self.hz).astype(np.int64)
        return Samples(stamps, force, temperature=np.full(len(k), 45.0))


@pytest.fixture
def clock():
    return SimulatedClock()


@pytest.fixture
def make(clock):
    def made(kind='spi', **settings):
        bus = create('adxl355', kind, Ramp(clock), clock)['']
        clock.sleep(0.02)
        driver = Adxl355(bus, clock, settings)
        driver.configure()
        driver.start()
        return driver, bus

    return made


def runs(driver, clock, seconds):
    """Return what a driver reads at its own pace."""
    due = clock.now_ns()
    end, found = due + round(seconds * 1e9), []
    while due < end:
        due += round(driver.poll_period_s * 1e9)
        clock.sleep_until(due)
        found += driver.read()
    return found


def test_every_register_of_the_sheet_is_there():
    declared = {}
    for register in Adxl355.declared(Register).values():
        if register.reset is not None:
            for k, byte in enumerate(register.pack(register.reset)):
                declared[register.address + k] = byte
    sheet = (entry.split(':') for entry in SHEET.split())
    assert declared == {int(address, 16): int(value, 16) for address, value in sheet}


def test_the_address_stands_above_the_read_bit_on_spi():
    line = ScriptedFrames([(b'\x05\x00', b'\x00\xed'), (b'\x5a\x00', b'\x00\x00')])
    bus = SpiRegisterBus(line, Adxl355.wiring[''])
    assert bus.read(0x02, 1) == b'\xed'
    bus.write(0x2D, b'\x00')


@pytest.mark.parametrize('kind', ['i2c', 'spi'])
def test_what_configuration_leaves_in_the_chip(make, kind):
    _, bus = make(kind, rate_hz=125.0, accelerometer_range=8.0)
    assert bus.read(0x28, 1) == b'\x05'
    # the bit of fast I²C is left alone
    assert bus.read(0x2C, 2) == b'\x83\x00'


def test_what_the_emulated_fifo_holds_by_an_independent_decoder(make, clock):
    _, bus = make(rate_hz=250.0)
    clock.sleep(0.0401)
    entries = bus.read(0x05, 1)[0]
    assert entries == 30
    data = bus.read(0x11, 3 * entries)
    axes = []
    for k in range(entries):
        word = int.from_bytes(data[3 * k : 3 * k + 3], 'big')
        assert word & 0xF == (1 if k % 3 == 0 else 0)
        axes.append((word >> 4) - (1 << 20 if word >> 23 else 0))
    # a straight line passes a low-pass of first order with its slope
    assert np.abs(np.diff(axes[::3])[3:] - 1000).max() <= 2
    assert set(axes[1::3]) == set(axes[2::3]) == {0}


@pytest.mark.parametrize(
    ('kind', 'rate_hz'), [('i2c', 1000.0), ('spi', 4000.0), ('i2c', 4000.0), ('spi', 3.906)]
)
def test_every_sample_arrives_once(make, clock, kind, rate_hz):
    driver, _ = make(kind, rate_hz=rate_hz)
    found = Samples.concatenate(runs(driver, clock, max(0.1, 20 / rate_hz)))
    x = found.acceleration[:, 0] / G * 256000
    steps = np.diff(x)
    regular = steps > 0  # the ramp falls back after 200
    assert np.abs(steps[regular][5:] - 1000).max() < 400
    assert driver.continuity == 1
    assert driver.counters['fifo_overflows'] == 0
    assert np.abs(found.temperature - 45.0).max() < 0.06
    elapsed = (found.stamps[-1] - found.stamps[0]) * 1e-9 * rate_hz
    assert elapsed == pytest.approx(len(found) - 1, abs=1.1)


def test_an_overflow_is_counted_and_nothing_of_it_is_kept(make, clock):
    driver, _ = make()
    clock.sleep(0.1)
    assert driver.read() == []
    assert (driver.counters['fifo_overflows'], driver.continuity) == (1, 2)
    assert runs(driver, clock, 0.05)


def test_a_fifo_that_runs_over_between_count_and_burst(make, clock, monkeypatch):
    driver, bus = make()
    clock.sleep(0.0205)
    read = bus.read

    def late(register, length):
        if register == 0x11 and clock.now_ns() < since_ns + 5_000_000:
            clock.sleep(0.020)
        return read(register, length)

    since_ns = clock.now_ns()
    monkeypatch.setattr(bus, 'read', late)
    assert driver.read() == []
    assert (driver.counters['fifo_overflows'], driver.continuity) == (1, 2)


def test_entries_without_their_tag_are_refused_and_the_fifo_is_emptied(make, clock):
    driver, bus = make()
    clock.sleep(0.0055)
    bus.read(0x11, 3)  # somebody else took the x axis of a sample
    with pytest.raises(FrameError, match='tag'):
        driver.read()
    assert driver.counters['tag_errors'] == 1
    assert runs(driver, clock, 0.05)
    assert driver.continuity == 2


def test_a_dip_of_the_supply_is_found_out_and_repaired(make, clock):
    driver, bus = make(accelerometer_range=8.0)
    runs(driver, clock, 0.05)
    bus.chip.power_up(clock.now_ns())
    clock.sleep(0.02)
    assert runs(driver, clock, 0.5)
    assert (driver.counters['brown_outs'], driver.continuity) == (1, 2)
    assert bus.read(0x2C, 1) == b'\x83'


def test_a_dip_is_found_out_where_the_settings_are_those_after_reset(make, clock):
    driver, bus = make(rate_hz=4000.0)
    bus.chip.power_up(clock.now_ns())
    clock.sleep(0.02)
    assert runs(driver, clock, 0.5)
    assert (driver.counters['restarts'], driver.continuity) == (1, 2)


def test_a_spoilt_reset_is_repeated(make, clock):
    driver, bus = make()
    spoilt = [3]
    reset = bus.chip.reset

    def spoiling(at_ns):
        reset(at_ns)
        spoilt[0] -= 1
        bus.chip.memory.fill(Adxl355.SHADOW, bytes([spoilt[0] > 0]))

    bus.chip.reset = spoiling
    driver.configure()
    assert driver.counters['repeated_resets'] == 2
    spoilt[0] = 99
    with pytest.raises(BusError, match='differs after 5 resets'):
        driver.configure()
    assert not driver.configured


def test_the_adxl359_is_told_apart(make):
    driver, bus = make()
    bus.chip.memory.set(Adxl355.PARTID, 0xE9)
    with pytest.raises(IdentityError, match='ADXL359'):
        driver.identify()


def test_the_simulated_low_pass_follows_the_rate():
    def sigma(rate_hz):
        parameters = {'driver': 'adxl355', 'backend': 'emulated', 'rate_hz': rate_hz}
        sensor = bench.simulate(sensor_from_parameters('it', parameters), load_scenario('still'))
        rows = sensor.sources[0].samples_until(START_NS + round(4000 / rate_hz * 1e9))
        return rows.acceleration[:, 0].std() / G

    # 22.5 µg/√Hz in a quarter of the rate, more or less by what a first order lets pass beyond
    for rate_hz in (4000.0, 125.0):
        assert sigma(rate_hz) == pytest.approx(22.5e-6 * np.sqrt(rate_hz / 4), rel=0.15)
