# SPDX-License-Identifier: Apache-2.0
"""The thread that writes a bag: nothing lost, nobody waits, killed processes leave a bag."""

from __future__ import annotations

import errno
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

from imu_bench.bags import background
from imu_bench.bags.background import BackgroundWriter
from imu_bench.bags.bag import Bag
from imu_bench.bags.mcap_writer import McapWriter
from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
import numpy as np
import pytest
from rosbags.rosbag2 import Reader

IMU = 'sensor_msgs/msg/Imu'
PATIENCE_S = 300.0
LENGTH = 100


def messages(first: int, count: int, length: int = LENGTH):
    """Return stamps and rows that begin with the number of the message."""
    stamps = np.arange(first, first + count)
    rows = np.zeros((count, length), np.uint8)
    rows[:, :8] = stamps[:, None].view(np.uint8)
    return stamps, rows


def put(writer: BackgroundWriter, topic: str, total: int, each: int = 100) -> None:
    for first in range(0, total, each):
        writer.put(topic, *messages(first, each))


def numbers(bag: Path, topic: str = '/imu') -> list[int]:
    """Return the numbers of the messages, read by rosbags, in the order of their stamps."""
    with Reader(bag) as reader:
        found = [
            (stamp, int.from_bytes(data[:8], 'little'))
            for connection, stamp, data in reader.messages()
            if connection.topic == topic
        ]
    assert all(stamp == number for stamp, number in found)
    return [number for _, number in found]


def in_file_order(bag: Path) -> list[int]:
    found = Bag(bag)
    assert found.problems == []
    return [int(stamp) for block in found.blocks(['/imu']) for stamp in block.receive_ns]


def eventually(happened) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.01)


class SlowDisk:
    """Stands between a bag and its disk until it is let go."""

    def __init__(self, monkeypatch, bag: BagWriter) -> None:
        self.free = threading.Event()
        self._write = bag.write_many
        monkeypatch.setattr(bag, 'write_many', self._wait)

    def _wait(self, *batch) -> None:
        assert self.free.wait(PATIENCE_S)
        self._write(*batch)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_everything_handed_over_is_in_the_bag(tmp_path, storage):
    writer = BackgroundWriter(BagWriter(tmp_path / 'bag', storage))
    writer.add_topic(describe('/imu', IMU))
    writer.add_topic(describe('/silent', IMU))
    put(writer, '/imu', 5000)
    writer.close()
    assert writer.counts == {'/imu': 5000, '/silent': 0}
    assert writer.dropped == writer.waiting == 0
    assert numbers(tmp_path / 'bag') == list(range(5000))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_what_memory_cannot_hold_waits_beside_the_bag_and_is_folded_in(
    tmp_path, monkeypatch, storage
):
    monkeypatch.setattr(background, 'FILE_SIZE', 50_000)
    bag = BagWriter(tmp_path / 'bag', storage)
    disk = SlowDisk(monkeypatch, bag)
    writer = BackgroundWriter(bag, memory=100_000)
    writer.add_topic(describe('/imu', IMU))
    writer.add_topic(describe('/other', IMU))
    for first in range(0, 5000, 100):
        writer.put('/imu', *messages(first, 100))
        writer.put('/other', *messages(first, 50, LENGTH + first % 300))
        writer.put('/other', *messages(first + 50, 50, LENGTH))
        eventually(lambda: len(writer._back) == 0)
    assert writer.spilled > 500_000
    assert writer.waiting >= 9900
    disk.free.set()
    eventually(lambda: writer.waiting == 0)
    assert writer.spilled == 0
    put_after = messages(5000, 100)
    writer.put('/imu', *put_after)
    writer.close()
    assert writer.dropped == 0
    assert writer.counts == {'/imu': 5100, '/other': 5000}
    assert in_file_order(tmp_path / 'bag') == list(range(5100))
    assert numbers(tmp_path / 'bag') == list(range(5100))
    assert numbers(tmp_path / 'bag', '/other') == list(range(5000))
    assert len(list((tmp_path / 'bag').iterdir())) == 2


def test_closing_folds_in_what_waits_everywhere(tmp_path, monkeypatch):
    bag = BagWriter(tmp_path / 'bag')
    disk = SlowDisk(monkeypatch, bag)
    writer = BackgroundWriter(bag, memory=100_000)
    writer.add_topic(describe('/imu', IMU))
    for first in range(0, 3000, 100):
        writer.put('/imu', *messages(first, 100))
        eventually(lambda: len(writer._back) == 0)
    assert writer.spilled
    disk.free.set()
    writer.close()
    assert in_file_order(tmp_path / 'bag') == list(range(3000))


