# SPDX-License-Identifier: Apache-2.0
"""Blocks of messages: there and back, what others read in them, and what damage does."""

from hypothesis import given, settings
from hypothesis import strategies as st
from msg_conversions import blocks
from msg_conversions.blocks import Part
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import get_typestore, Stores
from std_msgs.msg import UInt8MultiArray

STORE = get_typestore(Stores.ROS2_JAZZY)

ROWS = st.tuples(st.integers(0, 5), st.integers(1, 40), st.randoms(use_true_random=False)).map(
    lambda of: np.frombuffer(of[2].randbytes(of[0] * of[1]), np.uint8).reshape(of[0], of[1])
)
PARTS = st.lists(
    st.builds(
        Part,
        st.text(max_size=40),
        st.integers(0, 2**64 - 1),
        st.integers(-(2**63), 2**63 - 1),
        ROWS,
    ),
    max_size=5,
)
NUMBERS = st.integers(0, 2**64 - 1)


def rows(*texts):
    return np.frombuffer(b''.join(texts), np.uint8).reshape(len(texts), -1)


def same(found, publisher, parts):
    assert found.publisher == publisher
    assert [part[:3] for part in found.parts] == [part[:3] for part in parts]
    for ours, theirs in zip(found.parts, parts, strict=True):
        assert ours.messages.dtype == np.uint8
        assert np.array_equal(ours.messages, theirs.messages)


@pytest.mark.slow
@given(NUMBERS, PARTS)
@settings(max_examples=200)
def test_a_block_comes_back_as_it_was(publisher, parts):
    same(blocks.decode(blocks.encode(publisher, parts)), publisher, parts)


@pytest.mark.slow
@given(NUMBERS, PARTS)
@settings(max_examples=50)
def test_rosbags_reads_and_writes_the_same_message(publisher, parts):
    data = blocks.encode(publisher, parts)
    message = STORE.deserialize_cdr(data, blocks.TYPE)
    assert message.layout.dim == []
    assert message.layout.data_offset == 0
    assert message.data.tobytes()[:4] == b'IBB1'
    assert bytes(STORE.serialize_cdr(message, blocks.TYPE)) == data


@pytest.mark.parametrize('size', [1, 2, 3, 4])
def test_what_rclpy_writes_is_read_whatever_it_pads(size):
    parts = [Part('imu/data_raw', 3, 4, rows(b'a' * size))]
    data = blocks.encode(9, parts)
    message = deserialize_message(data, UInt8MultiArray)
    assert isinstance(message, UInt8MultiArray)
    same(blocks.decode(serialize_message(message)), 9, parts)


def test_the_layout_is_the_one_described():
    data = blocks.encode(0x1122, [Part('ab', 5, -1, rows(b'xyz', b'uvw'))])
    expected = '49424231 2211000000000000 01000000 0200 6162 0500000000000000 ffffffffffffffff'
    expected += '02000000 03000000 78797a 757677'
    assert data[16:].hex() == expected.replace(' ', '')


GOOD = blocks.encode(
    7, [Part('imu/data_raw', 40, 50, rows(b'one', b'two')), Part('t', 1, 2, rows(b'x'))]
)


@pytest.mark.parametrize('length', range(len(GOOD)))
def test_a_block_cut_anywhere_is_refused(length):
    with pytest.raises(ValueError, match=r'^not a block of messages: '):
        blocks.decode(GOOD[:length])


@pytest.mark.slow
@given(st.data())
@settings(max_examples=500)
def test_damage_is_refused_or_gives_rows_that_lie_in_the_message(data):
    damaged = bytearray(GOOD)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(GOOD) - 1))] = data.draw(st.integers(0, 255))
    try:
        found = blocks.decode(bytes(damaged))
    except ValueError as error:
        assert str(error).startswith('not a block of messages: ')
        assert '\n' not in str(error)
    else:
        assert sum(part.messages.size for part in found.parts) <= len(GOOD)


def test_a_million_messages_of_nothing_are_refused():
    none = blocks.encode(7, [Part('t', 1, 2, np.empty((10**6, 0), np.uint8))])
    with pytest.raises(ValueError, match='part 0 has messages of no bytes'):
        blocks.decode(none)


@pytest.mark.parametrize(
    ('publisher', 'part'),
    [
        (2**64, Part('t', 0, 0, rows(b'x'))),
        (-1, Part('t', 0, 0, rows(b'x'))),
        (1, Part('t' * 2**16, 0, 0, rows(b'x'))),
        (1, Part('t', -1, 0, rows(b'x'))),
        (1, Part('t', 0, 2**63, rows(b'x'))),
        (1, Part('t', 0, 0, rows(b'x')[0])),
        (1, Part('t', 0, 0, rows(b'xxxx').view(np.uint32))),
    ],
)
def test_what_does_not_fit_is_refused(publisher, part):
    with pytest.raises(ValueError, match=r'cannot hold|must be rows of uint8'):
        blocks.encode(publisher, [part])


def test_many_rows_are_a_view_of_what_came():
    data = blocks.encode(7, [Part('t', 1, 2, np.zeros((1000, 324), np.uint8))])
    messages = blocks.decode(data).parts[0].messages
    assert np.shares_memory(messages, np.frombuffer(data, np.uint8))
