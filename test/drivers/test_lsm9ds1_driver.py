# SPDX-License-Identifier: Apache-2.0
"""The LSM9DS1 driver: bytes of the document, order of the start-up, every status flag."""

from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.drivers.lsm9ds1 import Lsm9ds1
from imu_bench.errors import BusError, ConfigError, NoAnswer
from imu_bench.registers import Field, Frame, Register
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

MAG = 'magnetometer'
# DocID025715 rev. 2: every register with address and reset value, None where it gives none
SHEET = {
    **dict.fromkeys([*range(0x04, 0x0E), *range(0x10, 0x14), 0x20, 0x21, 0x23, 0x24, 0x2E], 0),
    **dict.fromkeys(range(0x30, 0x38), 0),
    0x0F: 0x68,
    0x1E: 0x38,
    0x1F: 0x38,
    0x22: 0x04,
    **dict.fromkeys([*range(0x14, 0x1E), 0x26, 0x27, *range(0x28, 0x2E), 0x2F]),
}
MAG_SHEET = {
    **dict.fromkeys([*range(0x05, 0x0B), 0x21, 0x23, 0x24, 0x31, 0x32, 0x33], 0),
    0x0F: 0x3D,
    0x20: 0x10,
    0x22: 0x03,
    0x30: 0x08,
    **dict.fromkeys(range(0x27, 0x2E)),
}


@pytest.mark.parametrize(('part', 'sheet'), [('', SHEET), (MAG, MAG_SHEET)])
def test_every_register_of_the_sheet_is_there(part, sheet):
    declared = {}
    for register in Lsm9ds1.declared(Register).values():
        if register.part == part:
            data = None if register.reset is None else register.pack(register.reset)
            for k in range(register.size):
                declared[register.address + k] = None if data is None else data[k]
    assert declared == sheet


def test_the_frame_is_right_handed_and_the_same_for_all():
    # DS figure 1: from above, x of the accelerometer turns clockwise into y, z up
    chip_x, chip_y = np.array([[1000, 0, 0]]), np.array([[0, 1000, 0]])
    acceleration = Lsm9ds1.acceleration
    x, y = (acceleration.decode(words, 2.0)[0] for words in (chip_x, chip_y))
    z = acceleration.decode(np.array([[0, 0, 1000]]), 2.0)[0]
    np.testing.assert_allclose(np.cross(-x, y), z / z[2] * x[0] ** 2)
    # a rotation seen counter-clockwise along an axis is positive along it
    assert Lsm9ds1.angular_velocity.axes == acceleration.axes
    # the magnetometer's x is opposite to the accelerometer's, so it fits as it is
    np.testing.assert_array_equal(
        np.array(Lsm9ds1.magnetic_field.axes) @ np.diag([-1, 1, 1]), acceleration.axes
    )


# --- settings ----------------------------------------------------------------------------
def driver(steps=(), magnetometer=(), **settings):
    buses = {'': ScriptedRegisters(steps), MAG: ScriptedRegisters(magnetometer)}
    return Lsm9ds1(buses, SimulatedClock(), settings)


def codes(made):
    return {
        target.name: target.encode(value) if isinstance(target, Field) else value
        for target, value in made.assignments().items()
    }


def test_defaults_are_the_settings_of_the_thesis():
    # Shabulinzenze 2020, tables 4.2 and 5.2: 952 Hz, ±16 g, 408 Hz
    made = driver()
    assert made.rate_hz == 952.0
    written = codes(made)
    assert written['sample_rate'] == 6
    assert written['accelerometer_range'] == 1  # the second code
    assert (written['bandwidth_by_hand'], written['accelerometer_bandwidth']) == (1, 0)
    assert (written['gyroscope_range'], written['gyroscope_output']) == (3, 0)
    assert written['CTRL_REG8'] == 0x44
    assert written['magnetometer_rate'] == 7
    assert written['magnetometer_mode'] == 0
    assert (written['magnetometer_quality'], written['magnetometer_quality_z']) == (3, 3)


