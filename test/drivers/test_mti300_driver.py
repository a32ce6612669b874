# SPDX-License-Identifier: Apache-2.0
"""The MTi-300 driver: frames of the document, counters, flags, and what it asks of the device."""

import struct

from imu_bench.bus.scripted import ScriptedStream
from imu_bench.drivers.mti300 import Mti300
from imu_bench.errors import (
    BusError,
    ChecksumError,
    ConfigError,
    FrameError,
    IdentityError,
    NoAnswer,
    NotReady,
)
from imu_bench.registers import Field, Register
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

# MT0101P 2020.A section 5: data identifiers with their size
SHEET = {
    0x0810: 4,
    0x1020: 2,
    0x1060: 4,
    0x2010: 16,
    0x4020: 12,
    0x8020: 12,
    0xC020: 12,
    0xE020: 4,
}
GOOD = 0x03  # self-test passed, filter valid
EXAMPLE = bytes.fromhex(
    'FA FF 36 31 10 20 02 DF C5 10 60 04 00 45 9D A0 40 20 0C BE DC 9A FA 3F 54 9F 37 41 1C BB 70 '
    '80 20 0C BB AA 5C 80 3B 8C 55 01 BB 81 33 00 E0 20 04 00 00 00 81 45'
)


def message(mid, data=b''):
    body = bytes([0xFF, mid, len(data)]) + data
    return bytes([0xFA]) + body + bytes([-sum(body) & 0xFF])


def packet(identifier, data):
    return struct.pack('>HB', identifier, len(data)) + data


def frame(number, *, status=GOOD, acceleration=(0, 0, 9.81), ticks=None, **other):
    """Return MTData2 of sample `number` at 400 Hz, without using the driver's tables."""
    parts = [
        packet(0x1020, struct.pack('>H', number % 65536)),
        packet(0x1060, struct.pack('>I', number * 25 if ticks is None else ticks)),
        packet(0x2010, struct.pack('>4f', 0.5, -0.5, 0.5, 0.5)),
        packet(0x4020, struct.pack('>3f', *acceleration)),
        packet(0x8020, struct.pack('>3f', 0.1, 0, -0.1)),
    ]
    if 'field' in other:
        parts.append(packet(0xC020, struct.pack('>3f', *other['field'])))
    if 'celsius' in other:
        parts.append(packet(0x0810, struct.pack('>f', other['celsius'])))
    parts.append(packet(0xE020, struct.pack('>I', status)))
    return message(0x36, b''.join(parts))


def driver(arriving=b'', steps=(), **settings):
    made = Mti300(ScriptedStream(steps, arriving), SimulatedClock(), settings)
    made.configured = made._port._awake = True
    made._heard_ns = made.clock.now_ns()
    return made


def arrive(made, data):
    made._wires['']._arrived += data


# --- declarations ------------------------------------------------------------------------
def test_every_output_of_the_sheet_is_there():
    declared = {r.address: r.size for r in Mti300.declared(Register).values()}
    assert declared == SHEET


def test_the_status_word_has_the_bits_of_the_document():
    bits = {field.name: (field.high, field.low) for field in Mti300.declared(Field).values()}
    assert bits == {
        'self_test_passed': (0, 0),
        'filter_valid': (1, 1),
        'no_rotation': (4, 3),
        'clock_synchronised': (6, 6),
        'clipped_acceleration': (10, 8),
        'clipped_rate_of_turn': (13, 11),
        'clipped_magnetic_field': (16, 14),
        'clipped': (19, 19),
    }


def test_the_configuration_of_the_defaults():
    # 400 Hz as in Shabulinzenze 2020, table 5.2
    made = driver()
    assert made.rate_hz == 400.0
    assert [tuple(output) for output in made._outputs] == [
        (0x1020, 0xFFFF),
        (0x1060, 0xFFFF),
        (0x2010, 400),
        (0x4020, 400),
        (0x8020, 400),
        (0xC020, 100),
        (0x0810, 1),
        (0xE020, 0xFFFF),
    ]
    assert made.rates_hz == {'temperature': 1.0, 'magnetic_field': 100.0}


def test_what_is_not_wanted_is_not_asked_for():
    made = driver(rate_hz=100.0, magnetometer_rate_hz=0.0, orientation=False)
    asked = {output.identifier: output.rate for output in made._outputs}
    assert 0x2010 not in asked
    assert 0xC020 not in asked
    assert asked[0x4020] == 100
    assert made.rates_hz == {'temperature': 1.0}


@pytest.mark.parametrize(
    ('settings', 'text'),
    [
        ({'rate_hz': 300.0}, '400, 200, 100, 80'),
        ({'magnetometer_rate_hz': 200.0}, r'magnetometer_rate_hz.*100, 80'),
        ({'rate_hz': 80.0}, '100 Hz is no whole part of 80 Hz'),
        ({'baud': 115_200}, r'400 Hz need 3\d{5} baud and the line has 115200'),
        ({'baud': 9600}, '0, 115200, 230400, 460800, 921600'),
        ({'filter_profile': 'sports'}, 'general, high_mag_dep, dynamic'),
        ({'magnetic_unit': 0.0}, '1 to 100 µT'),
    ],
)
def test_what_cannot_be_is_refused(settings, text):
    with pytest.raises(ConfigError, match=text):
        driver(**settings)


