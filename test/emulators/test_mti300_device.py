# SPDX-License-Identifier: Apache-2.0
"""
The emulated MTi-300, talked to with bare bytes and decoded by hand.

Nothing here uses the driver's tables or the codec: frames and numbers come from the MT Low-Level
Communication Protocol, MT0101P 2020.A, so a wrong table cannot prove itself.
"""

import math
import struct

from imu_bench.emulators import create
import numpy as np
import pytest

# frames as the document prints them
GO_TO_CONFIG, IN_CONFIG = 'FAFF3000D1', 'FAFF3100D0'
GO_TO_MEASUREMENT, IN_MEASUREMENT = 'FAFF1000F1', 'FAFF1100F0'
RESET, RESET_ACK = 'FAFF4000C1', 'FAFF4100C0'
WAKE_UP, WAKE_UP_ACK = 'FAFF3E00C3', 'FAFF3F00C2'
REQ_DID, REQ_PRODUCT, REQ_FIRMWARE = 'FAFF000001', 'FAFF1C00E5', 'FAFF1200EF'
REQ_OUTPUTS = 'FAFFC00041'
SET_OUTPUTS = 'FAFFC018 1020FFFF 1060FFFF 40200190 80200190 C0200064 E020FFFF 29'
OUTPUTS_ACK = 'FAFFC118 1020FFFF 1060FFFF 40200190 80200190 C0200064 E020FFFF 28'


def checked(text):
    """Return the frame of message id, length and data, with its checksum."""
    body = b'\xff' + bytes.fromhex(text)
    return (b'\xfa' + body + bytes([-sum(body) & 0xFF])).hex()


def frames(data):
    """Return (message id, data) of each frame; every checksum has to be right."""
    found = []
    while data:
        preamble, bus, mid, length = data[:4]
        assert (preamble, bus) == (0xFA, 0xFF), data[:8].hex()
        frame, data = data[: 5 + length], data[5 + length :]
        assert sum(frame[1:]) & 0xFF == 0, frame.hex()
        found.append((mid, frame[4:-1]))
    return found


def packets(payload):
    """Return the packets of MTData2 by identifier."""
    found = {}
    while payload:
        identifier, size = struct.unpack('>HB', payload[:3])
        found[identifier] = payload[3 : 3 + size]
        payload = payload[3 + size :]
    return found


class Bare:
    """A device on a line, with nothing but bytes."""

    def __init__(self, clock, source, **options):
        self.clock = clock
        self.line = create('mti300', 'serial', source, clock, **options)['']

    def tell(self, text, wait=0.01):
        """Send a frame; return what has arrived after a while."""
        self.line.write(bytes.fromhex(text))
        self.clock.sleep(wait)
        return self.line.read(0.0)

    def hear(self, seconds):
        """Return what arrives."""
        data = b''
        end = self.clock.now_ns() + round(seconds * 1e9)
        while self.clock.now_ns() < end:
            self.clock.sleep(0.01)
            data += self.line.read(0.0)
        return data


@pytest.fixture
def awake(clock, make_source):
    """Return a device that woke up and was kept in the state config."""

    def make(options=None, **values):
        made = Bare(clock, make_source(**values), **(options or {}))
        assert made.hear(0.25).hex().upper() == WAKE_UP
        made.tell(WAKE_UP_ACK)
        return made

    return make


@pytest.fixture
def measuring(awake):
    """Return a device that measures what the document recommends for the start."""

    def make(**values):
        made = awake(**values)
        made.tell(SET_OUTPUTS)
        made.tell(GO_TO_MEASUREMENT, wait=0.0)
        return made

    return make


# --- states ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ('request_', 'answer'),
    [
        (GO_TO_CONFIG, IN_CONFIG),
        (REQ_DID, 'FAFF010403780F2C46'),
        (SET_OUTPUTS, OUTPUTS_ACK),
        ('FAFF18018068', 'FAFF1900E8'),  # SetBaudrate 921600, example of the document
        ('FAFF64020027 74', 'FAFF65009C'),  # SetFilterProfile 39
    ],
)
def test_answers_in_the_state_config(awake, request_, answer):
    assert awake().tell(request_) == bytes.fromhex(answer)


def test_who_it_is(awake):
    made = awake()
    assert frames(made.tell(REQ_PRODUCT)) == [(0x1D, b'MTI-300-2A8G4')]
    ((mid, firmware),) = frames(made.tell(REQ_FIRMWARE))
    assert (mid, len(firmware)) == (0x13, 11)