def test_the_quality_of_the_magnetometer_is_that_of_all_its_axes():
    written = codes(driver(magnetometer_quality='medium'))
    assert (written['magnetometer_quality'], written['magnetometer_quality_z']) == (1, 1)


def test_the_vehicle_test_can_be_set():
    made = driver(rate_hz=119.0, accelerometer_bandwidth=50.0, gyroscope_low_pass_2=14.0)
    written = codes(made)
    assert (written['sample_rate'], written['accelerometer_bandwidth']) == (3, 3)
    assert (written['gyroscope_output'], written['gyroscope_low_pass']) == (2, 0)


@pytest.mark.parametrize(
    ('name', 'value', 'allowed'),
    [
        ('rate_hz', 1000.0, '14.9, 59.5, 119, 238, 476, 952'),
        ('accelerometer_range', 6.0, '2, 16, 4, 8 g'),
        ('accelerometer_bandwidth', 400.0, '408, 211, 105, 50 Hz'),
        ('gyroscope_range', 250.0, '245, 500, 2000 °/s'),
        ('gyroscope_low_pass_2', 15.0, '0, 14, 16, 21'),
        ('magnetometer_range', 1.3, '4, 8, 12, 16 G'),
        ('magnetometer_quality', 'best', 'low, medium, high, ultra-high'),
        ('magnetometer_rate_hz', 100.0, '0, 0.625, 1.25'),
    ],
)
def test_what_the_datasheet_does_not_have_is_refused(name, value, allowed):
    with pytest.raises(ConfigError, match=f'{name}.*{allowed}'):
        driver(**{name: value})


@pytest.mark.parametrize(
    ('rate', 'wanted', 'allowed'), [(14.9, 14.0, '0 Hz'), (119.0, 100.0, '0, 14, 31 Hz')]
)
def test_a_low_pass_that_the_rate_does_not_have_is_refused_with_what_it_has(rate, wanted, allowed):
    with pytest.raises(ConfigError, match=f'low_pass_2: .*at rate_hz {rate:g}.*: {allowed}'):
        driver(rate_hz=rate, gyroscope_low_pass_2=wanted)


def test_a_magnetometer_that_is_off_is_left_alone():
    made = driver(magnetometer_rate_hz=0.0)
    assert not [t for t in made.assignments() if getattr(t, 'register', t).part == MAG]
    assert made.rates_hz == {'temperature': 59.5}


@pytest.mark.parametrize(
    ('settings', 'period'),
    [
        ({'magnetometer_rate_hz': 0.0}, 8 / 952),
        ({}, 8 / 952),
        ({'rate_hz': 119.0}, 0.0075),  # 80 Hz of the magnetometer, with acquisition's variation
        ({'rate_hz': 14.9, 'magnetometer_rate_hz': 0.0}, 0.6 / 14.9),
    ],
)
def test_polls_are_often_enough(settings, period):
    assert driver(**settings).poll_period_s == pytest.approx(period)


# --- reading -----------------------------------------------------------------------------
# gyroscope (1000, 0, -1000), accelerometer (0, 0, 1366): DS table 3 at ±2000 °/s and ±16 g
SLOT = bytes.fromhex('e803 0000 18fc 0000 0000 5605')
CONTROL = bytes.fromhex('383820000400')  # CTRL_REG4 to CTRL_REG9
STOPPED = (('write', 0x2E, b'\x00'), b'')
FASTEST = [(('read', 0x10, 1), b'\xd8'), (('write', 0x10, b'\xd8'), b'')]  # 952 Hz
NO_TEMPERATURE = [(('read', 0x17, 1), b'\x03')]
NO_FIELD = [(('read', 0x27, 7), bytes(7))]


def looked(level, flags=0x00):
    return [(('read', 0x2E, 2), bytes([0xC0, flags | level]))]


def burst(slots):
    return [(('read', 0x18, 12 * slots), SLOT * slots), (('read', 0x2E, 1), b'\xc0')]


