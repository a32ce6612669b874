# SPDX-License-Identifier: Apache-2.0
"""The MPU-9250 driver: bytes of the documents, order of the start-up, every status flag."""

from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.drivers.mpu9250 import Mpu9250
from imu_bench.errors import BusError, ConfigError, IdentityError, NoAnswer
from imu_bench.registers import Field, Frame, Register
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

# RM-MPU-9250A-00 section 3, PS-MPU-9250A-01: every register with address and reset value
SHEET = {
    0x19: 0,
    0x1A: 0,
    0x1B: 0,
    0x1C: 0,
    0x1D: 0,
    0x1E: 0,
    0x1F: 0,
    0x23: 0,
    0x24: 0,
    **dict.fromkeys(range(0x13, 0x19), 0),
    **dict.fromkeys(range(0x25, 0x39), 0),
    **dict.fromkeys(range(0x3A, 0x61), 0),
    **dict.fromkeys(range(0x63, 0x6B), 0),
    0x6B: 1,
    0x6C: 0,
    0x72: 0,
    0x73: 0,
    0x74: 0,
    0x75: 0x71,
    **dict.fromkeys((0x77, 0x78, 0x7A, 0x7B, 0x7D, 0x7E)),
}
# AK8963 MS1356-E-02 section 8.2
AK_SHEET = {
    0x00: 0x48,
    0x01: None,
    0x02: 0,
    0x09: 0,
    0x0A: 0,
    0x0B: 0,
    0x0C: 0,
    **dict.fromkeys(range(0x03, 0x09)),
    **dict.fromkeys(range(0x10, 0x13)),
}
ALL_ON = b'\xf8'


@pytest.mark.parametrize(('part', 'sheet'), [('', SHEET), ('magnetometer', AK_SHEET)])
def test_every_register_of_the_sheet_is_there(part, sheet):
    declared = {}
    for register in Mpu9250.declared(Register).values():
        if register.part == part:
            data = None if register.reset is None else register.pack(register.reset)
            for k in range(register.size):
                declared[register.address + k] = None if data is None else data[k]
    assert declared == sheet


def test_the_frame_of_the_documents():
    # accel (0, 0, 2048), gyro (164, 0, -164) at 16 g and 2000 dps
    words = Frame(Mpu9250.acceleration, Mpu9250.angular_velocity).unpack(
        bytes.fromhex('0000 0000 0800 00A4 0000 FF5C')
    )
    np.testing.assert_allclose(
        Mpu9250.acceleration.decode(words['acceleration'], 16.0), [[0, 0, 9.80665]]
    )
    np.testing.assert_allclose(
        Mpu9250.angular_velocity.decode(words['angular_velocity'], 2000.0),
        [[0.174533, 0, -0.174533]],
        atol=1e-6,
    )


# --- settings ----------------------------------------------------------------------------
def driver(steps=(), magnetometer=None, **settings):
    buses = {'': ScriptedRegisters(steps)}
    if magnetometer is not None:
        buses['magnetometer'] = ScriptedRegisters(magnetometer)
        settings['magnetometer_bypass'] = True
    return Mpu9250(buses, SimulatedClock(), settings)


def test_defaults_are_the_settings_of_the_thesis():
    # Shabulinzenze 2020, tables 4.2 and 5.2: 16 g, 1 kHz, 460 Hz, which is 420 Hz since rev. 1.6
    made = driver()
    assert made.rate_hz == 1000.0
    assert made.values['accelerometer_range'] == 16.0
    codes = {f.name: f.encode(v) for f, v in made.assignments().items() if isinstance(f, Field)}
    assert codes['accelerometer_range'] == 3
    assert codes['accelerometer_bandwidth'] == 7  # both revisions agree on this code
    assert codes['sample_rate'] == 0


def test_every_divider_of_the_sheet_is_a_rate():
    for divider in range(256):
        made = driver(rate_hz=round(1000.0 / (1 + divider), 3))
        given = {field.name: field.encode(value) for field, value in made.assignments().items()}
        assert given['sample_rate'] == divider
        assert made.rate_hz == pytest.approx(1000.0 / (1 + divider), rel=2e-4)


