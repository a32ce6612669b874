# SPDX-License-Identifier: Apache-2.0
"""The LSM303DLHC driver: bytes of the document, order of the start-up, every status flag."""

from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.drivers.lsm303dlhc import Lsm303dlhc
from imu_bench.errors import ConfigError, NoAnswer
from imu_bench.registers import Field, Register
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

MAG = 'magnetometer'
# Doc ID 018771 rev. 1: every register with address and reset value, None where it gives none
SHEET = {
    0x20: 0x07,
    **dict.fromkeys([*range(0x21, 0x28), 0x2E, *range(0x30, 0x3E)], 0),
    **dict.fromkeys([*range(0x28, 0x2E), 0x2F]),
}
MAG_SHEET = {
    0x00: 0x10,
    0x01: 0x20,
    0x02: 0x03,
    **dict.fromkeys([*range(0x03, 0x09), 0x31, 0x32]),
    0x09: 0,
    0x0A: 0x48,
    0x0B: 0x34,
    0x0C: 0x33,
}


@pytest.mark.parametrize(('part', 'sheet'), [('', SHEET), (MAG, MAG_SHEET)])
def test_every_register_of_the_sheet_is_there(part, sheet):
    declared = {}
    for register in Lsm303dlhc.declared(Register).values():
        if register.part == part:
            data = None if register.reset is None else register.pack(register.reset)
            for k in range(register.size):
                declared[register.address + k] = None if data is None else data[k]
    assert declared == sheet


# --- settings ----------------------------------------------------------------------------
def driver(steps=(), magnetometer=(), **settings):
    buses = {'': ScriptedRegisters(steps), MAG: ScriptedRegisters(magnetometer)}
    return Lsm303dlhc(buses, SimulatedClock(), settings)


def words(made):
    """Return the word that each register is configured to."""
    out = {}
    for target, value in made.assignments().items():
        register = getattr(target, 'register', target)
        word = out.get(register.name, register.reset)
        out[register.name] = target.insert(word, value) if isinstance(target, Field) else value
    return out


def test_defaults_are_the_settings_of_the_thesis():
    # Shabulinzenze 2020, tables 4.2 and 5.2: 1344 Hz, ±16 g
    made = driver()
    assert made.rate_hz == 1344.0
    written = words(made)
    assert written['CTRL_REG1_A'] == 0x97
    assert written['CTRL_REG4_A'] == 0xB8  # block update, ±16 g, high resolution
    assert written['CTRL_REG5_A'] == 0x40
    assert written['CRA_REG_M'] == 0x98  # thermometer on, 75 Hz
    assert written['CRB_REG_M'] == 0x20
    assert written['MR_REG_M'] == 0x00


def test_a_magnetometer_that_is_off_sleeps():
    made = driver(magnetometer_rate_hz=0.0)
    assert words(made)['MR_REG_M'] == 0x03
    assert made.rates_hz == {}


@pytest.mark.parametrize(
    ('name', 'value', 'allowed'),
    [
        ('rate_hz', 1620.0, '1, 10, 25, 50, 100, 200, 400, 1344'),
        ('accelerometer_range', 12.0, '2, 4, 8, 16 g'),
        ('magnetometer_range', 2.0, '1.3, 1.9, 2.5, 4, 4.7, 5.6, 8.1 G'),
        ('magnetometer_rate_hz', 100.0, '0, 0.75, 1.5, 3, 7.5, 15, 30, 75, 220'),
        ('temperature_zero', 200.0, '-100 to 100 °C'),
    ],
)
def test_what_the_datasheet_does_not_have_is_refused(name, value, allowed):
    with pytest.raises(ConfigError, match=f'{name}.*{allowed}'):
        driver(**{name: value})


@pytest.mark.parametrize(
    ('settings', 'period'),
    [
        ({}, 8 / 1344),  # 32 slots fill in 24 ms
        ({'magnetometer_rate_hz': 220.0}, 0.5 / 220),
        ({'rate_hz': 1.0, 'magnetometer_rate_hz': 0.0}, 0.25),
    ],
)
def test_polls_are_often_enough(settings, period):
    assert driver(**settings).poll_period_s == pytest.approx(period)


# --- reading -----------------------------------------------------------------------------
SLOT = bytes.fromhex('3005 0000 d0fa')  # 83, 0, -83 at 12 mg: 0.996 g
NOT_READY = [(('read', 0x09, 1), b'\x00')]


def looked(level, flags=0x00):
    return [(('read', 0x2E, 2), bytes([0x80, flags | level]))]


def burst(slots):
    return [(('read', 0x28, 6 * slots), SLOT * slots), (('read', 0x2E, 1), b'\x80')]


def running(*steps, magnetometer=NOT_READY, **settings):
    """Return a driver that believes that the stream runs."""
    made = driver(steps, magnetometer, **settings)
    made.configured = True
    made._field.begin()
    return made