def running(*steps, magnetometer=NO_FIELD, **settings):
    """Return a driver that believes that the stream runs."""
    made = driver(steps, magnetometer, **settings)
    made.configured = True
    made._field.begin()
    made._warmth.begin()
    return made


def test_a_burst_is_decoded_and_stamped_backwards_from_the_level():
    made = running(*looked(4), *burst(3), *NO_TEMPERATURE)
    (run,) = made.read()
    period = 1e9 / 952
    # the newest one stays in the FIFO
    expected = made.clock.now_ns() - period * np.array([3, 2, 1])
    np.testing.assert_allclose(run.stamps, expected, atol=1)
    np.testing.assert_allclose(run.acceleration, [[0, 0, 9.80579]] * 3, atol=1e-5)
    np.testing.assert_allclose(run.angular_velocity, [[-1.22173, 0, -1.22173]] * 3, atol=1e-5)
    assert made.continuity == 0


@pytest.mark.parametrize('level', [0, 1])
def test_a_single_slot_is_left_where_it_is(level):
    assert running(*looked(level), *NO_TEMPERATURE).read() == []


def test_saturated_samples_are_counted_and_kept():
    slots = SLOT + bytes.fromhex('ff7f 0000 0000 0000 0080 0000') + SLOT
    steps = [(('read', 0x18, 36), slots), (('read', 0x2E, 1), b'\xc0')]
    made = running(*looked(4), *steps, *NO_TEMPERATURE)
    assert len(made.read()[0]) == 3
    assert made.counters['saturated'] == 1


@pytest.mark.parametrize(
    ('look', 'taken', 'overflows'),
    [
        (looked(32, 0x40), 31, 1),
        (looked(32), 31, 1),  # full: the next sample may have been lost already
        (looked(20, 0x40), 19, 1),
        (looked(31), 30, 0),
    ],
)
def test_an_overrun_is_a_new_beginning(look, taken, overflows):
    made = running(*look, *burst(taken), *NO_TEMPERATURE)
    clock, words = made.clock, made.fifo._registers.burst
    made.fifo._registers.burst = lambda *args: (clock.sleep(2e-3), words(*args))[1]
    (run,) = made.read()
    assert len(run) == taken
    assert made.counters['fifo_overflows'] == overflows
    assert made.continuity == 1


RESTART = [
    (('write', 0x2E, b'\x00'), b''),
    (('write', 0x2E, b'\xc0'), b''),
]


def test_a_fifo_that_is_not_in_its_mode_makes_the_driver_look_at_everything(monkeypatch):
    made = running((('read', 0x2E, 2), b'\x00\x05'), *RESTART)
    monkeypatch.setattr(made.registers, 'difference', lambda values: '')
    assert made.read() == []
    assert made.continuity == 1
    assert made.counters['brown_outs'] == 0


def test_a_burst_after_which_the_chip_is_another_is_not_delivered(monkeypatch):
    made = running(*looked(4), burst(3)[0], (('read', 0x2E, 1), b'\x00'), *RESTART)
    monkeypatch.setattr(made.registers, 'difference', lambda values: '')
    assert made.read() == []
    assert made.continuity == 1


def test_an_error_before_the_burst_costs_nothing():
    steps = [(('read', 0x2E, 2), NoAnswer('glitch')), *looked(4), *burst(3), *NO_TEMPERATURE]
    made = running(*steps)
    with pytest.raises(NoAnswer):
        made.read()
    assert len(made.read()[0]) == 3
    assert made.continuity == 0


def test_an_impossible_level_is_an_error():
    made = running((('read', 0x2E, 2), b'\xff\xff'))
    with pytest.raises(BusError, match='63 of 32'):
        made.read()
    assert made.counters['bus_errors'] == 1


