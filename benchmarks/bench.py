# SPDX-License-Identifier: Apache-2.0
"""
Does the bench of eight sensors run on this machine with every sensor at its rate?

All nodes as users start them, one process each, on emulated chips, and the analysis node; no
recorder.  Prints for each what arrived, what was lost, how many readings were late, and the
share of one core that the process used.  The emulated chips run in the same processes: the
share of a node on hardware is lower.

Beside them a process with the priority of the reading threads does nothing but sleep for 1 ms
again and again.  For as long as it is late the machine stood still for everybody: no FIFO
shorter than that can be read in time, whatever reads it.

Run as ``python -m benchmarks.bench [seconds] [bench]``.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from imu_bench.acquisition.stats import WINDOW_S
from imu_bench.bench import load_bench
from imu_bench.config import BenchConfig
from imu_bench.config.location import config_file
from imu_bench.nodes.bench_monitor import BenchMonitor, SensorView
from imu_bench.nodes.processes import BenchProcesses
import yaml

SECONDS = 60.0
BENCH = 'all_eight'
UP_WITHIN_S = 90.0
IDLE = """
import sys, time
from imu_bench.acquisition.priority import raise_priority
raise_priority()
late, end = [], time.monotonic() + float(sys.argv[1])
while (before := time.monotonic()) < end:
    time.sleep(1e-3)
    late.append(time.monotonic() - before - 1e-3)
print(sum(x > 0.02 for x in late), max(late))
"""
"""The process that does nothing: how often it was more than 20 ms late, and the most."""

TICKS = os.sysconf('SC_CLK_TCK')


def started(bench: BenchConfig, folder: Path) -> BenchProcesses:
    """Start a node for each sensor, and the analysis."""
    environment = {**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}
    processes = BenchProcesses(folder, environment)
    analysis = f'window_s:={bench.analysis.window_s}'
    reliable = str(config_file('analysis.yaml'))
    processes.start(
        'analysis', 'imu_bench.nodes.analysis_node',
        ['--ros-args', '--params-file', reliable, '-p', analysis],
    )  # fmt: skip
    for sensor in bench.sensors:
        own = folder / f'{sensor.name}.yaml'
        document = {'/**': {'ros__parameters': dict(bench.overrides[sensor.name])}}
        own.write_text(yaml.safe_dump(document), encoding='utf-8')
        files = ['--params-file', str(bench.files[sensor.name])]
        if bench.overrides[sensor.name]:
            files += ['--params-file', str(own)]
        processes.start(
            sensor.name, 'imu_bench.nodes.sensor_node',
            ['--ros-args', *files, '-r', f'__ns:={sensor.namespace}'],
        )  # fmt: skip
    return processes


def wait_until_settled(monitor: BenchMonitor, processes: BenchProcesses) -> None:
    """Wait until every node speaks of a rate window in which all of them were up already."""
    wait_for_all(monitor, processes, lambda view: view.publishing)
    settled_s = time.monotonic() + WINDOW_S
    wait_for_all(monitor, processes, lambda view: view.heard_s > settled_s)


def wait_for_all(
    monitor: BenchMonitor, processes: BenchProcesses, fine: Callable[[SensorView], bool]
) -> None:
    """Wait until every sensor's node has said something; exit if one cannot any more."""
    views = monitor.sensors.values()
    monitor.wait_for(lambda: bool(processes.ended()) or all(map(fine, views)), UP_WITHIN_S)
    for name, code in processes.ended().items():
        sys.exit(f'{name} ended with exit code {code}: {processes.last_words(name)}')
    silent = [view.name for view in views if not fine(view)]
    if silent:
        sys.exit(f'no data within {UP_WITHIN_S:g} s from {", ".join(silent)}')


def cpu_seconds(process_id: int) -> float:
    """Return the processor time that a process has used: utime and stime of proc(5)."""
    fields = Path(f'/proc/{process_id}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def counts(monitor: BenchMonitor, name: str) -> dict[str, float]:
    view = monitor.sensors[name]
    return {key: view.number(key) for key in ('lost', 'late')}


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    bench = load_bench(config_file(f'benches/{sys.argv[2] if len(sys.argv) > 2 else BENCH}.yaml'))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    names = [sensor.name for sensor in bench.sensors]
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault('ROS_LOG_DIR', folder)
        processes = started(bench, Path(folder))
        try:
            with BenchMonitor(names) as monitor:
                wait_until_settled(monitor, processes)
                before = {name: counts(monitor, name) for name in names}
                used = {n: cpu_seconds(processes.number(n)) for n in (*names, 'analysis')}
                began = time.monotonic()
                idle = subprocess.run(
                    [sys.executable, '-c', IDLE, str(seconds)],
                    check=True, capture_output=True, text=True,
                )  # fmt: skip
                passed = time.monotonic() - began
                share = {
                    n: (cpu_seconds(processes.number(n)) - s) / passed for n, s in used.items()
                }
                ended_s = began + passed
                wait_for_all(monitor, processes, lambda view: view.heard_s > ended_s)
                report(bench, monitor, before, share, seconds)
                often, most = map(float, idle.stdout.split())
                print(f'  a thread that does nothing: {often:.0f} times late, up to {most:.3f} s')
        finally:
            processes.stop()


def report(
    bench: BenchConfig,
    monitor: BenchMonitor,
    before: dict[str, dict[str, float]],
    share: dict[str, float],
    seconds: float,
) -> None:
    print(f'{bench.title}: {seconds:g} s on {len(os.sched_getaffinity(0))} cores\n')
    print(
        f'  {"":11}{"set Hz":>9}{"true Hz":>10}{"delivered":>11}{"lost":>7}{"late":>7}{"core":>8}'
    )
    for name, view in monitor.sensors.items():
        grown = {key: value - before[name][key] for key, value in counts(monitor, name).items()}
        measured = view.number('rate_hz')
        # of a chip that is polled only the rate of delivery is known
        true_hz = f'{measured:.2f}' if math.isfinite(measured) else '-'
        print(
            f'  {name:11}{view.number("nominal_hz"):9.1f}{true_hz:>10}'
            f'{view.number("delivered_hz"):11.2f}{grown["lost"]:7.0f}{grown["late"]:7.0f}'
            f'{share[name]:8.1%}   {"" if view.kept_rate else view.verdict}'
        )
    analysed = sum(bool(view.noise) for view in monitor.sensors.values())
    heard = f'noise figures of {analysed} of {len(bench.sensors)} sensors'
    print(f'  {"analysis":11}{heard:44}{share["analysis"]:8.1%}')
    print(f'\n  {sum(share.values()):.2f} cores in all')
    first = next(iter(monitor.sensors.values()))
    print(f'  threads that read: {first.values.get("scheduling", "")}')


if __name__ == '__main__':
    main()
