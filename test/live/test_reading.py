# SPDX-License-Identifier: Apache-2.0
"""Sensors read in a process of their own: nothing lost while we are away, and nobody held up."""

from dataclasses import replace
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading

from imu_bench import bench
from imu_bench.bus.clock import SystemClock
from imu_bench.config import sensor_from_parameters
from imu_bench.errors import ConfigError, IdentityError
from imu_bench.live.packets import Wish
from imu_bench.live.reading import LocalReading, ReaderDied, ReadingProcess
from imu_bench.live.reading_child import by_stream
from imu_bench.samples import Samples
import numpy as np
import pytest

PATIENCE_S = 300.0
RATE_HZ = 200.0


class Collected:
    """What one sensor delivered."""

    def __init__(self):
        self.runs, self.stats = [], None
        self._news = threading.Condition()

    def __call__(self, runs, stats):
        with self._news:
            self.runs += runs
            self.stats = stats
            self._news.notify_all()

    def wait(self, happened):
        with self._news:
            assert self._news.wait_for(happened, PATIENCE_S)

    @property
    def stamps(self):
        return np.concatenate([run.stamps for run in self.runs])

    def __len__(self):
        return sum(map(len, self.runs))


def wish(name='one', driver='generic', **given):
    given = {'driver': driver, 'backend': 'emulated', **given}
    if driver == 'generic':
        given = {'rate_hz': RATE_HZ, 'simulation.acceleration.noise_density': '60 µg/√Hz', **given}
    config = sensor_from_parameters(name, given, settings_of=bench.settings_of)
    return Wish(config, SystemClock())


@pytest.fixture
def process():
    made = ReadingProcess()
    yield made
    made.close()


def assert_whole(stamps):
    """Every sample of the source is there, each once and in order."""
    steps = np.diff(stamps) * 1e-9 * RATE_HZ
    assert steps.min() > 0.5
    assert steps.max() < 1.5


def test_streams_of_one_sensor_are_joined_although_they_alternate():
    runs = []
    for k in range(4):
        runs += [
            Samples([10 * k, 10 * k + 5], acceleration=np.ones((2, 3))),
            Samples([10 * k + 2], magnetic_field=np.ones((1, 3))),
        ]
    motion, field = by_stream(runs)
    assert motion.stamps.tolist() == [0, 5, 10, 15, 20, 25, 30, 35]
    assert field.stamps.tolist() == [2, 12, 22, 32]


def test_what_one_topic_carries_stays_in_order_while_its_quantities_change():
    still, turned = np.ones((1, 3)), np.ones((1, 4))
    runs = [
        Samples([1], still, orientation=turned),
        Samples([2], temperature=[20.0]),
        Samples([3], still),
        Samples([4], temperature=[21.0]),
        Samples([5], still, orientation=turned),
    ]
    found = by_stream(runs)
    assert [run.stamps.tolist() for run in found if run.acceleration is not None] == [
        [1],
        [3],
        [5],
    ]
    assert [run.stamps.tolist() for run in found if run.temperature is not None] == [[2, 4]]


@pytest.mark.slow
@pytest.mark.parametrize('where', ['here', 'there'])
def test_everything_that_was_read_is_delivered_in_order(process, where):
    found = Collected()
    reading = LocalReading(wish(), found) if where == 'here' else process.read(wish(), found)
    assert reading.prepare()
    reading.start()
    found.wait(lambda: len(found) >= 100)
    reading.stop()
    assert reading.stats.state == 'stopped'
    assert len(found) == reading.stats.samples
    assert_whole(found.stamps)
    reading.close()


@pytest.mark.slow
@pytest.mark.parametrize('every_s', [0.0, 0.05])
def test_samples_keep_coming_while_nobody_stops_the_sensor(process, every_s):
    found = Collected()
    reading = process.read(replace(wish(), every_s=every_s), found)
    reading.start()
    found.wait(lambda: len(found.runs) >= 8)
    reading.close()
    assert_whole(found.stamps)


