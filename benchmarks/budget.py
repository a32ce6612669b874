# SPDX-License-Identifier: Apache-2.0
"""
What does a sample cost, from the chip into the bag, and how much memory does a bench hold?

Each stage of the bench of Shabulinzenze 2020 (six sensors, 4800 samples/s) in µs of CPU per
sample, user and system, of the processes that do it, beside two floors measured in the same run:
the least that publishing costs a program in Python, and the least that taking costs.  Emulated
chips are told apart: a bench on real ones has none.  What a Raspberry Pi holds is paper.
"""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
import math
import multiprocessing
import os
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import TYPE_CHECKING

from imu_bench.bench import load_bench
from imu_bench.bus.clock import SystemClock
from imu_bench.config.location import config_file
from imu_bench.nodes import bench_nodes
from imu_bench.nodes.processes import BenchProcesses
import yaml

from benchmarks import _witness
from benchmarks._floors import topic
from benchmarks._frame import Benchmark
from benchmarks._measured import family, proportional_set
from benchmarks._reading_cost import Bed, on_the_clock
from benchmarks._recorded import ANALYSIS, READING, RECORDER, Recording, SENSORS, wait_for

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

BENCH = 'machine_vibration'
RATES = (400.0, 1000.0, 952.0, 100.0, 1344.0, 1000.0)
"""Hz, of its six sensors."""

SPEED = 12.0
"""How much faster than time the window of the analysis is filled by blocks of a stand-in."""

TICK = os.sysconf('SC_CLK_TCK')

PI_4_STEP_S = 158.263 / 5e6
"""
Seconds per step of the n-body problem in Python, of a Raspberry Pi 4 at 1.5 GHz:
https://chaitanyamehta.github.io/projects/performance-analysis-of-programming-languages
"""

PI_5_OVER_4 = 2737.49 / 1477.83
"""Speed of one core by sysbench: https://leoncode.co.uk/articles/raspberry-pi-benchmarks."""

PI_CORES = 4


@dataclass(frozen=True)
class Stage:
    """What processes have used over a while: µs per sample, and share of a core."""

    per_sample: float
    core: float


def cpu_s(pid: int) -> float:
    """Return user and system time of one process so far, s, as proc(5) has it."""
    fields = Path(f'/proc/{pid}/stat').read_text('utf-8').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


class Meter:
    """Measures what some processes use from now on."""

    def __init__(self, pids: list[int]) -> None:
        self._before = {pid: cpu_s(pid) for pid in pids}
        self._began_s, self.began_ns = time.monotonic(), time.time_ns()

    def stage(self, samples: float) -> Stage:
        """Return what they have used while there were so many samples."""
        used = sum(cpu_s(pid) - before for pid, before in self._before.items())
        return Stage(1e6 * used / samples, used / self.passed_s)

    @property
    def passed_s(self) -> float:
        return time.monotonic() - self._began_s