def test_a_slow_line_does_for_a_slow_stream():
    assert driver(rate_hz=100.0, baud=115_200).values['baud'] == 115_200


def test_a_quarter_of_the_buffer_of_the_line_is_read_at_once():
    made = driver()
    assert 0.02 < made.poll_period_s < 0.05
    assert driver(rate_hz=1.0, magnetometer_rate_hz=1.0).poll_period_s == 0.25


# --- frames ------------------------------------------------------------------------------
def test_the_frame_of_the_document():
    made = driver(EXAMPLE, orientation=False)
    (run,) = made.read()
    np.testing.assert_allclose(run.acceleration, [[-0.430870, 0.830554, 9.795761]], atol=1e-6)
    np.testing.assert_allclose(
        run.angular_velocity, [[-0.005199015, 0.004282594, -0.003942847]], atol=1e-9
    )
    assert run.orientation is None
    # StatusWord 0x81: the orientation filter is not valid
    assert made.counters['filter_invalid'] == 1
    assert made.counters['self_test_failures'] == 0


def test_a_burst_is_stamped_with_the_clock_of_the_device():
    made = driver(b''.join(frame(k) for k in range(5)))
    (run,) = made.read()
    now = made.clock.now_ns()
    assert run.stamps.tolist() == [now - k * 2_500_000 for k in (4, 3, 2, 1, 0)]
    np.testing.assert_allclose(run.orientation, [[-0.5, 0.5, 0.5, 0.5]] * 5)
    assert made.skipped == {}


def test_on_a_serial_line_a_frame_takes_its_time():
    made = driver(frame(0), baud=460_800)
    (run,) = made.read()
    size = len(frame(0))
    late = made.clock.now_ns() - run.stamps[0]
    assert late == pytest.approx(size * 10e9 / 460_800, abs=1)


def test_field_and_temperature_come_with_the_stamp_of_their_frame():
    made = driver(
        frame(0, field=(0.4, 0, -0.9), celsius=25.5)
        + frame(1)
        + frame(2)
        + frame(3)
        + frame(4, field=(0.5, 0, -0.9)),
        magnetic_unit=40.0,
    )
    main, field, temperature = made.read()
    assert len(main) == 5
    np.testing.assert_array_equal(field.stamps, main.stamps[[0, 4]])
    np.testing.assert_allclose(field.magnetic_field[:, 0], [16e-6, 20e-6], rtol=1e-6)
    assert temperature.temperature.tolist() == [25.5]
    assert temperature.stamps[0] == main.stamps[0]


def test_missing_frames_are_counted_and_stand_between_the_runs():
    made = driver(frame(0) + frame(1) + frame(5) + frame(6) + frame(8))
    runs = made.read()
    assert [len(run) for run in runs] == [2, 2, 1]
    assert made.skipped == {1: 3, 2: 1}
    assert made.counters['lost_frames'] == 4
    assert made.continuity == 0
    arrive(made, frame(11))
    made.read()
    assert made.skipped == {0: 2}
    arrive(made, frame(12))
    made.read()
    assert made.skipped == {}


def test_frames_are_split_where_the_orientation_becomes_valid():
    made = driver(frame(0, status=1) + frame(1, status=1) + frame(2))
    first, second = made.read()
    assert (len(first), first.orientation) == (2, None)
    assert second.orientation is not None
    assert made.counters['filter_invalid'] == 2


@pytest.mark.parametrize('bit', [8, 9, 10, 11, 12, 13, 14, 15, 16, 19])
def test_clipping_is_counted_as_saturation(bit):
    made = driver(frame(0, status=GOOD | 1 << bit) + frame(1))
    made.read()
    assert made.counters['saturated'] == 1


def test_a_failed_self_test_is_counted():
    made = driver(frame(0, status=2))
    made.read()
    assert made.counters['self_test_failures'] == 1


def test_a_wrong_checksum_costs_its_frame_and_no_other():
    broken = bytearray(frame(1))
    broken[30] ^= 0x04
    made = driver(frame(0) + bytes(broken) + frame(2))
    runs = made.read()
    assert sum(map(len, runs)) == 2
    assert made.skipped == {1: 1}
    assert made.counters['checksum_errors'] == made.counters['bus_errors'] == 1
    assert made.counters['lost_frames'] == 1


@pytest.mark.parametrize(
    ('data', 'error', 'text'),
    [
        (bytes([*frame(0)[:-1], 0x55]), ChecksumError, 'wrong checksums'),
        (b'\x00' * 50, FrameError, 'no frames; check baud'),
    ],
)
def test_nothing_but_noise_is_an_error(data, error, text):
    made = driver(data)
    with pytest.raises(error, match=text):
        made.read()
    # the next frames are read as if nothing had been
    arrive(made, frame(7))
    assert len(made.read()[0]) == 1