@pytest.mark.slow
def test_two_sensors_of_one_process_do_not_mix(process):
    found = {name: Collected() for name in ('left', 'right')}
    readings = [
        process.read(wish(name, rate_hz=rate), found[name])
        for name, rate in (('left', 100.0), ('right', 300.0))
    ]
    for reading in readings:
        reading.start()
    found['left'].wait(lambda: len(found['left']) >= 50)
    for reading in readings:
        reading.close()
    for name, rate in (('left', 100.0), ('right', 300.0)):
        assert np.median(np.diff(found[name].stamps)) == pytest.approx(1e9 / rate, rel=0.02)


@pytest.mark.slow
def test_errors_come_back_as_what_they_are(process):
    with pytest.raises(ConfigError, match='nothing'):
        process.read(wish(driver='mpu9250', bus='nothing'), Collected())
    # the process goes on
    reading = process.read(wish(), Collected())
    reading.start()
    reading.close()


@pytest.mark.slow
def test_an_error_keeps_its_class_on_the_way(process):
    faults = ['wrong_identity 0 600']
    swapped = wish(driver='mpu9250', **{'simulation.faults': faults})
    reading = process.read(swapped, Collected())
    with pytest.raises(IdentityError):
        reading.prepare()
    reading.close()


AWAY = """
import os, signal, subprocess, sys, threading, time
sys.path.insert(0, {root!r})
from test_reading import *
process, found = ReadingProcess(), Collected()
reading = process.read(wish(), found)
reading.start()
found.wait(lambda: len(found) > 20)
print('running', flush=True)
sys.stdin.readline()

reading.stop()
assert_whole(found.stamps)
print(len(found), reading.stats.samples, reading.stats.lost, found.stamps[-1] - found.stamps[0],
      flush=True)
reading.close()
process.close()
"""