def test_what_neither_memory_nor_disk_takes_is_dropped_and_counted(tmp_path, monkeypatch):
    bag = BagWriter(tmp_path / 'bag')
    disk = SlowDisk(monkeypatch, bag)
    write = McapWriter.write_many

    def slow(self, *batch):
        assert disk.free.wait(PATIENCE_S)
        write(self, *batch)

    monkeypatch.setattr(McapWriter, 'write_many', slow)
    writer = BackgroundWriter(bag, memory=100_000)
    writer.add_topic(describe('/imu', IMU))
    put(writer, '/imu', 10_000)
    assert writer.dropped > 0
    disk.free.set()
    writer.close()
    assert writer.counts['/imu'] + writer.dropped == 10_000
    found = in_file_order(tmp_path / 'bag')
    assert found == sorted(found)
    assert len(found) == writer.counts['/imu']


def test_a_full_disk_beside_the_bag_is_counted(tmp_path, monkeypatch):
    bag = BagWriter(tmp_path / 'bag')
    disk = SlowDisk(monkeypatch, bag)
    append = McapWriter._append

    def full(self, data):
        if f'_{background.FIRST_NUMBER}' in self.path.name and self.size > 100_000:
            raise OSError(errno.ENOSPC, 'no space left')
        append(self, data)

    monkeypatch.setattr(McapWriter, '_append', full)
    writer = BackgroundWriter(bag, memory=100_000)
    writer.add_topic(describe('/imu', IMU))
    for first in range(0, 10_000, 100):
        writer.put('/imu', *messages(first, 100))
        eventually(lambda: len(writer._back) == 0)
    disk.free.set()
    writer.close()
    assert writer.dropped > 0
    assert writer.counts['/imu'] + writer.dropped == 10_000
    assert len(in_file_order(tmp_path / 'bag')) == writer.counts['/imu']


def test_a_message_larger_than_the_memory_gets_through(tmp_path):
    writer = BackgroundWriter(BagWriter(tmp_path / 'bag'), memory=1000)
    writer.add_topic(describe('/imu', IMU))
    writer.put('/imu', *messages(0, 1, 5000))
    writer.close()
    assert (writer.counts, writer.dropped) == ({'/imu': 1}, 0)


def test_a_failing_disk_is_reported_once_and_nothing_is_queued_after_it(tmp_path, monkeypatch):
    bag = BagWriter(tmp_path / 'bag')
    failed = threading.Event()

    def fail(*_message) -> None:
        failed.set()
        raise RecordingError('the disk is full')

    monkeypatch.setattr(bag, 'write_many', fail)
    writer = BackgroundWriter(bag)
    writer.add_topic(describe('/imu', IMU))
    writer.put('/imu', *messages(0, 10))
    assert failed.wait(PATIENCE_S)
    with pytest.raises(RecordingError, match='the disk is full'):
        writer.close()
    assert writer.dropped == 10
    writer.put('/imu', *messages(10, 1))
    assert (writer.dropped, writer.waiting) == (11, 0)


def test_the_last_moment_is_shorter_than_a_second():
    assert background.FLUSH_S + 2 * background._DRAIN_S < 1.0


PROGRAM = """
import sys, time
import numpy as np
from imu_bench.bags.background import BackgroundWriter
from imu_bench.bags.writer import BagWriter
from imu_bench.bags.topic_info import describe
bag = BagWriter(sys.argv[1], sys.argv[2])
stuck = len(sys.argv) > 3
if stuck:
    bag.write_many = lambda *batch: time.sleep(1000)
writer = BackgroundWriter(bag, memory=200_000 if stuck else 2**26)
writer.add_topic(describe('/imu', 'sensor_msgs/msg/Imu'))
for first in range(0, 10**6, 50):
    writer.put('/imu', np.arange(first, first + 50), np.zeros((50, 300), np.uint8))
    print(sum(writer.counts.values()) + writer._spill.messages, flush=True)
    time.sleep(0.01)
"""


@pytest.mark.parametrize('stuck', [(), ('stuck',)])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_killed_process_leaves_everything_that_was_on_the_disk(tmp_path, storage, stuck):
    process = subprocess.Popen(
        [sys.executable, '-c', PROGRAM, str(tmp_path / 'bag'), storage, *stuck],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    flushed = 0
    with process:
        for line in process.stdout or ():
            flushed = int(line)
            if flushed > 4000:
                os.kill(process.pid, signal.SIGKILL)
                break
    bag = Bag(tmp_path / 'bag')
    assert any('no metadata.yaml' in problem for problem in bag.problems)
    stamps = [int(stamp) for block in bag.blocks(['/imu']) for stamp in block.receive_ns]
    # a writer that is stuck takes with it what was meant for it, and nothing beside the bag
    first = stamps[0]
    assert (first > 0) == bool(stuck)
    assert stamps == list(range(first, first + len(stamps)))
    assert len(stamps) >= flushed > 4000