def test_part_of_a_frame_is_kept_for_the_next_reading():
    made = driver(frame(0)[:40])
    assert made.read() == []
    arrive(made, frame(0)[40:])
    assert len(made.read()[0]) == 1
    assert not +made.counters


def test_silence_is_an_error():
    made = driver()
    assert made.read() == []
    made.clock.sleep(0.2)
    with pytest.raises(NoAnswer, match=r'no data for 0\.1 s; check plug'):
        made.read()
    assert made.counters['bus_errors'] == 1


def test_an_error_message_is_an_error():
    made = driver(frame(0) + message(0x42, b'\x1e'))
    with pytest.raises(BusError, match='0x1E, timer overflow: more data than the line carries'):
        made.read()
    # what came with it is missing in the count of frames
    arrive(made, frame(2))
    made.read()
    assert made.counters['device_errors'] == 1


def test_a_device_that_wakes_up_was_without_power():
    made = driver(frame(0) + message(0x3E))
    with pytest.raises(NotReady, match='without power'):
        made.read()
    assert made.counters['brown_outs'] == 1
    assert not made.configured


def test_counters_that_begin_anew_mean_that_the_device_did():
    made = driver(frame(1000) + frame(1001) + frame(3) + frame(4))
    (run,) = made.read()
    assert len(run) == 2
    assert run.stamps[-1] == made.clock.now_ns()
    assert made.counters['time_jumps'] == 1
    assert not made.configured


@pytest.mark.parametrize(
    'data',
    [
        message(0x36, packet(0x1020, b'\x00\x01') + packet(0x2010, bytes(16))),
        frame(0).replace(bytes.fromhex('40200c'), bytes.fromhex('40210c')),
        message(0x36, packet(0x1020, b'\x01') + packet(0x1060, bytes(4))),
    ],
)
def test_frames_of_another_configuration_are_refused(data):
    data = message(0x36, data[4:-1])
    made = driver(data)
    with pytest.raises(FrameError, match='somebody else has configured the device'):
        made.read()
    assert not made.configured


# --- conversation ------------------------------------------------------------------------
OUTPUTS = bytes.fromhex('1020FFFF 1060FFFF 20100190 40200190 80200190 C0200064 08100001 E020FFFF')
IDENTITY = [
    (message(0x30), message(0x31)),
    (message(0x1C), message(0x1D, b'MTI-300-2A8G4')),
    (message(0x00), message(0x01, b'\x03\x78\x0f\x2c')),
    (message(0x12), message(0x13, bytes([1, 8, 2]) + bytes(8))),
]


def configuration(profile):
    return [
        *IDENTITY,
        (message(0x64, bytes([0, profile])), message(0x65)),
        (message(0x64), message(0x65, bytes([0, profile]))),
        (message(0xC0, OUTPUTS), message(0xC1, OUTPUTS)),
        (message(0xC0), message(0xC1, OUTPUTS)),
    ]


CONFIGURATION = configuration(0x29)
# what an MTi-300-2A5G4 says it has: Scottapotamas/xsens-mti, docs/mtmanager_packets.md,
# fad230124c5f5eee227f3da646afbed8abfd5b10, answer 0x63
PROFILES = {
    'general': 0x27, 'high_mag_dep': 0x28, 'dynamic': 0x29, 'low_mag_dep': 0x2A,
    'vru_general': 0x2B,
}  # fmt: skip


@pytest.mark.parametrize('profile', PROFILES)
def test_the_profile_is_one_that_a_device_has_recorded_as_its_own(profile):
    made = driver(steps=configuration(PROFILES[profile]), filter_profile=profile)
    made.configure()
    made._wires[''].finish()


def test_configure_asks_sets_and_compares():
    made = driver(steps=[*CONFIGURATION, (message(0x10), message(0x11))], filter_profile='dynamic')
    made.configured = False
    made.configure()
    assert made.configured
    made.start()
    assert made.continuity == 1
    made._wires[''].finish()


def test_what_the_device_is():
    assert driver(steps=IDENTITY).identify() == 'MTI-300-2A8G4, device 03780F2C, firmware 1.8.2'


def test_another_motion_tracker_is_refused():
    steps = [*IDENTITY]
    steps[1] = (message(0x1C), message(0x1D, b'MTI-30-2A8G4'))
    with pytest.raises(IdentityError, match=r"product code 'MTI-30-2A8G4', expected MTI-300"):
        driver(steps=steps).identify()


def test_it_is_configured_again_before_the_next_reading():
    steps = [*CONFIGURATION, (message(0x10), message(0x11) + frame(0))]
    made = driver(steps=steps, filter_profile='dynamic')
    made.configured = False
    (run,) = made.read()
    assert len(run) == 1
    made._wires[''].finish()


def test_stopping_leaves_the_device_in_the_state_config():
    made = driver(steps=[(message(0x30), frame(0) + message(0x31))])
    made.stop()
    made._wires[''].finish()
    made.close()
    assert made._wires[''].closed
