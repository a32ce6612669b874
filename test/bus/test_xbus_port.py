# SPDX-License-Identifier: Apache-2.0
"""Conversations with a motion tracker: acknowledges, errors, what comes in between."""

from collections import Counter

from imu_bench.bus.framing.xbus import encode, Message, Mid, Output, pack_outputs
from imu_bench.bus.scripted import ScriptedStream
from imu_bench.bus.xbus_port import MotionTracker, XbusPort
from imu_bench.errors import BusError, NoAnswer
from imu_bench.simulation.clock import SimulatedClock
import pytest

GO = bytes.fromhex('FA FF 30 00 D1')
GONE = bytes.fromhex('FA FF 31 00 D0')
DATA = encode(Mid.DATA, bytes.fromhex('1020020001'))


def port(*steps):
    counters = Counter()
    line = ScriptedStream(steps)
    return XbusPort(line, SimulatedClock(), counters), line, counters


def test_the_acknowledge_is_found_among_data():
    made, line, counters = port((GO, DATA + DATA[:4] + GONE))
    # half a frame hides the acknowledge until the line is silent
    assert made.request(Mid.GO_TO_CONFIG) == b''
    line.finish()
    assert counters['garbage_bytes'] == 4


def test_a_request_that_got_lost_is_repeated():
    made, line, _ = port((GO, b''), (GO, DATA), (GO, GONE))
    assert made.request(Mid.GO_TO_CONFIG, timeout_s=0.1, tries=3) == b''
    line.finish()


def test_no_acknowledge_is_an_error_after_all_tries():
    made, line, counters = port((GO, b''), (GO, DATA))
    with pytest.raises(NoAnswer, match=r'GO_TO_CONFIG \(0x30\) in 0\.2 s; check plug'):
        made.request(Mid.GO_TO_CONFIG, timeout_s=0.1, tries=2)
    line.finish()
    assert counters['bus_errors'] == 1


def test_an_error_message_is_named():
    made, _, counters = port((GO, encode(Mid.ERROR, b'\x04')))
    with pytest.raises(BusError, match=r'answers GO_TO_CONFIG with error 0x04, message not valid'):
        made.request(Mid.GO_TO_CONFIG)
    assert counters['device_errors'] == 1
    assert 'not have' in str(made.error_of(Message(Mid.ERROR, b'\x99')))


def test_a_device_that_wakes_up_is_kept_from_measuring():
    waking = (GO, encode(Mid.WAKE_UP)), (encode(Mid.WAKE_UP_ACK), GONE)
    made, line, counters = port(*waking, *waking, (encode(Mid.RESET), b''), *waking)
    made.request(Mid.GO_TO_CONFIG)
    assert counters['brown_outs'] == 0  # it was just plugged in
    made.request(Mid.GO_TO_CONFIG)
    assert counters['brown_outs'] == 1
    made.send(Mid.RESET)
    made.request(Mid.GO_TO_CONFIG)
    assert counters['brown_outs'] == 1
    line.finish()


def test_what_follows_an_acknowledge_at_once_is_kept():
    made, line, _ = port((encode(Mid.GO_TO_MEASUREMENT), encode(0x11) + DATA))
    made.request(Mid.GO_TO_MEASUREMENT)
    assert made.receive() == [Message(Mid.DATA, DATA[4:-1])]
    assert made.receive() == []
    line.finish()


def test_wrong_checksums_are_counted_as_failed_transfers():
    made, line, counters = port()
    broken = bytearray(DATA)
    broken[-1] ^= 1
    line._arrived = bytes(broken) + DATA
    assert made.receive() == [Message(Mid.DATA, DATA[4:-1])]
    assert counters == {'bus_errors': 1, 'checksum_errors': 1, 'garbage_bytes': len(DATA)}


def test_a_line_that_fails_is_counted():
    class Broken(ScriptedStream):
        def read(self, timeout_s):
            raise NoAnswer('gone')

        write = read

    counters = Counter()
    made = XbusPort(Broken(()), SimulatedClock(), counters)
    for act in (made.receive, lambda: made.send(Mid.RESET)):
        with pytest.raises(NoAnswer):
            act()
    assert counters['bus_errors'] == 2


# --- settings ----------------------------------------------------------------------------
OUTPUTS = (Output(0x1020), Output(0x4020, 400))


@pytest.mark.parametrize(
    ('first', 'second'),
    [
        ((Output(0x1020), Output(0x4020, 200)), OUTPUTS),
        (OUTPUTS, (Output(0x1020), Output(0x4020, 100))),
        (OUTPUTS, OUTPUTS[:1]),
    ],
)
def test_outputs_that_the_device_changes_are_refused(first, second):
    request, acknowledge = Mid.OUTPUT_CONFIGURATION, Mid.OUTPUT_CONFIGURATION + 1
    made, _, _ = port(
        (encode(request, pack_outputs(OUTPUTS)), encode(acknowledge, pack_outputs(first))),
        (encode(request), encode(acknowledge, pack_outputs(second))),
    )
    with pytest.raises(BusError, match=r'output configuration was set to .*400.*device has'):
        MotionTracker(made, 0).set_outputs(OUTPUTS)


def test_outputs_that_are_taken_are_read_back_too():
    request, acknowledge = Mid.OUTPUT_CONFIGURATION, Mid.OUTPUT_CONFIGURATION + 1
    both = encode(acknowledge, pack_outputs(OUTPUTS))
    made, line, _ = port((encode(request, pack_outputs(OUTPUTS)), both), (encode(request), both))
    MotionTracker(made, 0).set_outputs(OUTPUTS)
    line.finish()


@pytest.mark.parametrize('held', [b'\x00\x28', b''])
def test_a_filter_profile_that_is_not_taken_is_an_error(held):
    request, acknowledge = Mid.FILTER_PROFILE, Mid.FILTER_PROFILE + 1
    made, _, _ = port(
        (encode(request, b'\x00\x27'), encode(acknowledge)),
        (encode(request), encode(acknowledge, held)),
    )
    with pytest.raises(BusError, match='filter profile was set to 39'):
        MotionTracker(made, 0).set_filter_profile(39)


def test_identity():
    made, _, _ = port(
        (encode(Mid.REQ_PRODUCT_CODE), encode(0x1D, b'MTi-300-2A8G4   \0')),
        (encode(Mid.REQ_DEVICE_ID), encode(0x01, bytes.fromhex('03780f2c'))),
        (encode(Mid.REQ_FIRMWARE), encode(0x13, bytes([1, 8, 2, *range(8)]))),
    )
    assert MotionTracker(made, 0).identity() == ('MTi-300-2A8G4', '03780F2C', '1.8.2')


def test_on_usb_a_silent_device_is_reset_and_no_speed_is_tried():
    made, line, _ = port(*[(GO, b'')] * 17, (encode(Mid.RESET), b''), (GO, GONE))
    line.baud = 'never set'
    MotionTracker(made, 0).go_to_config()
    line.finish()
    assert line.baud == 'never set'
