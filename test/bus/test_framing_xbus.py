# SPDX-License-Identifier: Apache-2.0
"""Xbus frames: the examples of the document, cut anywhere, with anything in between."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.bus.framing.xbus import (
    BUS_IDS,
    columns,
    Decoder,
    encode,
    Message,
    Mid,
    Output,
    pack_outputs,
    unpack_outputs,
)
from imu_bench.errors import FrameError
import pytest

# MT0101P 2020.A: messages of section 4
DOCUMENT = [
    (Mid.GO_TO_CONFIG, '', 'FA FF 30 00 D1'),
    (Mid.GO_TO_MEASUREMENT, '', 'FA FF 10 00 F1'),
    (Mid.RESET, '', 'FA FF 40 00 C1'),
    (Mid.WAKE_UP_ACK, '', 'FA FF 3F 00 C2'),
    (Mid.REQ_DEVICE_ID, '', 'FA FF 00 00 01'),
    (Mid.REQ_PRODUCT_CODE, '', 'FA FF 1C 00 E5'),
    (Mid.REQ_FIRMWARE, '', 'FA FF 12 00 EF'),
    (Mid.OUTPUT_CONFIGURATION, '', 'FA FF C0 00 41'),
    (Mid.BAUD_RATE, '80', 'FA FF 18 01 80 68'),
    (
        Mid.OUTPUT_CONFIGURATION,
        '1020FFFF 1060FFFF 40200190 80200190 C0200064 E020FFFF',
        'FA FF C0 18 10 20 FF FF 10 60 FF FF 40 20 01 90 80 20 01 90 C0 20 00 64 E0 20 FF FF 29',
    ),
]
# MT0101P 2020.A, the example of MTData2
EXAMPLE = bytes.fromhex(
    'FA FF 36 31 10 20 02 DF C5 10 60 04 00 45 9D A0 40 20 0C BE DC 9A FA 3F 54 9F 37 41 1C BB 70 '
    '80 20 0C BB AA 5C 80 3B 8C 55 01 BB 81 33 00 E0 20 04 00 00 00 81 45'
)
# made by hand from the document: counter 1, 1.0 s, (0, 0, 9.81), (0.1, 0, -0.1), (0.4, 0, -0.9), 3
SYNTHETIC = bytes.fromhex(
    'FA FF 36 40 10 20 02 00 01 10 60 04 00 00 27 10 40 20 0C 00 00 00 00 00 00 00 00 41 1C F5 C3 '
    '80 20 0C 3D CC CC CD 00 00 00 00 BD CC CC CD C0 20 0C 3E CC CC CD 00 00 00 00 BF 66 66 66 '
    'E0 20 04 00 00 00 03 35'
)


@pytest.mark.parametrize(('mid', 'data', 'frame'), DOCUMENT)
def test_messages_of_the_document_both_ways(mid, data, frame):
    data, frame = bytes.fromhex(data), bytes.fromhex(frame)
    assert encode(mid, data) == frame
    assert Decoder().feed(frame) == [Message(mid, data)]


@pytest.mark.parametrize('frame', [EXAMPLE, SYNTHETIC])
@pytest.mark.parametrize('size', [1, 2, 3, 7, 53, 200])
def test_a_frame_may_arrive_in_any_pieces(frame, size):
    decoder = Decoder()
    stream = frame * 3
    found = [
        message
        for start in range(0, len(stream), size)
        for message in decoder.feed(stream[start : start + size])
    ]
    assert found == [Message(Mid.DATA, frame[4:-1])] * 3
    assert (decoder.garbage, decoder.checksum_errors, decoder.waiting) == (0, 0, 0)


def test_the_example_says_what_the_document_says():
    (message,) = Decoder().feed(EXAMPLE)
    found = columns([message.data])
    assert list(found) == [0x1020, 0x1060, 0x4020, 0x8020, 0xE020]
    assert found[0x1020].words('>u2').tolist() == [[57285]]
    assert found[0x1060].words('>u4').tolist() == [[4562336]]
    assert found[0x4020].words('>f4')[0].tolist() == pytest.approx(
        [-0.430870, 0.830554, 9.795761], abs=1e-6
    )
    assert found[0x8020].words('>f4')[0].tolist() == pytest.approx(
        [-0.005199015, 0.004282594, -0.003942847], abs=1e-9
    )
    assert found[0xE020].words('>u4').tolist() == [[0x81]]


def test_a_wrong_checksum_costs_one_frame():
    broken = bytearray(EXAMPLE)
    broken[20] ^= 0x10
    decoder = Decoder()
    assert len(decoder.feed(EXAMPLE + bytes(broken) + SYNTHETIC)) == 2
    assert decoder.checksum_errors == 1
    assert decoder.garbage == len(broken)


def test_half_a_frame_costs_no_other():
    decoder = Decoder()
    # the rest of the length is taken from the frame behind it, which is found all the same
    assert len(decoder.feed(EXAMPLE[:30] + SYNTHETIC + EXAMPLE)) == 2
    assert decoder.checksum_errors >= 1
    assert decoder.garbage == 30


def test_a_frame_whose_rest_never_comes_is_given_up():
    acknowledge = bytes.fromhex('FA FF 31 00 D0')
    decoder = Decoder()
    assert decoder.feed(EXAMPLE[:30] + acknowledge) == []
    assert decoder.give_up() == [Message(0x31)]
    assert decoder.garbage == 30
    assert decoder.waiting == 0
    assert decoder.give_up() == []


def test_preambles_inside_the_data_are_data():
    data = bytes([0xFA, 0xFF, 0x36, 0x02, 0xFA, 0xFA])
    frame = encode(Mid.DATA, data)
    assert Decoder().feed(frame) == [Message(Mid.DATA, data)]
    # seen from the middle of it, the one inside is none
    decoder = Decoder()
    assert decoder.feed(frame[1:] + EXAMPLE) == [Message(Mid.DATA, EXAMPLE[4:-1])]


@pytest.mark.parametrize('length', [0, 254, 255, 2048])
def test_long_messages_have_an_extended_length(length):
    frame = encode(Mid.DATA, bytes(length))
    assert len(frame) == length + (5 if length < 255 else 7)
    assert sum(frame[1:]) % 256 == 0
    if length >= 255:
        assert frame[3:6] == bytes([0xFF]) + length.to_bytes(2, 'big')
    assert Decoder().feed(frame) == [Message(Mid.DATA, bytes(length))]


def test_what_is_too_long_is_refused():
    with pytest.raises(FrameError, match='2049 bytes'):
        encode(Mid.DATA, bytes(2049))
    decoder = Decoder()
    decoder.feed(bytes.fromhex('FA FF 36 FF 08 01') + EXAMPLE)
    assert decoder.garbage == 6


def test_a_device_may_answer_as_number_one():
    frame = bytearray(EXAMPLE)
    frame[1], frame[-1] = 0x01, (frame[-1] + 0xFF - 0x01) & 0xFF
    assert frame[1] in BUS_IDS
    assert len(Decoder().feed(bytes(frame))) == 1
    frame[1] = 0x02
    assert Decoder().feed(bytes(frame)) == []


@given(
    st.lists(st.tuples(st.binary(max_size=40), st.binary(max_size=300)), max_size=6),
    st.integers(1, 97),
)
def test_every_byte_belongs_to_a_message_or_is_garbage(parts, size):
    stream = b''.join(noise + encode(Mid.DATA, data) for noise, data in parts)
    decoder = Decoder()
    found = [
        message
        for start in range(0, len(stream), size)
        for message in decoder.feed(stream[start : start + size])
    ]
    while decoder.waiting:
        found += decoder.give_up()
    taken = sum(len(encode(*message)) for message in found)
    assert taken + decoder.garbage == len(stream)


@given(st.lists(st.binary(max_size=60), min_size=1, max_size=5), st.integers(1, 50))
def test_without_noise_nothing_is_lost(contents, size):
    stream = b''.join(encode(Mid.DATA, data) for data in contents)
    decoder = Decoder()
    found = [
        message.data
        for start in range(0, len(stream), size)
        for message in decoder.feed(stream[start : start + size])
    ]
    assert found == contents
    assert decoder.garbage == 0


@given(st.binary(min_size=1, max_size=60), st.integers(0, 10_000))
def test_no_single_bit_error_gets_through(data, where):
    frame = bytearray(encode(Mid.DATA, data))
    where %= 8 * (len(frame) - 1)
    frame[1 + where // 8] ^= 1 << where % 8
    decoder = Decoder()
    found = decoder.feed(bytes(frame)) + decoder.give_up()
    assert Message(Mid.DATA, data) not in found


# --- packets -----------------------------------------------------------------------------
def packet(identifier, data):
    return struct.pack('>HB', identifier, len(data)) + data


def test_outputs_of_different_rates_are_sorted_out():
    payloads = [
        packet(0x1020, struct.pack('>H', k))
        + (packet(0xC020, struct.pack('>3f', k, 0, 0)) if k % 4 == 0 else b'')
        + packet(0x0999, bytes(5))
        for k in range(10)
    ]
    found = columns(payloads)
    assert found[0x1020].places.tolist() == list(range(10))
    assert found[0x1020].words('>u2')[:, 0].tolist() == list(range(10))
    assert found[0xC020].places.tolist() == [0, 4, 8]
    assert found[0xC020].words('>f4')[:, 0].tolist() == [0.0, 4.0, 8.0]


@pytest.mark.parametrize(
    ('payloads', 'text'),
    [
        ([bytes.fromhex('102002')], 'whole packets'),
        ([bytes.fromhex('10200200')], 'whole packets'),
        ([bytes.fromhex('1020020001'), bytes.fromhex('102001 00')], 'changes its size'),
    ],
)
def test_what_is_no_run_of_packets_is_an_error(payloads, text):
    with pytest.raises(FrameError, match=text):
        columns(payloads)


def test_a_size_that_does_not_fit_is_an_error():
    with pytest.raises(FrameError, match='3 bytes'):
        columns([packet(0x1020, b'abc')])[0x1020].words('>u2')


def test_outputs_both_ways():
    outputs = (Output(0x1020), Output(0x4020, 400))
    assert pack_outputs(outputs).hex() == '1020ffff40200190'
    assert unpack_outputs(pack_outputs(outputs)) == outputs
    with pytest.raises(FrameError, match='7 bytes'):
        unpack_outputs(bytes(7))
