# SPDX-License-Identifier: Apache-2.0
"""Files that are missing, cut off, damaged or of something else; disks that fail; the pace."""

import errno
import re
import zlib

from imu_bench.bus.claim import ChipInUse
from imu_bench.bus.recording import Player, read_head, Recorder, writing
from imu_bench.bus.recording import recorder as recording
from imu_bench.bus.recording.file import BLOCK, block_of
from imu_bench.bus.scripted import ScriptedRegisters, ScriptedStream
from imu_bench.errors import BusBusy, BusError, NoAnswer, RecordingError, RecordingOver
from imu_bench.simulation.clock import SimulatedClock
import pytest

START_NS = 1_700_000_000_000_000_000
WORD = ('read', 0x75, 1), b'\x71'


def recorder_of(path, steps, clock=None):
    wires = {'': ScriptedRegisters(steps)}
    return Recorder(path, wires, clock or SimulatedClock(START_NS), 'mpu9250', {}, 'hardware x')


@pytest.fixture
def path(tmp_path):
    """Give a recording of 40 readings, 100 ms apart."""
    clock = SimulatedClock(START_NS)
    recorder = recorder_of(tmp_path / 'mine.wire', [WORD] * 40, clock)
    for _ in range(40):
        recorder.now_ns()
        recorder.wires[''].read(0x75, 1)
        recorder.sleep(0.1)
    recorder.finish()
    return tmp_path / 'mine.wire'


def play(path, pace=None):
    """Return how many readings came and why there were no more."""
    readings = 0
    try:
        player = Player(path, pace or SimulatedClock())
        while True:
            player.now_ns()
            assert player.wires[''].read(0x75, 1) == b'\x71'
            readings += 1
    except RecordingError as error:
        return readings, error


def test_a_recording_comes_to_its_end(path):
    readings, error = play(path)
    assert readings == 40
    assert isinstance(error, RecordingOver)
    assert str(error) == f'{path}: over after 3.900 s, 80 events'


def test_the_head_says_what_was_recorded(path):
    head = read_head(path)
    assert (head.driver, head.label, head.begun) == (
        'mpu9250', 'hardware x', '2023-11-14T22:13:20+00:00',
    )  # fmt: skip
    # for people: two lines of text
    first, second, _ = path.read_bytes().split(b'\n', 2)
    assert first == b'imu_bench wire recording 1 %08x' % zlib.crc32(second)
    assert second.startswith(b'{"driver": "mpu9250"')


# --- bad input ---------------------------------------------------------------------------
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


def test_cut_off_anywhere_it_plays_what_is_whole(path, tmp_path):
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


def test_zeros_after_a_power_cut_are_no_damage(path, tmp_path):
    cut = tmp_path / 'cut.wire'
    cut.write_bytes(path.read_bytes()[: -BLOCK.size - 20] + bytes(4096))
    readings, error = play(cut)
    assert isinstance(error, RecordingOver)
    assert 0 < readings < 40


def test_any_flipped_bit_is_noticed(path, tmp_path):
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
def test_a_block_that_is_missing_or_in_another_place_is_noticed(path, change):
    head, blocks = split(path.read_bytes())
    path.write_bytes(head + b''.join(change(blocks)))
    readings, error = play(path)
    assert readings < 40
    assert 'damaged at byte' in str(error)


def test_blocks_below_another_head_are_noticed(path):
    head, blocks = split(path.read_bytes())
    other = head.split(b'\n')[1].replace(b'hardware x', b'hardware y')
    path.write_bytes(headed(other) + b''.join(blocks))
    readings, error = play(path)
    assert (readings, 'damaged at byte' in str(error)) == (0, True)


@pytest.mark.parametrize('events', [b'\x7f' * 40, b'\x01\x00', b'\x00\x01'])
def test_a_block_that_holds_no_events_is_one_line(path, events):
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