@pytest.mark.parametrize(
    ('name', 'value', 'allowed'),
    [
        ('rate_hz', 740.0, '1000, 500, 333.333, .*3.906 Hz; nearest 500 and 1000'),
        ('accelerometer_range', 3.0, '2, 4, 8, 16 g'),
        ('accelerometer_bandwidth', 460.0, '420, 218.1, 99'),
        ('gyroscope_range', 300.0, '250, 500, 1000, 2000 °/s'),
        ('gyroscope_bandwidth', 250.0, '184, 92, 41, 20, 10, 5 Hz'),
        ('magnetometer_rate_hz', 50.0, '0, 8, 100 Hz'),
    ],
)
def test_what_the_datasheet_does_not_have_is_refused(name, value, allowed):
    with pytest.raises(ConfigError, match=f'{name}.*{allowed}'):
        driver(**{name: value})


@pytest.mark.parametrize(
    ('settings', 'period'),
    [
        ({'magnetometer_rate_hz': 0.0}, 0.009),
        ({'magnetometer_rate_hz': 100.0}, 0.00575),  # behind the master: 22 bytes per sample
        ({'rate_hz': 4.0, 'magnetometer_rate_hz': 0.0}, 0.25),
    ],
)
def test_the_fifo_never_fills_beyond_a_quarter_between_polls(settings, period):
    assert driver(**settings).poll_period_s == pytest.approx(period)


def test_a_polled_magnetometer_is_looked_at_more_often_than_it_measures():
    assert driver(magnetometer=()).poll_period_s == pytest.approx(0.007)
    assert driver(magnetometer=()).rates_hz == {'magnetic_field': 100.0}
    assert driver(magnetometer_rate_hz=0.0).rates_hz == {}


def test_the_magnetometer_is_behind_the_chips_own_master_unless_told_otherwise():
    """Two of them on one bus would both answer at 0x0C."""
    wires = {'': ScriptedRegisters([]), 'magnetometer': ScriptedRegisters([])}
    behind = Mpu9250(wires, SimulatedClock(), {}).registers
    assert 'auxiliary 0x0C' in behind.where(Mpu9250.WIA)
    beside = Mpu9250(wires, SimulatedClock(), {'magnetometer_bypass': True}).registers
    assert 'auxiliary' not in beside.where(Mpu9250.WIA)


def test_an_mpu_6500_will_do_where_no_magnetometer_is_asked_for():
    who = ('read', 0x75, 1), b'\x70'
    assert driver([who], magnetometer_rate_hz=0.0).identify() == 'MPU-6500'
    with pytest.raises(IdentityError, match=r'MPU-6500.*magnetometer_rate_hz: 0.0 does without'):
        driver([who]).identify()


# --- reading -----------------------------------------------------------------------------
FRAME = bytes.fromhex('0000 0000 0800 0D0B 00A4 0000 FF5C')
SOUND = [(('read', 0x3A, 1), b'\x01'), (('read', 0x6A, 2), b'\x40\x01')]


def running(*steps, magnetometer=None):
    """Return a driver without magnetometer that believes that the stream runs."""
    rate = 0.0 if magnetometer is None else 100.0
    made = driver(steps, magnetometer, magnetometer_rate_hz=rate)
    made.configured = True
    return made


def burst(frames, tail=SOUND, extra=0):
    size = len(FRAME) * frames
    return [
        (('read', 0x72, 2), (size + extra).to_bytes(2, 'big')),
        (('read', 0x74, size), FRAME * frames),
        *tail,
    ]


def test_a_burst_is_decoded_and_stamped_backwards_from_the_count():
    made = running(*burst(3, extra=5))
    (run,) = made.read()
    now = made.clock.now_ns()
    assert run.stamps.tolist() == [now - 2_000_000, now - 1_000_000, now]
    np.testing.assert_allclose(run.acceleration, [[0, 0, 9.80665]] * 3)
    np.testing.assert_allclose(run.angular_velocity[0], [0.174533, 0, -0.174533], atol=1e-6)
    np.testing.assert_allclose(run.temperature, 31.0, atol=0.01)
    assert made.continuity == 0


def test_less_than_a_frame_is_left_where_it_is():
    made = running((('read', 0x72, 2), b'\x00\x0d'), *SOUND)
    assert made.read() == []


def test_saturated_samples_are_counted_and_kept():
    frame = bytes.fromhex('7FFF 8000 0800 0D0B 00A4 0000 FF5C')
    steps = [(('read', 0x72, 2), b'\x00\x1c'), (('read', 0x74, 28), frame + FRAME), *SOUND]
    made = running(*steps)
    assert len(made.read()[0]) == 2
    assert made.counters['saturated'] == 1


