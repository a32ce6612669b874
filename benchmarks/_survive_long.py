# SPDX-License-Identifier: Apache-2.0
"""
What grows: a demo of half an hour, process by process, and a day in simulated time.

The day is one sensor of 100 Hz (a BNO055 on its emulated wire) read by its driver on a simulated
clock, encoded, and written into one bag as the recorder writes: what grows with every sample or
flush would show.  It holds no middleware: that is what the half hour is for.
``python -m benchmarks._survive_long HOURS FOLDER`` is the process that does it.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

import numpy as np
import yaml

from benchmarks._measured import proportional_set
from benchmarks._recorded import Recording
from benchmarks._survive_stage import judge, Outcome, RATES, SIX, Stage

GROWS = 0.02
"""MB a minute, at most."""

LOOK_S = 10.0
WINDOW_S = 600.0
"""Of the analysis of the demo; until it is full memory may grow."""

HALF_HOUR_S = 1800.0
SENSOR, FLUSH_S = 'bno055', 0.5


def steady(stage: Stage) -> Outcome:
    """Run a demo for long; after the window is full, no process may grow."""
    place = stage.place()
    bench, seconds, start = SIX, HALF_HOUR_S, WINDOW_S + 60.0
    if stage.quick:
        bench, seconds, start = _small(stage, place), stage.seconds, stage.seconds / 2
    memory: dict[tuple[str, int], list[tuple[float, float, float]]] = defaultdict(list)
    with Recording(place, bench, seconds, verb='demo') as recording:
        recording.wait_begun()
        while recording.pass_time(min(seconds, time.monotonic() - recording.begun_s + LOOK_S)):
            now = time.monotonic() - recording.begun_s
            if now > seconds - 1.0:
                break
            for pid, role in recording.look().items():
                handles = len(list(Path(f'/proc/{pid}/fd').iterdir()))
                memory[role, pid].append((now, proportional_set(pid) * 1e-6, handles))
        recording.wait_ended(300.0)
        outcome = judge(recording)
    for (role, _), own in sorted(memory.items()):
        times, sizes, handles = np.array([each for each in own if each[0] > start]).T
        if len(times) < 3:
            continue
        slope, more = 60.0 * np.polyfit(times, sizes, 1)[0], handles[-1] - handles[0]
        said = f'{role}: {sizes[-1]:.0f} MB, {slope:+.3f} MB/min, {more:+.0f} file handles'
        grows = (slope > GROWS and not stage.quick) or more > 0
        (outcome.problems if grows else outcome.remarks).append(said)
    return outcome


def _small(stage: Stage, place: Path) -> str:
    path = Path(stage.sources(place))
    document = yaml.safe_load(path.read_text('utf-8'))
    document['analysis'] = {'window_s': 5.0}
    path.write_text(yaml.safe_dump(document), encoding='utf-8')
    return str(path)


def day(stage: Stage) -> Outcome:
    """Read, encode and write for a day of simulated time."""
    hours = 0.02 if stage.quick else 24.0
    command = [sys.executable, '-m', 'benchmarks._survive_long', str(hours), str(stage.place())]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        return Outcome(problems=[done.stderr.strip()])
    table = np.array([[float(cell) for cell in row.split()] for row in done.stdout.splitlines()])
    # the first quarter fills the windows of rate and jitter
    hour, samples, lost, size = table[len(table) // 4 :].T
    slope = np.polyfit(hour * 60.0, size * 1e-6, 1)[0]
    said = f'{hours:g} h simulated: {size[-1] * 1e-6:.0f} MB, {slope:+.4f} MB/min'
    outcome = Outcome(int(samples[-1]), int(lost[-1]), remarks=[said])
    if lost[-1] or (slope > GROWS and not stage.quick):
        outcome.problems.append(f'it loses or grows: {said}')
    if samples[-1] < 0.99 * 3600 * hours * RATES[3]:
        outcome.problems.append('it is slower than its rate')
    return outcome


def main(hours: float, folder: Path) -> None:
    """Live a day; print hours, samples, lost and memory, a hundred times."""
    import os

    from imu_bench.bags.topic_info import describe
    from imu_bench.bags.writer import BagWriter
    from imu_bench.bench import build, load_bench
    from imu_bench.config.location import config_file
    from imu_bench.simulation.clock import SimulatedClock
    from msg_conversions.encoding import independent, SensorEncoder
    from msg_conversions.quantities import TYPES

    bench = load_bench(config_file(f'benches/{SIX}.yaml'))
    config = next(sensor for sensor in bench.sensors if sensor.name == SENSOR)
    clock = SimulatedClock()
    acquisition: Any = build(config, clock)
    acquisition.prepare()
    encoder = SensorEncoder(config.frame_id, independent(config.stddevs))
    writer = BagWriter(folder / 'bag')
    began_ns, topics = clock.now_ns(), set()
    steps = round(hours * 3600.0 / FLUSH_S)
    for step in range(1, steps + 1):
        acquisition.advance(began_ns + round(step * FLUSH_S * 1e9))
        for run in acquisition.drain():
            for topic, stamps, rows in encoder.encode(run.stamps, run.columns):
                if topic not in topics:
                    topics.add(topic)
                    writer.add_topic(describe(f'/{topic}', TYPES[topic]))
                writer.write_many(f'/{topic}', np.asarray(stamps), rows)
        writer.flush()
        if step % max(1, steps // 100) == 0:
            stats = acquisition.stats
            size = proportional_set(os.getpid())
            print(step * FLUSH_S / 3600.0, stats.samples, stats.lost, size, flush=True)
    writer.close()


if __name__ == '__main__':
    main(float(sys.argv[1]), Path(sys.argv[2]))
