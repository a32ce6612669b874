# SPDX-License-Identifier: Apache-2.0
"""Wire recordings that are missing, cut off, damaged, of something else, or not what is asked."""

import re
import zlib

from imu_bench.bus.recording import Player, read_head, Recorder
from imu_bench.bus.recording import recorder as recording
from imu_bench.bus.recording.file import BLOCK, block_of
from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.errors import RecordingError, RecordingOver
from imu_bench.simulation.clock import SimulatedClock
import pytest

START_NS = 1_700_000_000_000_000_000
WORD = ('read', 0x75, 1), b'\x71'


def headed(line):
    """Return a file with such a head."""
    return b'imu_bench wire recording 1 %08x\n%s\n' % (zlib.crc32(line), line)


def split(content):
    """Return the head of a recording and its blocks; the last is the mark of the end."""
    at = content.index(b'\n', 40) + 1
    head, blocks = content[:at], []
    while at < len(content):
        end = at + BLOCK.size + BLOCK.unpack_from(content, at)[0]
        blocks.append(content[at:end])
        at = end
    return head, blocks


def test_a_file_that_is_missing_is_one_line(tmp_path):
    with pytest.raises(RecordingError, match=r'/none\.wire: No such file or directory$'):
        read_head(tmp_path / 'none.wire')


@pytest.mark.parametrize(
    ('content', 'says'),
    [
        (b'', 'no wire recording; wire_recording: FILE on backend: hardware writes one'),
        (b'\x89MCAP0\r\n' * 100, 'no wire recording'),
        (b'imu_bench wire recording 2 x\n{}\n', 'its format 2 is not 1'),
        (b'imu_bench wire recording 1 7e59b3a2\n{"driver": "mpu', 'its head cannot be read'),
        (b'imu_bench wire recording 1 00000000\n{}\n', 'its head cannot be read'),
        (headed(b'{}'), 'its head cannot be read'),
        (headed(b'[]'), 'its head cannot be read'),
        (headed(b'\xff\xfe'), 'its head cannot be read'),
    ],
)
def test_what_is_no_wire_recording_is_one_line(tmp_path, content, says):
    path = tmp_path / 'mine.wire'
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=says) as caught:
        read_head(path)
    assert '\n' not in str(caught.value)
    assert str(path) in str(caught.value)


def test_cut_off_anywhere_it_plays_what_is_whole(path, tmp_path, play):
    content = path.read_bytes()
    begins = content.index(b'\n', 40) + 1
    cut, seen = tmp_path / 'cut.wire', []
    for length in range(begins, len(content)):
        cut.write_bytes(content[:length])
        readings, error = play(cut)
        assert isinstance(error, RecordingOver)
        assert 'cut off there' in str(error)
        seen.append(readings)
    assert seen == sorted(seen)
    assert seen[0] == 0
    # all but the last second: blocks are handed over once a second
    assert len(set(seen)) >= 4
    assert seen[-1] == 40


def test_zeros_after_a_power_cut_are_no_damage(path, tmp_path, play):
    cut = tmp_path / 'cut.wire'
    cut.write_bytes(path.read_bytes()[: -BLOCK.size - 20] + bytes(4096))
    readings, error = play(cut)
    assert isinstance(error, RecordingOver)
    assert 0 < readings < 40


@pytest.mark.slow
def test_any_flipped_bit_is_noticed(path, tmp_path, play):
    content = bytearray(path.read_bytes())
    begins, ends = content.index(b'\n', 40) + 1, len(content) - BLOCK.size
    bad = tmp_path / 'bad.wire'
    for place in range(len(content)):
        for bit in (0x01, 0x10, 0x80):
            content[place] ^= bit
            bad.write_bytes(content)
            content[place] ^= bit
            readings, error = play(bad)
            text = str(error)
            assert '\n' not in text
            if place < begins:
                assert readings == 0
                assert re.search('no wire recording|its format|its head cannot be read', text)
            elif place < ends:
                assert readings < 40
                assert 'damaged at byte' in text
            else:  # where the mark of the end should be is none
                assert readings == 40
                assert 'cut off there (12 bytes unread)' in text