class Floor:
    """A process of `benchmarks._floors`; a context manager."""

    def __init__(self, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'benchmarks._floors', *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.pid = self._process.pid

    def count(self) -> int:
        """Return how many messages there were so far."""
        assert self._process.stdin is not None  # noqa: S101  (they are pipes)
        assert self._process.stdout is not None  # noqa: S101
        self._process.stdin.write('\n')
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    def __enter__(self) -> Floor:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()


def first(count: int, folder: Path) -> Path:
    """Write the bench with so many of its sensors."""
    path = config_file(f'benches/{BENCH}.yaml')
    document = yaml.safe_load(path.read_text('utf-8'))
    document['sensors'] = document['sensors'][:count]
    written = folder / path.name
    written.write_text(yaml.safe_dump(document, allow_unicode=True), encoding='utf-8')
    return written


def floors(rates: Sequence[float], seconds: float, settling_s: float) -> tuple[Stage, Stage]:
    """Return what publishing ready-made bytes costs, and what taking them does."""
    topics = [topic(number) for number in range(len(rates))]
    with Floor('take', *topics) as taker, Floor('publish', *map(str, rates)) as publisher:
        wait_for(lambda: taker.count() > 0, 60.0)
        time.sleep(settling_s)
        meters = Meter([publisher.pid]), Meter([taker.pid])
        before = publisher.count(), taker.count()
        time.sleep(seconds)
        counts = publisher.count() - before[0], taker.count() - before[1]
        published, taken = (m.stage(n) for m, n in zip(meters, counts, strict=True))
    if counts[1] < 0.99 * counts[0]:
        print(f'the floor took {counts[1]} of {counts[0]} messages')
    return published, taken


def apart(bench: Path, seconds: float) -> tuple[float, float]:
    """Return what drivers with acquisition and what emulated chips take, µs per sample."""
    beds = [Bed(sensor, SystemClock()) for sensor in load_bench(bench).sensors]
    costs = on_the_clock(beds, seconds)
    rate = sum(cost.rate_hz for cost in costs)
    emulated = sum(cost.emulator * cost.rate_hz for cost in costs) / rate
    return sum(cost.per_sample * cost.rate_hz for cost in costs) / rate - emulated, emulated


@dataclass(frozen=True)
class Whole:
    """A demo: what each role took, and how much memory it held (B)."""

    stages: dict[str, Stage]
    memory: Counter[str]
    samples: int


def whole(
    bench: Path, folder: Path, seconds: float, settling_s: float, *more: str, verb: str = 'demo'
) -> Whole:
    """Record as users do, and measure every process."""
    length_s = seconds + 2 * settling_s
    with Recording(folder, str(bench), length_s, verb=verb, more=more) as recording:
        recording.wait_begun()
        recording.pass_time(settling_s)
        roles = recording.look()
        meters = {
            role: Meter([pid for pid, own in roles.items() if own == role])
            for role in set(roles.values())
        }
        began_ns = time.time_ns()
        recording.pass_time(settling_s + seconds)
        if recording.code is not None:
            raise SystemExit(f'the recording ended: {recording.said()}')
        used = {role: meter.stage(1.0) for role, meter in meters.items()}
        ended_ns = time.time_ns()
        memory: Counter[str] = Counter()
        for pid, role in recording.look().items():
            memory[role] += proportional_set(pid)
        recording.wait_ended(120.0)
    stamps = [found.stamps for found in _witness.sensors(recording.bag).values()]
    samples = sum(int(((own >= began_ns) & (own < ended_ns)).sum()) for own in stamps)
    stages = {role: Stage(stage.per_sample / samples, stage.core) for role, stage in used.items()}
    return Whole(stages, memory, samples)


@contextmanager
def sensors(file: Path, folder: Path) -> Iterator[list[int]]:
    """Run the sensors of the bench; yield the process that publishes and those that read."""
    from imu_bench.nodes.bench_monitor import BenchMonitor

    bench = load_bench(file)
    processes = BenchProcesses(folder, bench_nodes.environment(folder, {}))
    names = [sensor.name for sensor in bench.sensors]
    try:
        bench_nodes.start_sensors(processes, bench, folder, {})
        with BenchMonitor(names) as monitor:
            views = monitor.sensors.values()
            if not monitor.wait_for(lambda: all(view.publishing for view in views), 180.0):
                raise SystemExit('the sensors did not come up')
        yield family(processes.number(bench_nodes.SENSORS))
    finally:
        processes.stop()


def publishing(
    bench: Path, rate: float, folder: Path, seconds: float, settling_s: float
) -> dict[str, tuple[Stage, Stage]]:
    """Return what publishing and reading take, without and with a subscriber to every topic."""
    found = {}
    topics = [f'{sensor.namespace}/imu/data_raw' for sensor in load_bench(bench).sensors]
    with sensors(bench, folder) as (node, *readers):
        time.sleep(settling_s)
        meters = Meter([node]), Meter(readers)
        time.sleep(seconds)
        alone = [meter.stage(rate * meter.passed_s) for meter in meters]
        found['nobody'] = alone[0], alone[1]
        with Floor('take', *topics) as taker:
            wait_for(lambda: taker.count() > 0, 60.0)
            time.sleep(settling_s)
            meters, before = (Meter([node]), Meter(readers)), taker.count()
            time.sleep(seconds)
            taken = taker.count() - before
            heard = [meter.stage(taken) for meter in meters]
            found['a subscriber each'] = heard[0], heard[1]
    return found


def full_window(rates: Sequence[float], folder: Path, window_s: float) -> int:
    """Return the memory of an analysis whose window is full, B."""
    processes = BenchProcesses(folder, bench_nodes.environment(folder, {}))
    try:
        arguments = ['--ros-args', '-p', f'window_s:={window_s}']
        processes.start(ANALYSIS, 'imu_bench.nodes.analysis_node', arguments)
        with Floor('ahead', str(SPEED), *map(str, rates)) as source:
            enough = 1.05 * window_s * sum(rates)
            wait_for(lambda: source.count() >= enough, 120.0 + 3.0 * window_s / SPEED)
            return proportional_set(processes.number(ANALYSIS))
    finally:
        processes.stop()


def n_body_step_s() -> float:
    """Return seconds of CPU per step of the n-body problem: five bodies, ten pairs, in Python."""
    bodies = [([float(k), 1.0 + k, 2.0 * k], [0.1 * k, 0.2, 0.3], 1.0 + k) for k in range(5)]
    pairs = [(bodies[i], bodies[j]) for i in range(5) for j in range(i + 1, 5)]
    steps, dt = 20_000, 1e-5
    best = math.inf
    for _ in range(3):
        began = time.process_time()
        for _ in range(steps):
            for (p1, v1, m1), (p2, v2, m2) in pairs:
                dx, dy, dz = p1[0] - p2[0], p1[1] - p2[1], p1[2] - p2[2]
                pull = dt * (dx * dx + dy * dy + dz * dz) ** -1.5
                a, b = m2 * pull, m1 * pull
                v1[0] -= dx * a
                v1[1] -= dy * a
                v1[2] -= dz * a
                v2[0] += dx * b
                v2[1] += dy * b
                v2[2] += dz * b
            for place, speed, _ in bodies:
                place[0] += dt * speed[0]
                place[1] += dt * speed[1]
                place[2] += dt * speed[2]
        best = min(best, (time.process_time() - began) / steps)
    return best


def main() -> int:
    run = Benchmark(__doc__)
    run.add_size('--seconds', 60.0, quick=0.8, help='that every stage is measured')
    # start-up, discovery and the first fits of the clock models
    run.add_size('--settling', 5.0, quick=0.2, help='seconds before them that are not counted')
    run.add_size('--window', 600.0, quick=2.0, help='seconds of the analysis window')
    run.add_size('--sensors', len(RATES), quick=2, help='of the bench')
    options = run.start()
    seconds, settling_s, rates = options.seconds, options.settling, RATES[: options.sensors]
    with TemporaryDirectory(ignore_cleanup_errors=True) as name:
        bench_file = first(options.sensors, folder := Path(name))
        places = [folder / part for part in ('demo', 'direct', 'logs')]
        for place in places:
            place.mkdir()
        floor, least = floors(rates, seconds, settling_s)
        with ProcessPoolExecutor(1, multiprocessing.get_context('spawn')) as pool:
            driven, emulated = pool.submit(apart, bench_file, seconds).result()
        heard = publishing(bench_file, sum(rates), places[2], seconds, settling_s)
        demo = whole(bench_file, places[0], seconds, settling_s)
        direct = whole(bench_file, places[1], seconds, settling_s, '--direct', verb='record')
        window = full_window(rates, places[2], options.window)

    run.head('stage                                    ', 'µs/sample', 'cores')

    def row(name: str, stage: Stage) -> None:
        run.row(name, f'{stage.per_sample:.1f}', f'{stage.core:.3f}')

    row('floor: publishing ready-made bytes', floor)
    row('floor: taking bytes', least)
    for who, (published, reads) in heard.items():
        row(f'publishing, heard by {who}', published)
        row('reading meanwhile, with emulated chips', reads)
    stages = demo.stages
    for role in (READING, SENSORS, RECORDER, ANALYSIS, 'session'):
        row(f'demo: {role}', stages[role])
    row('direct recording, beside reading', direct.stages['session'])
    scale = demo.samples / seconds * 1e-6
    run.row('of reading: emulated chips', f'{emulated:.1f}', f'{emulated * scale:.3f}')
    own = stages[READING].per_sample - emulated
    run.row('of reading: all else', f'{own:.1f}', f'{own * scale:.3f}')
    run.row('driver and acquisition alone', f'{driven:.1f}', f'{driven * scale:.3f}')

    bench = [stages[role] for role in (READING, SENSORS, RECORDER, ANALYSIS)]
    cores = sum(stage.core for stage in bench)
    bare = cores - emulated * scale
    ours = own + heard['a subscriber each'][0].per_sample
    roles = (SENSORS, READING, RECORDER, ANALYSIS)
    held = sum(demo.memory[role] for role in roles) * 1e-6
    full = held + (window - demo.memory[ANALYSIS]) * 1e-6
    print('\nmemory, MB: ' + ', '.join(f'{r} {demo.memory[r] * 1e-6:.0f}' for r in roles), end='')
    print(f'; analysis with {options.window:g} s, from a stand-in {SPEED:g} times as fast as '
          f'time: {window * 1e-6:.0f}')  # fmt: skip
    paper(bare, demo.samples / seconds)
    run.claim('reading and publishing over the floor', ours / floor.per_sample, at_most=2.0)
    run.claim(
        'recorder over the floor', stages[RECORDER].per_sample / least.per_sample, at_most=1.5
    )
    run.claim('direct recording', direct.stages['session'].per_sample, at_most=20.0, unit='µs')
    run.claim('bench without emulators', bare, at_most=0.5, unit='cores')
    run.claim('bench with emulators', cores, at_most=1.0, unit='cores')
    run.claim('memory of the bench', held, at_most=350.0, unit='MB')
    run.claim('memory, window full', full, at_most=500.0, unit='MB')
    return run.done()


def paper(cores: float, rate_hz: float) -> None:
    """Print what that makes on a Raspberry Pi, by public figures of its speed."""
    step_s = n_body_step_s()
    four = PI_4_STEP_S / step_s
    print(
        f'\non paper: a step of the n-body problem in Python takes {1e6 * step_s:.1f} µs here, '
        f'{1e6 * PI_4_STEP_S:.1f} µs on a Raspberry Pi 4\n(public figure): {four:.1f} times as '
        f'long; a Pi 5 is {PI_5_OVER_4:.2f} times as fast as a Pi 4 (public figure).'
    )
    for name, factor in (('Pi 4', four), ('Pi 5', four / PI_5_OVER_4)):
        taken = factor * cores
        half = rate_hz * 0.5 * PI_CORES / taken
        print(
            f'  {name}: this bench on real chips takes {cores:.2f} x {factor:.2f} = {taken:.2f} '
            f'of {PI_CORES} cores; half of them hold {half:.0f} samples/s'
        )


if __name__ == '__main__':
    sys.exit(main())