def test_a_device_nobody_greets_measures_its_default_outputs(clock, make_source):
    made = Bare(clock, make_source())
    data = made.hear(2.0)
    assert data[:5].hex().upper() == WAKE_UP
    found = frames(data)[1:]
    assert {mid for mid, _ in found} == {0x36}
    # quaternion, counter, time and status at 100 Hz, 0.5 s after it woke up
    assert len(found) == pytest.approx((2.0 - 0.2 - 0.5) * 100, abs=3)
    assert set(packets(found[0][1])) == {0x1020, 0x1060, 0x2010, 0xE020}


@pytest.mark.parametrize('request_', [SET_OUTPUTS, REQ_OUTPUTS, REQ_DID, 'FAFF18018068'])
def test_what_is_for_the_state_config_is_an_error_in_measurement(measuring, request_):
    found = frames(measuring().tell(request_))
    assert (0x42, b'\x04') in found


def test_config_can_be_reached_from_everywhere(measuring):
    made = measuring()
    assert made.tell(GO_TO_CONFIG, wait=0.05).endswith(bytes.fromhex(IN_CONFIG))
    assert made.hear(0.1) == b''
    assert made.tell(GO_TO_CONFIG) == bytes.fromhex(IN_CONFIG)
    assert made.tell(GO_TO_MEASUREMENT, wait=0.001)[:5] == bytes.fromhex(IN_MEASUREMENT)


def test_a_reset_is_acknowledged_and_the_device_wakes_up(awake):
    made = awake()
    answer = made.tell(RESET, wait=0.3).hex().upper()
    assert answer == RESET_ACK + WAKE_UP


@pytest.mark.parametrize(
    ('request_', 'code'),
    [
        ('6402 0001', '21'),  # a filter profile that there is not
        ('C004 10210190', '21'),  # an output that there is not
        ('C004 40200000', '21'),  # at no rate
        ('1801 77', '20'),  # a speed that there is not
    ],
)
def test_values_that_cannot_be_are_refused(awake, request_, code):
    assert frames(awake().tell(checked(request_))) == [(0x42, bytes.fromhex(code))]


def test_frames_with_a_wrong_checksum_are_not_obeyed(awake):
    assert awake().tell('FAFF3000D2') == b''


def test_rates_that_cannot_be_are_lowered_and_acknowledged_so(awake):
    made = awake()
    # 1000 Hz of acceleration, 400 Hz of the magnetic field, 300 Hz of rate of turn
    ((mid, data),) = frames(made.tell(checked('C00C 402003E8 C0200190 8020012C')))
    assert mid == 0xC1
    assert struct.unpack('>6H', data) == (0x4020, 400, 0xC020, 100, 0x8020, 200)


# --- measurement -------------------------------------------------------------------------
def test_every_output_has_its_rate_and_the_counters_run(measuring):
    made = measuring(acceleration=(0.0, 0.0, 9.81), angular_velocity=(0.1, 0.0, -0.1))
    ack, *found = frames(made.hear(1.0))
    assert ack == (0x11, b'')
    found = [packets(data) for mid, data in found if mid == 0x36]
    assert len(found) == pytest.approx(400, abs=5)
    counters = [int.from_bytes(one[0x1020], 'big') for one in found]
    ticks = [int.from_bytes(one[0x1060], 'big') for one in found]
    assert set(np.diff(counters)) == {1}
    assert set(np.diff(ticks)) == {25}  # 10 kHz
    fields = [k for k, one in enumerate(found) if 0xC020 in one]
    assert set(np.diff(fields)) == {4}
    one = found[fields[-1]]
    assert struct.unpack('>3f', one[0x4020]) == pytest.approx((0, 0, 9.81))
    assert struct.unpack('>3f', one[0x8020]) == pytest.approx((0.1, 0, -0.1))
    # 20 µT and -40 µT where 49 µT are 1
    assert struct.unpack('>3f', one[0xC020]) == pytest.approx((20 / 49, 0, -40 / 49), rel=1e-6)
    assert one[0xE020] == bytes.fromhex('00000003')


