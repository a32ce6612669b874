# SPDX-License-Identifier: Apache-2.0
"""How a node's process ends, whatever ends it: shown with small nodes of the test."""

import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.ros

NODES = """
import rclpy
from rclpy.node import Node
from imu_bench.errors import RecordingError


class Calm(Node):
    def __init__(self):
        super().__init__('calm')
        self.create_timer(0.05, self.tick)
        self.ticks = 0

    def tick(self):
        self.ticks += 1
        if self.ticks == 2:
            print('ticking', flush=True)

    def close(self):
        print('closing', rclpy.ok(), flush=True)
        # a second signal arrives here
        input()
        print('closed', flush=True)


class DiskFull(Calm):
    def tick(self):
        raise RecordingError('the disk is full')


class Broken(Calm):
    def tick(self):
        raise ZeroDivisionError('a mistake of ours')


class NotReady(Calm):
    def __init__(self):
        raise RecordingError('first line\\nsecond line')


class ShutDown(Calm):
    def tick(self):
        self.context.try_shutdown()
"""


@pytest.fixture
def run(tmp_path):
    """Start a node of this test with `spinning.run`."""
    (tmp_path / 'small_nodes.py').write_text(NODES)
    (tmp_path / 'main.py').write_text(
        'import sys\n'
        'from imu_bench.nodes.spinning import run\n'
        'name = sys.argv[1]\n'
        'sys.exit(run(f"small_nodes:{name}", args=["main"]))\n'
    )
    root = Path(__file__).resolve().parents[2]
    started = []

    def start(name):
        process = subprocess.Popen(
            [sys.executable, str(tmp_path / 'main.py'), name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, 'PYTHONPATH': f'{tmp_path}{os.pathsep}{root}'},
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_the_clean_up_survives_further_signals(run, number):
    process = run('Calm')
    assert process.stdout.readline() == 'ticking\n'
    process.send_signal(number)
    # ROS 2 is still up: last words can be published
    assert process.stdout.readline() == 'closing True\n'
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    output, errors = process.communicate('go on\n')
    assert output == 'closed\n'
    assert process.returncode == 0, errors
    assert errors == ''


def test_a_bench_error_ends_it_with_a_line_and_code_1(run):
    process = run('DiskFull')
    output, errors = process.communicate('go on\n')
    assert process.returncode == 1
    assert output.splitlines() == ['closing True', 'closed']
    assert errors.count('\n') == 1
    assert 'the disk is full' in errors


def test_a_mistake_shows_where_it_is_and_still_cleans_up(run):
    process = run('Broken')
    output, errors = process.communicate('go on\n')
    assert process.returncode == 1
    assert output.splitlines() == ['closing True', 'closed']
    assert 'ZeroDivisionError: a mistake of ours' in errors


def test_a_node_that_refuses_to_start_says_why_line_by_line(run):
    output, errors = run('NotReady').communicate()
    assert output == ''
    assert [line.rpartition(']: ')[2] for line in errors.splitlines()] == [
        'first line',
        'second line',
    ]


def test_a_shutdown_from_inside_is_a_clean_end(run):
    process = run('ShutDown')
    output, errors = process.communicate('go on\n')
    assert process.returncode == 0, errors
    assert output.splitlines() == ['closing False', 'closed']