RESTART = [
    (('write', 0x38, b'\x00'), b''),
    (('write', 0x23, b'\x00'), b''),
    (('read', 0x6A, 1), b'\x40'),
    (('write', 0x6A, b'\x00'), b''),
    (('read', 0x6A, 1), b'\x00'),
    (('write', 0x6A, b'\x04'), b''),
    (('read', 0x6A, 1), b'\x00'),
    (('write', 0x6A, b'\x40'), b''),
    (('read', 0x38, 1), b'\x00'),
    (('write', 0x38, b'\x11'), b''),
    (('read', 0x23, 1), b'\x00'),
    (('write', 0x23, ALL_ON), b''),
    (('read', 0x3A, 1), b'\x00'),
]


@pytest.mark.parametrize(
    'steps',
    [
        # flagged while the burst was read: the frames may be torn, nothing is delivered
        burst(2, tail=[(('read', 0x3A, 1), b'\x11'), SOUND[1]]),
        # the count says full; the flag was read by somebody else
        [(('read', 0x72, 2), b'\x02\x00'), (('read', 0x74, 504), FRAME * 36), *SOUND],
    ],
)
def test_an_overflow_resets_the_fifo_and_delivers_nothing(steps):
    made = running(*steps, *RESTART)
    assert made.read() == []
    assert made.counters['fifo_overflows'] == 1
    assert made.continuity == 1


def test_an_error_before_the_burst_costs_nothing():
    made = running((('read', 0x72, 2), NoAnswer('glitch')), *burst(2))
    with pytest.raises(NoAnswer):
        made.read()
    assert len(made.read()[0]) == 2
    assert made.continuity == 0


def test_an_impossible_count_is_an_error():
    with pytest.raises(BusError, match='FIFO_COUNT 65535 of 512'):
        running((('read', 0x72, 2), b'\xff\xff')).read()


# --- magnetometer ------------------------------------------------------------------------
def magnetic(*answers):
    """Return a driver and what it makes of what the magnetometer answers, 4 ms apart."""
    made = running(
        *((('read', 0x72, 2), b'\x00\x00'), *SOUND) * len(answers),
        magnetometer=[(('read', 0x02, 8), bytes.fromhex(answer)) for answer in answers],
    )
    made.trims['magnetic_field'] = np.array([1.1875, 1.0, 1.0])
    made._field.begin()
    runs = []
    for _ in answers:
        made.clock.sleep(0.004)
        runs += made.read()
    return made, runs


def test_the_example_of_the_magnetometer():
    made, (run,) = magnetic('01 2C01 0000 6400 10')
    np.testing.assert_allclose(run.magnetic_field, [[0, 53.4375e-6, -15e-6]])
    # ready some time between the last look and this one
    assert run.stamps.tolist() == [made.clock.now_ns() - 2_000_000]


@pytest.mark.parametrize(
    ('answer', 'counter'),
    [
        ('00 2C01 0000 6400 10', None),
        ('01 2C01 0000 6400 18', 'magnetometer_overflows'),
    ],
)
def test_old_or_overflown_fields_are_not_delivered(answer, counter):
    made, runs = magnetic(answer)
    assert runs == []
    assert {name for name, n in made.counters.items() if n} == ({counter} if counter else set())


def test_a_lost_field_is_counted_and_the_new_one_delivered():
    made, runs = magnetic('01 2C01 0000 6400 10', '03 2C01 0000 6400 10')
    assert len(runs) == 2
    assert made.counters['magnetometer_lost'] == 1


def test_what_was_overwritten_before_the_start_is_not_lost():
    made, runs = magnetic('03 2C01 0000 6400 10')
    assert len(runs) == 1
    assert made.counters['magnetometer_lost'] == 0


def test_fields_overwritten_while_nobody_looked_are_lost():
    made, _ = magnetic('01 2C01 0000 6400 10', '00 2C01 0000 6400 10')
    made.clock.sleep(0.045)
    # four of 100 Hz, of which the chip keeps the newest
    assert made._field.found(overrun=True).tolist() == [made.clock.now_ns() - 22_500_000]
    assert made._field.lost == 3


def test_a_missing_magnetometer_can_be_done_without(monkeypatch):
    made = driver(magnetometer=[(('read', 0x00, 1), NoAnswer('0x0C: nothing answers'))] * 2)
    monkeypatch.setattr(made.registers, 'run', lambda steps: None)
    with pytest.raises(NoAnswer, match=r'magnetometer_rate_hz: 0\.0 does without it'):
        made.configure_parts()