def test_the_orientation_is_from_the_sensor_to_east_north_and_up(awake):
    # x points north: 90° from east about z
    made = awake(acceleration=(0.0, 0.0, 9.81), magnetic_field=(20e-6, 0.0, -40e-6))
    made.tell(GO_TO_MEASUREMENT, wait=0.0)
    *_, (mid, last) = frames(made.hear(3.0))
    assert mid == 0x36
    w, x, y, z = struct.unpack('>4f', packets(last)[0x2010])
    assert (w, x, y, z) == pytest.approx((math.sqrt(0.5), 0, 0, math.sqrt(0.5)), abs=1e-6)


@pytest.mark.parametrize(
    ('values', 'bits'),
    [
        ({'acceleration': (0.0, 0.0, 250.0)}, 1 << 10 | 1 << 19),
        ({'angular_velocity': (-10.0, 0.0, 0.0)}, 1 << 11 | 1 << 19),
        ({'magnetic_field': (0.0, 1e-3, 0.0)}, 1 << 15 | 1 << 19),
    ],
)
def test_clipping_is_in_the_status_word(measuring, values, bits):
    made = measuring(**values)
    *_, (_, last) = frames(made.hear(0.3))
    found = packets(last)
    assert int.from_bytes(found[0xE020], 'big') == 0x03 | bits
    if 'acceleration' in values:
        assert struct.unpack('>3f', found[0x4020])[2] == pytest.approx(200.0)


def test_the_orientation_is_not_valid_at_first(awake, clock):
    made = awake()
    made.tell(RESET, wait=0.0)
    made.hear(0.25)
    made.tell(WAKE_UP_ACK, wait=0.0)
    made.tell(GO_TO_MEASUREMENT, wait=0.0)
    found = [packets(data) for mid, data in frames(made.hear(0.3)) if mid == 0x36]
    valid = [int.from_bytes(one[0xE020], 'big') >> 1 & 1 for one in found]
    assert valid == sorted(valid)
    assert set(valid) == {0, 1}


def test_the_time_begins_anew_after_a_day_and_the_counter_after_65536(measuring):
    made = measuring()
    device = made.line.chip
    made.hear(0.1)
    device._source.rewind()
    device._sent.state = 864_000_000 // 25 - 3, 65534
    found = [packets(data) for _, data in frames(made.hear(0.1))]
    ticks = [int.from_bytes(one[0x1060], 'big') for one in found]
    counters = [int.from_bytes(one[0x1020], 'big') for one in found]
    place = ticks.index(0)
    assert ticks[place - 1 : place + 2] == [864_000_000 - 25, 0, 25]
    assert [k for k in counters if k < 2] == [0, 1]


# --- the line ----------------------------------------------------------------------------
def test_usb_carries_everything_in_frames_of_a_millisecond(measuring, clock):
    made = measuring()
    clock.sleep(0.1)
    made.line.read(0.0)
    arrivals = []
    for _ in range(2000):
        clock.sleep(20e-6)
        if made.line.read(0.0):
            arrivals.append(clock.now_ns() % 1_000_000)
    assert arrivals
    assert max(arrivals) <= 20_000


def test_a_serial_line_that_is_too_slow_loses_whole_frames(awake):
    made = awake(options={'baud': 115_200})
    made.tell(SET_OUTPUTS, wait=0.02)
    made.tell(GO_TO_MEASUREMENT, wait=0.0)
    data = made.hear(2.0)
    # 11520 bytes per second; whatever arrives is whole, but for the last
    assert len(data) == pytest.approx(2 * 11520, rel=0.02)
    whole = [(mid, part) for mid, part in frames(data[: data.rindex(b'\xfa\xff\x36')])]
    counters = [int.from_bytes(packets(part)[0x1020], 'big') for mid, part in whole if mid == 0x36]
    assert 300 < len(counters) < 420
    assert max(np.diff(counters)) > 1


def test_a_new_speed_is_used_after_a_reset(awake):
    made = awake(options={'baud': 115_200})
    made.tell(checked('1801 00'))  # 460800
    assert made.tell(GO_TO_CONFIG) == bytes.fromhex(IN_CONFIG)
    made.tell(RESET, wait=0.1)
    assert WAKE_UP.lower() not in made.hear(0.2).hex()
    made.line.baud = 460_800
    assert made.tell(GO_TO_CONFIG) == bytes.fromhex(IN_CONFIG)


def test_what_nobody_reads_is_lost_when_the_computer_holds_4095_bytes(measuring, clock):
    made = measuring()
    clock.sleep(1.0)
    assert len(made.line.read(0.0)) == 4095