def test_the_bytes_that_are_written_may_differ(tmp_path):
    recorder = recorder_of(tmp_path / 'a.wire', [(('write', 0x6B, b'\x80'), b'')])
    recorder.wires[''].write(0x6B, b'\x80')
    recorder.finish()
    player = Player(tmp_path / 'a.wire', SimulatedClock())
    says = 'asked: write 00 to register 0x6B; recorded: write 80 to register 0x6B'
    with pytest.raises(RecordingError, match=says):
        player.wires[''].write(0x6B, b'\x00')


def test_another_version_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, '__version__', '7.0')
    recorder = recorder_of(tmp_path / 'mine.wire', [WORD])
    recorder.now_ns()
    recorder.wires[''].read(0x75, 1)
    recorder.finish()
    player = Player(tmp_path / 'mine.wire', SimulatedClock())
    with pytest.raises(RecordingError, match=r'recorded with imu_bench 7\..*that version'):
        player.wires[''].read(0x75, 1)


# --- recording ---------------------------------------------------------------------------
def test_nothing_is_overwritten(tmp_path):
    for name in ('a.wire', 'a-2.wire', 'a-3.wire'):
        recorder = recorder_of(tmp_path / 'a.wire', [WORD])
        recorder.wires[''].read(0x75, 1)
        recorder.finish()
        assert (tmp_path / name).is_file()
        assert str(tmp_path / name) in recorder.said


def test_two_that_begin_at_the_same_moment_get_two_files(tmp_path, monkeypatch):
    monkeypatch.setattr('pathlib.Path.exists', lambda path: False)  # the other was not there yet
    for name in ('a.wire', 'a-2.wire'):
        recorder = recorder_of(tmp_path / 'a.wire', [WORD])
        recorder.wires[''].read(0x75, 1)
        recorder.finish()
        assert (tmp_path / name).is_file()


def test_a_file_that_cannot_be_made_is_one_line(tmp_path):
    with pytest.raises(RecordingError, match=r'no/a\.wire: No such file or directory; name'):
        recorder_of(tmp_path / 'no' / 'a.wire', [])


def test_while_nobody_answers_nothing_is_kept(tmp_path):
    recorder = recorder_of(tmp_path / 'a.wire', [(WORD[0], ChipInUse('process 7 uses it'))])
    with pytest.raises(ChipInUse):
        recorder.wires[''].read(0x75, 1)
    recorder.finish()
    assert not list(tmp_path.iterdir())


def test_errors_keep_their_name_or_that_of_the_nearest(tmp_path):
    class Special(BusBusy):
        """One that nobody else knows."""

    errors = [ChipInUse('a'), NoAnswer('b\nc'), Special('d')]
    recorder = recorder_of(tmp_path / 'a.wire', [*((WORD[0], error) for error in errors), WORD])

    def found(wire):
        for _ in errors:
            with pytest.raises(BusError) as caught:
                wire.read(0x75, 1)
            yield type(caught.value).__name__, str(caught.value)
        assert wire.read(0x75, 1) == b'\x71'

    assert [name for name, _ in found(recorder.wires[''])] == ['ChipInUse', 'NoAnswer', 'Special']
    recorder.finish()
    player = Player(tmp_path / 'a.wire', SimulatedClock())
    again = list(found(player.wires['']))
    assert again == [('ChipInUse', 'a'), ('NoAnswer', 'b\nc'), ('BusBusy', 'd')]
    player.finish()


def test_an_error_of_a_later_version_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, 'packed_error', lambda error: b'New\nx')
    recorder = recorder_of(tmp_path / 'a.wire', [WORD, (WORD[0], NoAnswer('x'))])
    recorder.wires[''].read(0x75, 1)
    with pytest.raises(NoAnswer):
        recorder.wires[''].read(0x75, 1)
    recorder.finish()
    player = Player(tmp_path / 'a.wire', SimulatedClock())
    player.wires[''].read(0x75, 1)
    with pytest.raises(RecordingError, match="holds an error 'New'"):
        player.wires[''].read(0x75, 1)


