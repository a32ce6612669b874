# SPDX-License-Identifier: Apache-2.0
"""What a killed publisher leaves in shared memory goes; what is in use stays."""

import fcntl
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

from imu_bench.nodes import processes
import pytest

PUBLISHER = """
import rclpy, sys, warnings
warnings.simplefilter('ignore')
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node('publisher')
node.create_publisher(String, 'words', 10)
print('up', flush=True)
sys.stdin.read()
"""

LOCK = re.compile(r'FLOCK +ADVISORY +WRITE (\d+) [0-9a-f]+:[0-9a-f]+:(\d+) ')
"""Process and inode in a line of /proc/locks, proc(5)."""


def owned(process):
    """Return the segments of a process: those whose lock files it has locked."""
    locks = LOCK.findall(Path('/proc/locks').read_text())
    inodes = {int(inode) for owner, inode in locks if int(owner) == process.pid}
    files = processes.FOLDER.glob('fast*_*_el')
    names = {path.name.removesuffix('_el') for path in files if path.stat().st_ino in inodes}
    return {name for name in names if 'port' not in name}


@pytest.fixture
def publisher():
    """Return a function that starts a program which publishes."""
    running = []

    def start():
        process = subprocess.Popen(
            [sys.executable, '-c', PUBLISHER],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            # whoever has met the one that is killed may tidy up after it
            env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        )  # fmt: skip
        running.append(process)
        assert process.stdout.readline() == 'up\n'
        return process, owned(process)

    yield start
    for process in running:
        process.kill()
        process.communicate()


def make_old(names):
    """Let lock files look as if they were there for a minute."""
    for name in names:
        for lock in processes.FOLDER.glob(f'{name}_[es]l'):
            os.utime(lock, (lock.stat().st_mtime - 60.0,) * 2)


@pytest.mark.ros
@pytest.mark.slow
def test_a_killed_publisher_leaves_nothing_and_a_living_one_keeps_everything(publisher):
    (dead, left), (living, used) = publisher(), publisher()
    assert left
    assert used
    assert not left & used
    dead.send_signal(signal.SIGKILL)
    dead.wait()
    there = {path.name for path in processes.FOLDER.iterdir()}
    assert left <= there  # nobody else has tidied up
    make_old(left | used)
    removed = processes.remove_leftovers()
    assert left <= set(removed)
    there = {path.name for path in processes.FOLDER.iterdir()}
    assert not any(name.startswith(tuple(left)) for name in there)
    assert used <= there
    assert {f'{name}_el' for name in used} <= there
    assert living.poll() is None


@pytest.fixture(params=['fastrtps', 'fastdds'])
def prefix(request):
    """Return what names begin with under Fast DDS 2 (Jazzy) and 3 (Kilted)."""
    return request.param


@pytest.fixture
def folder(tmp_path, prefix):
    """Return a folder with a segment, a port, and what looks like neither; all of them old."""
    names = [
        f'{prefix}_0123456789abcdef', f'{prefix}_0123456789abcdef_el',
        f'{prefix}_port7412', f'{prefix}_port7412_sl', f'sem.{prefix}_port7412_mutex',
        f'{prefix}_port7000', f'{prefix}_mine_el', 'my_segment_el',
    ]  # fmt: skip
    for name in names:
        (tmp_path / name).write_bytes(b'')
        os.utime(tmp_path / name, (0, 0))
    return tmp_path


def test_a_segment_and_a_port_go_with_all_that_belongs_to_them(folder, prefix):
    removed = processes.remove_leftovers(folder)
    assert sorted(removed) == [f'{prefix}_0123456789abcdef', f'{prefix}_port7412']
    assert sorted(path.name for path in folder.iterdir()) == [
        f'{prefix}_mine_el',
        f'{prefix}_port7000',
        'my_segment_el',
    ]


@pytest.mark.parametrize('how', [fcntl.LOCK_EX, fcntl.LOCK_SH])
def test_what_is_locked_stays(folder, prefix, how):
    with (folder / f'{prefix}_port7412_sl').open('rb') as file:
        fcntl.flock(file, how)
        assert processes.remove_leftovers(folder) == [f'{prefix}_0123456789abcdef']
    assert (folder / f'sem.{prefix}_port7412_mutex').exists()


def test_what_is_mapped_stays(folder, prefix):
    import mmap

    (folder / f'{prefix}_port7412').write_bytes(bytes(mmap.PAGESIZE))
    with (
        (folder / f'{prefix}_port7412').open('r+b') as file,
        mmap.mmap(file.fileno(), mmap.PAGESIZE),
    ):
        assert processes.remove_leftovers(folder) == [f'{prefix}_0123456789abcdef']


def test_what_is_young_may_not_be_locked_yet(folder, prefix):
    os.utime(folder / f'{prefix}_port7412_sl')
    assert processes.remove_leftovers(folder) == [f'{prefix}_0123456789abcdef']


def test_where_there_is_no_such_folder_there_is_nothing_to_do(tmp_path):
    assert processes.remove_leftovers(tmp_path / 'none') == []