def test_a_burst_is_decoded_and_stamped_backwards_from_the_level():
    made = running(*looked(4), *burst(3))
    (run,) = made.read()
    expected = made.clock.now_ns() - 1e9 / 1344 * np.array([3, 2, 1])
    np.testing.assert_allclose(run.stamps, expected, atol=1)
    np.testing.assert_allclose(run.acceleration, [[9.76742, 0, -9.76742]] * 3, atol=1e-5)
    assert run.angular_velocity is None
    assert made.continuity == 0


def test_saturated_samples_are_counted_and_kept():
    slots = SLOT + bytes.fromhex('f07f 0000 0000') + bytes.fromhex('0000 0080 0000')
    made = running(*looked(4), (('read', 0x28, 18), slots), (('read', 0x2E, 1), b'\x80'))
    assert len(made.read()[0]) == 3
    assert made.counters['saturated'] == 2


@pytest.mark.parametrize('flags', [0x00, 0x40])
def test_a_full_fifo_is_a_new_beginning(flags):
    # five bits of level: 31 may be 32
    made = running(*looked(31, flags), *burst(30))
    read = made.fifo._registers.burst
    made.fifo._registers.burst = lambda *args: (made.clock.sleep(2e-3), read(*args))[1]
    assert len(made.read()[0]) == 30
    assert made.counters['fifo_overflows'] == (flags == 0x40)
    assert made.continuity == 1


RESTART = [(('write', 0x2E, b'\x00'), b''), (('write', 0x2E, b'\x80'), b'')]


def test_a_fifo_that_is_not_in_its_mode_makes_the_driver_look_at_everything(monkeypatch):
    made = running((('read', 0x2E, 2), b'\x00\x05'), *RESTART)
    monkeypatch.setattr(made.registers, 'difference', lambda values: '')
    assert made.read() == []
    assert made.continuity == 1


def test_an_error_before_the_burst_costs_nothing():
    made = running((('read', 0x2E, 2), NoAnswer('glitch')), *looked(4), *burst(3))
    with pytest.raises(NoAnswer):
        made.read()
    assert len(made.read()[0]) == 3
    assert made.continuity == 0


# --- magnetometer ------------------------------------------------------------------------
def field(data, warmth=('05', '00'), **settings):
    steps = [(('read', 0x09, 1), b'\x01'), (('read', 0x03, 6), bytes.fromhex(data))]
    steps += [
        (('read', number, 1), bytes.fromhex(byte))
        for number, byte in zip((0x31, 0x32), warmth, strict=True)
    ]
    made = running(*looked(0), magnetometer=steps, **settings)
    made.clock.sleep(0.008)
    return made, made.read()


def test_the_examples_of_field_and_temperature():
    made, (run,) = field('0226 01ea 0000')  # x 550 at 1100 LSB/G, z 490 at 980 LSB/G
    np.testing.assert_allclose(run.magnetic_field, [[50e-6, 0, 50e-6]])
    np.testing.assert_allclose(run.temperature, [30.0])
    assert run.stamps.tolist() == [made.clock.now_ns() - 4_000_000]


def test_the_zero_of_the_thermometer_is_a_setting():
    _, (run,) = field('0226 01ea 0000', temperature_zero=25.0)
    np.testing.assert_allclose(run.temperature, [35.0])


def test_an_axis_out_of_range_is_counted_and_not_delivered():
    made, runs = field('0226 f000 0000')
    assert runs == []
    assert made.counters['magnetometer_overflows'] == 1


def test_a_reading_at_the_limit_is_saturated_and_delivered():
    made, runs = field('07ff 0000 0000')
    assert len(runs) == 1
    assert made.counters['saturated'] == 1


def test_what_stays_ready_is_new_only_if_it_changes_or_is_overdue():
    made, _ = field('0226 01ea 0000')
    made._ready_stays = True
    same = [(('read', 0x09, 1), b'\x01'), (('read', 0x03, 6), bytes.fromhex('022601ea0000'))]
    warmth = [(('read', 0x31, 1), b'\x05'), (('read', 0x32, 1), b'\x00')]

    def again(wait_s, steps):
        made.clock.sleep(wait_s)
        made._wires[''].__init__(looked(0))
        made._wires[MAG].__init__(steps)
        return made.read()

    assert again(0.006, same) == []
    assert len(again(0.015, [*same, *warmth])) == 1
    other = [same[0], (('read', 0x03, 6), bytes.fromhex('022701ea0000'))]
    assert len(again(0.006, [*other, *warmth])) == 1


def test_a_failing_magnetometer_costs_no_sample():
    made = running(
        *looked(4), *burst(3), magnetometer=[(('read', 0x09, 1), NoAnswer('the wire moved'))] * 2
    )
    assert len(made.read()[0]) == 3
    assert made.counters['bus_errors'] == 2  # asked twice
