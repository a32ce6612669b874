# SPDX-License-Identifier: Apache-2.0
"""Wire recordings as they are made and played: errors kept, disks that fail, the pace."""

import errno
import zlib

from imu_bench.bus.claim import ChipInUse
from imu_bench.bus.recording import Player, read_head, Recorder
from imu_bench.bus.recording import recorder as recording
from imu_bench.bus.scripted import ScriptedStream
from imu_bench.errors import BusBusy, BusError, NoAnswer, RecordingError, RecordingOver
from imu_bench.simulation.clock import SimulatedClock
import pytest

START_NS = 1_700_000_000_000_000_000
WORD = ('read', 0x75, 1), b'\x71'


def test_a_recording_comes_to_its_end(path, play):
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


# --- recording ---------------------------------------------------------------------------
def test_nothing_is_overwritten(tmp_path, recorder_of):
    for name in ('a.wire', 'a-2.wire', 'a-3.wire'):
        recorder = recorder_of(tmp_path / 'a.wire', [WORD])
        recorder.wires[''].read(0x75, 1)
        recorder.finish()
        assert (tmp_path / name).is_file()
        assert str(tmp_path / name) in recorder.said


def test_two_that_begin_at_the_same_moment_get_two_files(tmp_path, monkeypatch, recorder_of):
    monkeypatch.setattr('pathlib.Path.exists', lambda path: False)  # the other was not there yet
    for name in ('a.wire', 'a-2.wire'):
        recorder = recorder_of(tmp_path / 'a.wire', [WORD])
        recorder.wires[''].read(0x75, 1)
        recorder.finish()
        assert (tmp_path / name).is_file()


def test_a_file_that_cannot_be_made_is_one_line(tmp_path, recorder_of):
    with pytest.raises(RecordingError, match=r'no/a\.wire: No such file or directory; name'):
        recorder_of(tmp_path / 'no' / 'a.wire', [])


def test_while_nobody_answers_nothing_is_kept(tmp_path, recorder_of):
    recorder = recorder_of(tmp_path / 'a.wire', [(WORD[0], ChipInUse('process 7 uses it'))])
    with pytest.raises(ChipInUse):
        recorder.wires[''].read(0x75, 1)
    recorder.finish()
    assert not list(tmp_path.iterdir())


def test_errors_keep_their_name_or_that_of_the_nearest(tmp_path, recorder_of):
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


def test_an_error_of_a_later_version_is_one_line(tmp_path, monkeypatch, recorder_of):
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


def test_a_disk_that_is_full_ends_the_recording_and_not_the_sensor(
    tmp_path, monkeypatch, recorder_of
):
    def full(self, file, data):
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(recording.BlockWriter, '_write', full)
    clock = SimulatedClock()
    recorder = recorder_of(tmp_path / 'a.wire', [WORD] * 3, clock)
    for _ in range(3):
        recorder.now_ns()
        assert recorder.wires[''].read(0x75, 1) == b'\x71'
        recorder.sleep(2.0)
    recorder.finish()
    assert recorder.problem.endswith('a.wire: ends early, No space left on device')


def test_a_disk_that_is_slow_does_not_hold_up_the_sensor(tmp_path, monkeypatch, play, recorder_of):
    clock = SimulatedClock(START_NS)
    recorder = recorder_of(tmp_path / 'a.wire', [WORD] * 9, clock)
    for k in range(9):
        # as if as many waited as may
        monkeypatch.setattr(recording, 'MOST_WAITING', 256 if k < 5 else -1)
        recorder.now_ns()
        assert recorder.wires[''].read(0x75, 1) == b'\x71'
        recorder.sleep(2.0)
    recorder.finish()
    assert 'the disk does not keep up' in recorder.problem
    readings, error = play(tmp_path / 'a.wire')
    assert 0 < readings < 9
    assert 'cut off there' in str(error)


def test_a_block_is_bounded(tmp_path, recorder_of):
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
def test_it_plays_as_fast_as_it_was(path, play):
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


def test_a_long_pause_is_cut_and_who_is_late_does_not_race(tmp_path, recorder_of):
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