def test_a_disk_that_is_full_ends_the_recording_and_not_the_sensor(tmp_path, monkeypatch):
    def full(self, file, data):
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(writing.BlockWriter, '_write', full)
    clock = SimulatedClock()
    recorder = recorder_of(tmp_path / 'a.wire', [WORD] * 3, clock)
    for _ in range(3):
        recorder.now_ns()
        assert recorder.wires[''].read(0x75, 1) == b'\x71'
        recorder.sleep(2.0)
    recorder.finish()
    assert recorder.problem.endswith('a.wire: ends early, No space left on device')


def test_a_disk_that_is_slow_does_not_hold_up_the_sensor(tmp_path, monkeypatch):
    clock = SimulatedClock(START_NS)
    recorder = recorder_of(tmp_path / 'a.wire', [WORD] * 9, clock)
    for k in range(9):
        # as if as many waited as may
        monkeypatch.setattr(writing, 'MOST_WAITING', 256 if k < 5 else -1)
        recorder.now_ns()
        assert recorder.wires[''].read(0x75, 1) == b'\x71'
        recorder.sleep(2.0)
    recorder.finish()
    assert 'the disk does not keep up' in recorder.problem
    readings, error = play(tmp_path / 'a.wire')
    assert 0 < readings < 9
    assert 'cut off there' in str(error)


def test_a_block_is_bounded(tmp_path):
    clock = SimulatedClock()
    recorder = recorder_of(tmp_path / 'a.wire', [WORD], clock)
    most = 0
    for _ in range(20_000):
        recorder.now_ns()
        most = max(most, len(recorder._block))
    recorder.finish()
    assert most <= recording.BLOCK_BYTES


def test_a_line_is_played_with_its_speed(tmp_path):
    wires = {'': ScriptedStream([(b'AT', b'OK')], arriving=b'noise')}
    recorder = Recorder(tmp_path / 'a.wire', wires, SimulatedClock(), 'x', {}, 'hardware x')

    def talk(line):
        said = [line.baud, line.read(0.1)]
        line.baud = 9600
        line.write(b'AT')
        return [*said, line.baud, line.read(1.0), line.read(1.0)]

    live = talk(recorder.wires[''])
    assert wires[''].baud == 9600
    recorder.finish()
    # how long somebody waits for bytes is not on the wire
    player = Player(tmp_path / 'a.wire', SimulatedClock())
    again = talk(player.wires[''])
    player.finish()
    assert again == live == [115200, b'noise', 9600, b'OK', b'']


# --- pace --------------------------------------------------------------------------------
def test_it_plays_as_fast_as_it_was(path):
    pace = SimulatedClock(5 * START_NS)
    play(path, pace)
    assert pace.now_ns() - 5 * START_NS == 3_900_000_000


class Times(SimulatedClock):
    """A clock that notes when it was slept."""

    def __init__(self):
        super().__init__(0)
        self.slept = []

    def sleep_until(self, deadline_ns):
        self.slept.append(deadline_ns - self.now_ns())
        super().sleep_until(deadline_ns)


def test_a_long_pause_is_cut_and_who_is_late_does_not_race(tmp_path):
    clock = SimulatedClock(START_NS)
    recorder = recorder_of(tmp_path / 'a.wire', [WORD], clock)
    recorder.wires[''].read(0x75, 1)
    for pause_s in (0.1, 3600.0, 0.1, 0.1, 0.1):
        recorder.now_ns()
        recorder.sleep(pause_s)
    recorder.finish()
    pace = Times()
    player = Player(tmp_path / 'a.wire', pace)
    player.wires[''].read(0x75, 1)
    for late_s in (0, 0, 0, 60, 0):
        pace.sleep(late_s)
        player.now_ns()
    player.finish()
    assert pace.slept == pytest.approx([0.1e9, 2e9, 0.1e9], rel=1e-6)


def test_what_was_stopped_is_played_from_the_beginning_only(path):
    player = Player(path, SimulatedClock())
    player.now_ns()
    player.finish()
    with pytest.raises(RecordingOver, match='clean up and configure'):
        player.now_ns()
