# SPDX-License-Identifier: Apache-2.0
"""The thread that writes a bag: nothing lost, nobody waits, killed processes leave a bag."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import subprocess
import sys
import threading

from imu_bench.bags import background
from imu_bench.bags.background import BackgroundWriter
from imu_bench.bags.bag import Bag
from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
import pytest

IMU = 'sensor_msgs/msg/Imu'


def test_everything_handed_over_is_in_the_bag(tmp_path):
    writer = BackgroundWriter(BagWriter(tmp_path / 'bag'))
    writer.add_topic(describe('/imu', IMU))
    for index in range(5000):
        writer.put('/imu', index, b'message')
    writer.close()
    assert writer.counts == {'/imu': 5000}
    assert writer.dropped == writer.waiting == 0
    assert Bag(tmp_path / 'bag').counts == {'/imu': 5000}


def test_a_slow_disk_drops_and_counts_instead_of_filling_the_memory(tmp_path, monkeypatch):
    bag = BagWriter(tmp_path / 'bag')
    disk = threading.Event()
    write = bag.write
    monkeypatch.setattr(bag, 'write', lambda *message: (disk.wait(), write(*message)))
    writer = BackgroundWriter(bag, capacity=100)
    writer.add_topic(describe('/imu', IMU))
    for index in range(1000):
        writer.put('/imu', index, b'message')
    disk.set()
    writer.close()
    assert writer.dropped > 0
    assert writer.counts['/imu'] + writer.dropped == 1000


def test_a_failing_disk_is_reported_once_and_nothing_is_queued_after_it(tmp_path, monkeypatch):
    bag = BagWriter(tmp_path / 'bag')
    failed = threading.Event()

    def fail(*_message) -> None:
        failed.set()
        raise RecordingError('the disk is full')

    monkeypatch.setattr(bag, 'write', fail)
    writer = BackgroundWriter(bag)
    writer.add_topic(describe('/imu', IMU))
    writer.put('/imu', 1, b'message')
    assert failed.wait(10)
    with pytest.raises(RecordingError, match='the disk is full'):
        writer.close()
    writer.put('/imu', 2, b'message')
    assert (writer.dropped, writer.waiting) == (1, 0)


def test_the_last_moment_is_shorter_than_a_second():
    assert background.FLUSH_S + 2 * background._DRAIN_S < 1.0


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_killed_process_leaves_everything_that_was_flushed(tmp_path, storage):
    program = (
        'import sys, time\n'
        'from imu_bench.bags.background import BackgroundWriter\n'
        'from imu_bench.bags.writer import BagWriter\n'
        'from imu_bench.bags.topic_info import describe\n'
        'writer = BackgroundWriter(BagWriter(sys.argv[1], sys.argv[2]))\n'
        'writer.add_topic(describe("/imu", "sensor_msgs/msg/Imu"))\n'
        'for index in range(1000000):\n'
        '    writer.put("/imu", index, b"x" * 300)\n'
        '    if index % 50 == 0:\n'
        '        print(sum(writer.counts.values()), flush=True)\n'
        '        time.sleep(0.01)\n'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', program, str(tmp_path / 'bag'), storage],
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
    assert stamps == list(range(len(stamps)))
    assert len(stamps) >= flushed > 4000