@pytest.mark.slow
def test_who_was_away_for_seconds_gets_everything_afterwards():
    root = str(Path(__file__).parent)
    away = subprocess.Popen(
        [sys.executable, '-c', AWAY.format(root=root)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert away.stdout.readline() == 'running\n'
        away.send_signal(signal.SIGSTOP)
        # the time it is away is what is tested
        threading.Event().wait(5.0)
        away.send_signal(signal.SIGCONT)
        output, _ = away.communicate('go on\n', timeout=PATIENCE_S)
    finally:
        away.kill()
        away.communicate()
    received, read, lost, span_ns = map(int, output.split())
    assert received == read
    assert lost == 0
    assert span_ns > 4.5e9


@pytest.mark.slow
def test_a_process_that_dies_is_said_and_the_next_sensor_gets_a_new_one(process):
    found = Collected()
    reading = process.read(wish(), found)
    reading.start()
    found.wait(lambda: len(found) > 20)
    os.kill(process.pid, signal.SIGKILL)
    found.wait(lambda: isinstance(reading.error, ReaderDied))
    assert 'SIGKILL' in str(reading.error)
    reading.close()
    again = process.read(wish(), found)
    before = len(found)
    again.start()
    found.wait(lambda: len(found) > before + 20)
    again.close()


def permitted_to_lock():
    locked = 'import ctypes; print(ctypes.CDLL(None).mlockall(5))'
    return subprocess.check_output([sys.executable, '-c', locked], text=True).strip() == '0'


@pytest.mark.slow
def test_processes_of_one_origin_read_for_themselves_and_share_its_memory(process):
    wishes = [wish('one'), wish('two')]
    processes = process.several(2, [each.sensor for each in wishes])
    found = [Collected() for _ in wishes]
    readings = [own.read(w, f) for own, w, f in zip(processes, wishes, found, strict=True)]
    for reading in readings:
        reading.start()
    for each in found:
        each.wait(lambda each=each: len(each) > 20)
    # scipy, where chips are simulated, is in one of them as in the other: 68 MB of each if not
    for own in processes:
        lines = Path(f'/proc/{own.pid}/smaps_rollup').read_text().splitlines()
        sizes = {line.split()[0]: int(line.split()[1]) for line in lines[1:]}
        assert sizes['Private_Dirty:'] < 45_000
        # nothing that they use has to be read from the disk again, where the system permits it
        status = dict(
            line.split(':', 1) for line in Path(f'/proc/{own.pid}/status').read_text().splitlines()
        )
        assert (int(status['VmLck'].split()[0]) > 0) == permitted_to_lock()
    os.kill(processes[0].pid, signal.SIGKILL)
    found[0].wait(lambda: isinstance(readings[0].error, ReaderDied))
    before = len(found[1])
    found[1].wait(lambda: len(found[1]) > before + 20)
    assert readings[1].error is None
    os.kill(processes[1].pid, signal.SIGKILL)
    found[1].wait(lambda: isinstance(readings[1].error, ReaderDied))
    for reading in readings:
        reading.close()
    again = processes[1].read(wish('two'), found[1])
    before = len(found[1])
    again.start()
    found[1].wait(lambda: len(found[1]) > before + 20)
    again.close()
    processes[1].close()


def threads(pid):
    """Return policy and whether it is inherited, by thread."""
    tasks = [int(task.name) for task in Path(f'/proc/{pid}/task').iterdir()]
    return {task: os.sched_getscheduler(task) for task in tasks}


@pytest.mark.slow
def test_only_the_thread_that_reads_goes_first_and_nothing_inherits_it(process):
    found = Collected()
    reading = process.read(wish(), found)
    reading.start()
    found.wait(lambda: len(found) > 20)
    found.wait(lambda: found.stats.scheduling)
    said = found.stats.scheduling
    real_time = {
        task: policy
        for task, policy in threads(process.pid).items()
        if policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    }
    assert len(real_time) == (1 if said.startswith('real time') else 0)
    assert all(policy & os.SCHED_RESET_ON_FORK for policy in real_time.values())
    assert all(
        policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
        for policy in threads(os.getpid()).values()
    )
    reading.close()


SPIN = """
import threading, time
from imu_bench.acquisition import priority
priority.limit()
told = threading.Event()
def spin():
    print(priority.raise_priority(), flush=True)
    while not told.is_set():
        pass
thread = threading.Thread(target=spin)
thread.start()
while not priority.still('x').startswith('ordinary'):
    time.sleep(0.01)
print(priority.still('x'), flush=True)
told.set()
thread.join()
"""


@pytest.mark.slow
def test_a_thread_that_spins_gives_its_priority_back():
    # on one processor: nobody else gets anything while it spins
    pinned = {min(os.sched_getaffinity(0))}
    result = subprocess.run(
        ['timeout', '-s', 'KILL', '60', sys.executable, '-c', SPIN],
        capture_output=True, text=True, check=False,
        preexec_fn=lambda: os.sched_setaffinity(0, pinned),
    )  # fmt: skip
    first, *rest = result.stdout.splitlines()
    if not first.startswith('real time'):
        pytest.skip(f'no right to real-time priority here: {first}')
    assert result.returncode == 0, result.stderr
    assert rest == ['ordinary: a thread computed for 1 s without a pause']


BUDGET = """
import os, threading, time
from imu_bench.acquisition import priority
priority.BUDGET, priority.BUDGET_OVER_S = 0.0, 0.2
def work():
    given = priority.raise_priority()
    priority.watch_budget()
    for _ in range(10):
        until = time.process_time() + 0.05
        while time.process_time() < until:
            pass
        time.sleep(0.01)
    priority.watch_budget()
    print(given, '|', priority.still(given), '|', os.sched_getscheduler(0))
thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


@pytest.mark.slow
def test_a_process_that_takes_too_much_gives_its_priority_back():
    result = subprocess.run(
        ['timeout', '-s', 'KILL', '60', sys.executable, '-c', BUDGET],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    _, now, policy = result.stdout.split(' | ')
    assert now.startswith('ordinary: reading took ')
    assert int(policy) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
