# SPDX-License-Identifier: Apache-2.0
"""The serial protocol of the BNO055: commands and answers of the document."""

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.bus.framing.bosch_uart import Answer, CODES, Decoder, encode_read, encode_write
from imu_bench.errors import FrameError
import pytest


def test_commands_of_the_document():
    # BST-BNO055-DS000-12 section 4.7.2
    assert encode_write(0x3D, b'\x0c').hex(' ') == 'aa 00 3d 01 0c'
    assert encode_write(0x3D, b'\x00').hex(' ') == 'aa 00 3d 01 00'
    assert encode_read(0x00, 1).hex(' ') == 'aa 01 00 01'
    assert encode_read(0x08, 0x12).hex(' ') == 'aa 01 08 12'


@pytest.mark.parametrize('length', [0, 129])
def test_commands_of_an_impossible_length_are_refused(length):
    with pytest.raises(FrameError, match=f'{length} bytes'):
        encode_read(0x08, length)
    with pytest.raises(FrameError, match=f'{length} bytes'):
        encode_write(0x08, bytes(length))


def test_answers_of_the_document():
    decoder = Decoder()
    assert decoder.feed(bytes.fromhex('bb01a0')) == [Answer(b'\xa0')]
    assert decoder.feed(bytes.fromhex('ee01')) == [Answer(code=1)]
    assert decoder.feed(bytes.fromhex('ee07')) == [Answer(code=7)]
    assert decoder.garbage == 0


def test_every_code_has_a_text():
    for code, text in CODES.items():
        assert Answer(code=code).text == f'0x{code:02X}, {text}'
    assert 'no meaning' in Answer(code=0x7F).text


@given(
    st.lists(
        st.one_of(st.binary(min_size=1, max_size=128), st.sampled_from(sorted(CODES))), max_size=5
    ),
    st.integers(1, 40),
)
def test_answers_may_arrive_in_any_pieces(contents, size):
    stream = b''.join(
        bytes([0xEE, part]) if isinstance(part, int) else bytes([0xBB, len(part)]) + part
        for part in contents
    )
    decoder = Decoder()
    found = [
        answer.code if answer.data is None else answer.data
        for start in range(0, len(stream), size)
        for answer in decoder.feed(stream[start : start + size])
    ]
    assert found == contents
    assert decoder.garbage == 0


def test_garbage_is_counted_and_skipped():
    decoder = Decoder()
    # an impossible length, an impossible code, and noise
    assert decoder.feed(bytes.fromhex('bb00 ee33 4711 bb01a0')) == [Answer(b'\xa0')]
    assert decoder.garbage == 6


def test_what_does_not_come_is_dropped():
    decoder = Decoder()
    assert decoder.feed(bytes.fromhex('bb12 0102')) == []
    decoder.drop()
    assert decoder.garbage == 4
    assert decoder.feed(bytes.fromhex('bb01a0')) == [Answer(b'\xa0')]
