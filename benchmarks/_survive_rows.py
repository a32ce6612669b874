# SPDX-License-Identifier: Apache-2.0
"""What a recording is put through, each in a function that says what came of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import random
import resource
import signal
import subprocess
import sys
import time
from typing import Any

from benchmarks import _witness
from benchmarks._disks import BALLAST, fill, NotPossibleHereError, slow_disk, small_disk
from benchmarks._recorded import (
    ANALYSIS,
    READING,
    RECORDER,
    Recording,
    SENSORS,
    wait_for,
    without_rights,
)
from benchmarks._survive_stage import imu_bench, judge, KEEPS, Outcome, recorded, SIX, Stage

EIGHT = 'all_eight'
TOO_SMALL = 'too small for this bench'
BACK_S = 15.0
"""So long a process may take that is started again; it imports numpy and ROS 2."""

CLOCK = Path(__file__).with_name('_clock_jump.c')

BEFORE_KILL_S = 1.0
"""What may be lost before a kill, as the recorder promises."""


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Let programs compute beside, on the same cores."""
    loops = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def beside(stage: Stage, bench: str, loops: int) -> Outcome:
    """Record beside busy loops."""
    with busy(loops):
        return recorded(stage, bench)


def stopped(stage: Stage, seconds: float) -> Outcome:
    """Stop the recorder for a while."""

    def act(recording: Recording) -> None:
        recording.pass_time(stage.seconds / 4)
        pids = recording.processes(RECORDER)
        send(pids, signal.SIGSTOP)
        wait_for(lambda: recording.code is not None, seconds)
        send(pids, signal.SIGCONT)

    return recorded(stage, 'sources', act, seconds=stage.seconds + seconds)


def suspended(stage: Stage) -> Outcome:
    """Stop everything for a while, as a laptop does whose lid is closed."""

    def act(recording: Recording) -> None:
        recording.pass_time(stage.seconds / 2)
        pids = recording.processes()
        send(pids, signal.SIGSTOP)
        time.sleep(stage.suspended_s)
        send(pids, signal.SIGCONT)

    return recorded(stage, SIX, act, seconds=stage.seconds + stage.suspended_s)


def send(pids: list[int], what: signal.Signals) -> None:
    """Send a signal to some processes."""
    for pid in pids:
        os.kill(pid, what)


def killed(stage: Stage) -> Outcome:
    """Kill one process after the other at random times, each in a recording of its own."""
    chance = random.Random(stage.seed)
    outcome = Outcome()
    victims = [RECORDER, SENSORS, READING, ANALYSIS]
    for number in range(stage.kills):
        victim = victims[number % len(victims)]
        at_s = chance.uniform(0.2, 0.7) * stage.seconds
        one = kill(stage, victim, at_s)
        one.remarks = [f'{victim} after {at_s:.1f} s: {each}' for each in one.remarks]
        one.problems = [f'{victim} after {at_s:.1f} s: {each}' for each in one.problems]
        outcome += one
    return outcome


def kill(stage: Stage, victim: str, at_s: float) -> Outcome:
    """Kill one process, that of a role, so long after the begin."""
    place = stage.place()
    bench = stage.sources(place) if stage.quick else SIX
    verb = 'demo' if victim == ANALYSIS else 'record'
    seconds = stage.seconds + (BACK_S if victim in (SENSORS, READING) else 0.0)
    with Recording(place, bench, seconds, verb=verb) as recording:
        recording.wait_begun()
        recording.pass_time(at_s)
        pids = recording.processes(victim)
        if not pids:
            return Outcome(problems=['no such process'])
        killed_ns = time.time_ns()
        os.kill(pids[0], signal.SIGKILL)
        # a demo goes on with its report
        recording.wait_ended(60.0 if verb == 'demo' else 0.0)
        outcome = Outcome(code=recording.code, problems=recording.problems(killed=True))
        if recording.code != 1:
            outcome.problems.append(f'exit code {recording.code}, expected 1')
    bag = recording.bag
    outcome.problems += imu_bench(['analyze', str(bag)])
    if victim == RECORDER:
        bag = place / 'whole'
        outcome.problems += imu_bench(['import', str(recording.bag), '-o', str(bag)])
    for name, own in _witness.sensors(bag).items():
        outcome.samples += own.messages
        outcome.on_the_way += own.on_the_way
        earlier = own.stamps[own.stamps <= killed_ns]
        before_s = (killed_ns - int(earlier[-1])) * 1e-9 if len(earlier) else float('inf')
        if before_s > BEFORE_KILL_S:
            outcome.problems.append(f'{name}: {before_s:.2f} s lost before the kill')
        if victim != RECORDER and own.stamps[-1] <= killed_ns:
            outcome.problems.append(f'{name}: nothing after the kill')
        outcome.remarks.append(f'{name}: {before_s:.2f} s before, {own.missing} missing')
    return outcome


