# SPDX-License-Identifier: Apache-2.0
"""What a recording takes from outside: a crowd on its domain, and every signal."""

from contextlib import closing, contextmanager, suppress
import os
from pathlib import Path
import re
from select import select
import shutil
import signal
import subprocess
import sys

from imu_bench.bags import metadata
from imu_bench.nodes import qos
from imu_bench.nodes.others import MOST_BESIDE
from imu_bench.offline.recordings.loading import load
from imu_bench.offline.recordings.opening import open_source
import pytest
import rosbags  # noqa: F401, without it nothing is recorded
import yaml

pytestmark = [pytest.mark.ros, pytest.mark.slow]

TOPIC = '/bench/left/imu/data_raw'

CROWD = """
import math, sys
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import Imu
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node('crowd')
many = [node.create_publisher(Imu, f'/foreign_{n}/imu/data_raw', 10) for n in range(150)]
huge = node.create_publisher(String, '/huge', 1)
node.create_subscription(String, '/huge', lambda message: None, 1)
news = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
odd = Imu()
odd.linear_acceleration.x, odd.angular_velocity.y = math.nan, math.inf
statuses = [DiagnosticStatus(name=f'/foreign: {n}') for n in range(5000)]
def heard():
    return sum(each.get_subscription_count() > 0 for each in many)

while heard() < int(sys.argv[1]) or not news.get_subscription_count():
    rclpy.spin_once(node, timeout_sec=0.1)
for _ in range(10):
    for each in many:
        each.publish(odd)
    huge.publish(String(data='x' * 20_000_000))
    news.publish(DiagnosticArray(status=statuses))
    rclpy.spin_once(node, timeout_sec=0.2)
for each in (*many, news):
    each.wait_for_all_acked()
"""


RUNS = r'^\d+:\d\d:\d\d'
RAN = r'^(?!0:00:00)\d+:\d\d:\d\d'
"""Lines of a recording that has begun, and of one that has run for a second or more."""


@contextmanager
def recording(folder, what='record', inside=()):
    """Record one sensor into `bag` of a folder; yield the process when it has begun."""
    files = folder.with_name(f'{folder.name}_files')
    files.mkdir()
    sensor, bench = files / 'left.yaml', files / 'bench.yaml'
    simulation = {'acceleration': {'noise_density': '60 µg/√Hz'}}
    parameters = {'driver': 'generic', 'backend': 'emulated', 'rate_hz': 200.0}
    document = {'/**': {'ros__parameters': {**parameters, 'simulation': simulation}}}
    sensor.write_text(yaml.safe_dump(document), encoding='utf-8')
    bench.write_text(yaml.safe_dump({'name': 'one', 'sensors': [{'file': str(sensor)}]}))
    more = ['-o', folder, '--duration', '600'] if what == 'demo' else ['-o', folder / 'bag']
    # a test that was started with nohup would hand on that SIGHUP is to be ignored
    program = ['env', '--default-signal=HUP', sys.executable, '-m', 'imu_bench.cli.main']
    command = [*inside, *program, what, bench, *more]
    with subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True, env={**os.environ, 'IMU_BENCH_LINE_EVERY_S': '0.5'},
    ) as process:  # fmt: skip
        try:
            await_line(process, RUNS)
            yield process
        finally:
            if process.poll() is None:
                process.terminate()


def await_line(process, pattern):
    for line in process.stdout:
        if re.search(pattern, line):
            return
    raise AssertionError(f'{pattern!r} was not said')


def descendants(pid):
    """Return the processes that descend from one, and it."""
    children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    return [pid, *(each for child in children for each in descendants(int(child)))]


def memory(pids):
    """Return what processes have in memory, B, shared pages by their share."""
    kib = 0
    for pid in pids:
        for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines():
            if line.startswith('Pss:'):
                kib += int(line.split()[1])
    return kib * 1024


def test_a_crowd_changes_neither_rates_nor_memory(tmp_path):
    with recording(tmp_path) as process:
        before = memory(descendants(process.pid))
        crowd = [sys.executable, '-c', CROWD, str(MOST_BESIDE)]
        subprocess.run(crowd, check=True, capture_output=True)
        # what came is on the disk when the recorder has said so again
        await_line(process, 'recorded as well, of others: ')
        for _ in range(2):
            await_line(process, RUNS)
        after = memory(descendants(process.pid))
        process.terminate()
        output, _ = process.communicate()
    assert process.returncode == 0, output
    assert re.search('left: .* kept its rate .*, nothing lost\n', output), output
    # what the middleware may hold for one subscription, that to /diagnostics
    assert after - before < qos.MEMORY
    stored = metadata.read(tmp_path / 'bag' / 'metadata.yaml').counts
    foreign = {name: number for name, number in stored.items() if name.startswith('/foreign_')}
    assert set(stored) - set(foreign) == {TOPIC, '/diagnostics'}
    assert len(foreign) == MOST_BESIDE
    own, others = output.split('recorded as well, of others:\n')
    assert 'left: ' in own
    shown = [f'{name}: {number} messages' for name, number in sorted(foreign.items())]
    lines = [line.strip() for line in others.splitlines()[:6]]
    assert lines == [*shown[:4], '46 more topics', '100 more topics, not recorded']


@pytest.mark.parametrize(
    ('what', 'number'),
    [
        ('demo', signal.SIGTERM),
        ('demo', signal.SIGHUP),
        ('demo', signal.SIGKILL),
        ('record', signal.SIGHUP),  # ends as a demo does, without an analysis
    ],
)
def test_every_signal_leaves_a_bag_that_is_read_and_no_process(tmp_path, what, number):
    with recording(tmp_path, what) as process:
        await_line(process, RAN)
        family = [os.pidfd_open(pid) for pid in descendants(process.pid)]
        process.send_signal(number)
        process.communicate()  # their logs are files: it ends with the recording itself
        for member in family:
            select([member], [], [])  # readable when the process has ended
            os.close(member)
    with closing(open_source(tmp_path / 'bag')) as source:
        assert len(load(source, TOPIC)) > 0
    finished = (tmp_path / 'bag' / 'metadata.yaml').exists()
    assert finished or number == signal.SIGKILL


SMALL = 16 << 20
"""Bytes of a disk that is soon full."""


def test_a_full_disk_ends_it_with_one_line_and_everything_up_to_it(tmp_path):
    disk = tmp_path / 'disk'
    disk.mkdir()
    inside = [
        'unshare', '--user', '--map-root-user', '--mount', 'sh', '-c',
        f'mount -t tmpfs -o size={SMALL} none {disk} && exec "$@"', 'sh',
    ]  # fmt: skip
    if subprocess.run([*inside, 'true'], capture_output=True).returncode:
        pytest.skip('namespaces are not permitted here; full disks are played in test_writer')
    with recording(disk, inside=inside) as process:
        await_line(process, RAN)
        # its own view of the disk, while somebody else takes what is left of it
        view = Path(f'/proc/{process.pid}/root{disk}')
        with suppress(OSError), (view / 'else').open('wb', buffering=0) as others:
            while True:
                others.write(bytes(1 << 16))
        held = os.open(view, os.O_RDONLY)  # the disk outlives who mounted it
        output, _ = process.communicate()
        assert process.returncode == 1, output
        (line,) = [line for line in output.splitlines() if 'disk is full' in line]
        assert line.startswith('imu-bench: error: ')
    shutil.copytree(f'/proc/self/fd/{held}/bag', tmp_path / 'kept')
    os.close(held)
    with closing(open_source(tmp_path / 'kept')) as source:
        assert len(load(source, TOPIC)) > 0