def tried(slots, level_after, behind=CONTROL):
    """What a driver asks to find out how slots are read, and what a chip answers."""
    return [
        *(STOPPED, *FASTEST, (('write', 0x2E, b'\x20'), b'')),
        (('read', 0x2F, 1), b'\x20'),
        (('read', 0x18, 48), slots),
        (('read', 0x2F, 1), bytes([level_after])),
        (('read', 0x1E, 6), behind),
        *(STOPPED, *FASTEST),
    ]


@pytest.mark.parametrize(
    ('slots', 'level_after', 'apart'),
    [
        (SLOT * 4, 0x1C, False),  # four slots less
        (SLOT * 4, 0x1F, False),  # the level is read late, or counts otherwise
        ((SLOT[:6] + CONTROL) * 4, 0x1C, True),  # the address goes on to what lies behind
        (SLOT * 4, 0x20, True),  # nothing was taken out
    ],
)
def test_slots_are_read_as_the_chip_gives_them(monkeypatch, slots, level_after, apart):
    made = running(*tried(slots, level_after))
    monkeypatch.setattr(made.registers, 'difference', lambda values: '')
    made.configure_parts()
    assert bool(made.fifo.apart) is apart
    assert made.counters['slots_apart'] == apart


def test_the_first_slots_are_thrown_away_after_turn_on(monkeypatch):
    made = running(*tried(SLOT * 4, 0x1C), *looked(22), *burst(21), *NO_TEMPERATURE)
    monkeypatch.setattr(made.registers, 'difference', lambda values: '')
    made.configure_parts()
    assert len(made.read()[0]) == 21 - 18


# --- what is beside the FIFO -------------------------------------------------------------
def test_temperature_when_it_is_new():
    steps = [(('read', 0x17, 1), b'\x07'), (('read', 0x15, 2), b'\xa0\x00')]
    made = running(*looked(0), *steps)
    (run,) = made.read()
    assert run.temperature.tolist() == [35.0]


def field(data, **settings):
    made = running(
        *looked(0), *NO_TEMPERATURE, magnetometer=[(('read', 0x27, 7), data)], **settings
    )
    made.clock.sleep(0.008)
    return made, made.read()


def test_the_example_of_the_magnetometer():
    made, (run,) = field(bytes.fromhex('0f 5d0d 0000 5d0d'))
    np.testing.assert_allclose(run.magnetic_field, [[50e-6, 0, 50e-6]])  # 3421 of 6842 LSB/G
    # ready some time between the last look and this one
    assert run.stamps.tolist() == [made.clock.now_ns() - 4_000_000]


def test_an_old_field_is_not_delivered():
    made, runs = field(bytes.fromhex('00 f30d 0000 f30d'))
    assert runs == []
    assert not +made.counters


def test_a_field_that_was_overwritten_is_counted():
    made, _ = field(bytes.fromhex('0f f30d 0000 f30d'))
    assert made.counters['magnetometer_lost'] == 0  # overwritten before the start
    made._wires[''].__init__([*looked(0), *NO_TEMPERATURE])
    made._wires[MAG].__init__([(('read', 0x27, 7), bytes.fromhex('ff f30d 0000 f30d'))])
    (run,) = made.read()
    assert len(run) == 1
    assert made.counters['magnetometer_lost'] == 1


def test_a_line_that_nobody_drives_is_no_field():
    made, runs = field(b'\xff' * 7)
    assert runs == []
    assert made.counters['bus_errors'] == 1


def test_a_failing_magnetometer_costs_no_sample():
    made = running(
        *looked(4),
        *burst(3),
        *NO_TEMPERATURE,
        magnetometer=[(('read', 0x27, 7), NoAnswer('the wire moved'))],
    )
    assert len(made.read()[0]) == 3
    assert made.counters['bus_errors'] == 1


def test_a_slot_as_numpy_sees_it():
    words = Frame(Lsm9ds1.angular_velocity, Lsm9ds1.acceleration).unpack(SLOT)
    assert words['angular_velocity'].tolist() == [[1000, 0, -1000]]
    assert words['acceleration'].tolist() == [[0, 0, 1366]]