def disk_full(stage: Stage) -> Outcome:
    """Fill the disk below a recording, at once."""
    with small_disk(stage.folder, 300) as disk:
        place = stage.place()
        bench = stage.sources(place)
        with Recording(place, bench, stage.seconds, bag=disk / 'bag') as recording:
            recording.wait_begun()
            recording.pass_time(stage.seconds / 2)
            fill(disk)
            recording.wait_ended()
            (disk / BALLAST).unlink()
            whole = place / 'whole'
            problems = imu_bench(['import', str(recording.bag), '-o', str(whole)])
            outcome = judge(recording, faulty=True, cut=True, bag=whole)
    outcome.problems += problems
    if 'disk is full' not in recording.said() and 'No space left' not in recording.said():
        outcome.problems.append('it does not say that the disk is full')
    outcome.remarks.append('a tmpfs of 300 MB, filled')
    return outcome


def disk_slow(stage: Stage) -> Outcome:
    """Let the disk take 20 kB/s for a third of the time, less than is recorded."""

    def act(recording: Recording) -> None:
        recording.pass_time(stage.seconds / 3)
        with slow_disk(recording.bag, 20_000, recording.processes(RECORDER)):
            recording.pass_time(2 * stage.seconds / 3)

    outcome = recorded(stage, 'sources', act)
    outcome.remarks.append('20 kB/s for a third of the time, by a cgroup of block devices')
    return outcome


def clock_jumps(stage: Stage) -> Outcome:
    """Put the clock an hour on, then two back."""
    library, offset = stage.folder / 'clock.so', stage.folder / 'offset'
    build = ['cc', '-O2', '-shared', '-fPIC', str(CLOCK), '-o', str(library), '-ldl']
    try:
        subprocess.run(build, check=True)
    except OSError as error:
        raise NotPossibleHereError(f'a clock that jumps: {error}') from error
    offset.write_text('0')
    environment = {'LD_PRELOAD': str(library), 'CLOCK_OFFSET_FILE': str(offset)}

    def act(recording: Recording) -> None:
        for part, jump in ((1, '3600'), (2, '-3600')):
            recording.pass_time(part * stage.seconds / 3)
            new = offset.with_suffix('.new')
            new.write_text(jump)
            new.rename(offset)  # nobody reads half of it

    outcome = recorded(stage, 'sources', act, environment=environment)
    outcome.remarks.append('in the processes of the bench alone, by a preloaded library')
    return outcome


def little_memory(stage: Stage) -> Outcome:
    """Let the recorder have no more memory than it has, and need some."""

    def act(recording: Recording) -> None:
        recording.pass_time(stage.seconds / 3)
        pids = recording.processes(RECORDER)
        for pid in pids:
            size = int(Path(f'/proc/{pid}/statm').read_text('utf-8').split()[0])
            limit = size * os.sysconf('SC_PAGE_SIZE')
            resource.prlimit(pid, resource.RLIMIT_AS, (limit, limit))
        send(pids, signal.SIGSTOP)
        recording.pass_time(2 * stage.seconds / 3)
        if recording.code is None:
            send(pids, signal.SIGCONT)

    outcome = recorded(stage, 'sources', act, cut=True)
    outcome.remarks.append('RLIMIT_AS of the recorder at what it had')
    return outcome


def one_core(stage: Stage, *, rights: bool) -> Outcome:
    """Run a demo on one core."""
    core = min(os.sched_getaffinity(0))

    def prepare() -> None:
        os.sched_setaffinity(0, {core})
        if not rights:
            without_rights()

    return recorded(stage, SIX, prepare=prepare, says=TOO_SMALL)


def ordinary_user(stage: Stage) -> Outcome:
    """Record without the right to real-time priority; every sensor is to keep its rate."""
    return _keeping(stage, SIX, stage.seconds, prepare=without_rights)


def eight(stage: Stage) -> Outcome:
    """Record eight sensors for long; every one is to keep its rate."""
    return _keeping(stage, EIGHT, stage.seconds if stage.quick else 600.0)


def _keeping(stage: Stage, bench: str, seconds: float, **options: Any) -> Outcome:
    """Record; a sensor that does not keep its rate is a problem."""
    outcome = recorded(stage, bench, seconds=seconds, faulty=False, **options)
    if outcome.missing > KEEPS * outcome.samples:
        outcome.problems.append(f'{outcome.missing} of {outcome.samples} samples missing')
    return outcome