@pytest.mark.parametrize('change', [lambda b: [b[0], *b[2:]], lambda b: [b[1], b[0], *b[2:]]])
def test_a_block_that_is_missing_or_in_another_place_is_noticed(path, change, play):
    head, blocks = split(path.read_bytes())
    path.write_bytes(head + b''.join(change(blocks)))
    readings, error = play(path)
    assert readings < 40
    assert 'damaged at byte' in str(error)


def test_blocks_below_another_head_are_noticed(path, play):
    head, blocks = split(path.read_bytes())
    other = head.split(b'\n')[1].replace(b'hardware x', b'hardware y')
    path.write_bytes(headed(other) + b''.join(blocks))
    readings, error = play(path)
    assert (readings, 'damaged at byte' in str(error)) == (0, True)


@pytest.mark.parametrize('events', [b'\x7f' * 40, b'\x01\x00', b'\x00\x01'])
def test_a_block_that_holds_no_events_is_one_line(path, events, play):
    head, _ = split(path.read_bytes())
    block, _ = block_of(zlib.compress(events), zlib.crc32(head))
    path.write_bytes(head + block)
    _, error = play(path)
    assert f'damaged at byte {len(head)}' in str(error)


def test_a_request_that_differs_says_where_and_what(path):
    player = Player(path, SimulatedClock())
    for _ in range(3):
        player.now_ns()
        player.wires[''].read(0x75, 1)
    player.now_ns()
    with pytest.raises(RecordingError) as caught:
        player.wires[''].write(0x6B, b'\x80')
    assert not isinstance(caught.value, RecordingOver)
    assert str(caught.value) == (
        f'{path}: event 8 at 0.300000 s: asked: write 80 to register 0x6B; recorded: read 1 bytes '
        'from register 0x75; driver or acquisition have changed since, play it with the code that '
        'recorded it'
    )
    # and it stays so
    with pytest.raises(RecordingError, match='event 8 at'):
        player.now_ns()


@pytest.mark.parametrize(
    ('part', 'request_', 'says'),
    [
        ('', ('read', 0x76, 1), 'asked: read 1 bytes from register 0x76; recorded: read 1'),
        ('', ('read', 0x75, 2), 'asked: read 2 bytes from register 0x75; recorded: read 1'),
        ('other', ('read', 0x75, 1), 'asked: read 1 bytes from register 0x75 of other; rec'),
        ('', ('write', 0x75, b'\x01'), 'asked: write 01 to register 0x75; recorded: read 1'),
    ],
)
def test_any_part_of_a_request_may_differ(tmp_path, part, request_, says):
    clock = SimulatedClock(START_NS)
    wires = {'': ScriptedRegisters([WORD]), 'other': ScriptedRegisters([])}
    recorder = Recorder(tmp_path / 'a.wire', wires, clock, 'x', {}, 'hardware x')
    recorder.wires[''].read(0x75, 1)
    recorder.finish()
    player = Player(tmp_path / 'a.wire', SimulatedClock())
    method, *arguments = request_
    with pytest.raises(RecordingError, match=says):
        getattr(player.wires[part], method)(*arguments)


def test_the_bytes_that_are_written_may_differ(tmp_path, recorder_of):
    recorder = recorder_of(tmp_path / 'a.wire', [(('write', 0x6B, b'\x80'), b'')])
    recorder.wires[''].write(0x6B, b'\x80')
    recorder.finish()
    player = Player(tmp_path / 'a.wire', SimulatedClock())
    says = 'asked: write 00 to register 0x6B; recorded: write 80 to register 0x6B'
    with pytest.raises(RecordingError, match=says):
        player.wires[''].write(0x6B, b'\x00')


def test_another_version_is_named(tmp_path, monkeypatch, recorder_of):
    monkeypatch.setattr(recording, '__version__', '7.0')
    recorder = recorder_of(tmp_path / 'mine.wire', [WORD])
    recorder.now_ns()
    recorder.wires[''].read(0x75, 1)
    recorder.finish()
    player = Player(tmp_path / 'mine.wire', SimulatedClock())
    with pytest.raises(RecordingError, match=r'recorded with imu_bench 7\..*that version'):
        player.wires[''].read(0x75, 1)
