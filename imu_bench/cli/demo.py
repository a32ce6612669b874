# SPDX-License-Identifier: Apache-2.0
"""`imu-bench demo`: a whole bench on emulated sensors, live, recorded, then analysed."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping
from datetime import datetime
import os
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from imu_bench.errors import ConfigError

if TYPE_CHECKING:
    from imu_bench.cli.trial import LiveTest
    from imu_bench.config import BenchConfig
    from imu_bench.nodes.bench_monitor import BenchMonitor
    from imu_bench.nodes.processes import BenchProcesses

BENCH, FAULTY_BENCH = 'machine_vibration', 'faults'
DURATION_S = 60.0
AFTER_FAULTS_S = 6.0
"""So long the demo goes on behind its last fault."""

LEAD_S = 1.5
"""So long before a scenario begins every sensor is told when; they compute some time ahead."""

UP_WITHIN_S = 60.0
"""How long the nodes may take to come up; a busy two-core machine needs some 20 s."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser(
        'demo', help='run a bench of emulated sensors under ROS 2, record it, analyse it'
    )
    parser.add_argument(
        'bench', nargs='?', help=f'a bench of config/benches or a YAML (default {BENCH})'
    )
    parser.add_argument(
        '--duration', type=_seconds, metavar='S', help=f'seconds (default {DURATION_S:g})'
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        '--test', metavar='NAME',
        help='run a test of the bench, made short, and analyse it with its plan; the default is '
        'what the bench lists under demo:',
    )  # fmt: skip
    what.add_argument(
        '--scenario', metavar='S', help='move the bench as a scenario of config/scenarios says'
    )
    what.add_argument(
        '--faults', action='store_true',
        help='let the wires fail as the bench has it scripted (default bench: '
        f'{FAULTY_BENCH}); 1 if a sensor does not recover by itself',
    )  # fmt: skip
    parser.add_argument(
        '-o', '--output', type=Path, metavar='DIR', help='where to write (default demo_<time>)'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """
    Run the demo; return 0 when every sensor gave data and the analysis succeeded.

    With faults every one of them has to be recovered from, too.
    """
    from imu_bench.bench import load_bench
    from imu_bench.config.location import config_file
    from imu_bench.nodes.spinning import require_ros

    require_ros()
    chosen = args.bench or (FAULTY_BENCH if args.faults else BENCH)
    name = chosen if chosen.endswith('.yaml') else f'benches/{chosen}.yaml'
    bench = load_bench(config_file(name))
    duration_s = args.duration or (_faults_over_s(bench) if args.faults else DURATION_S)
    live = _live_test(bench, args, duration_s)
    if live is not None:
        duration_s = live.duration_s
    folder = _new_folder(args.output)
    environment = _environment(folder)
    print(f'{bench.title or bench.name}: {kinds(bench)}, {duration_s:g} s')
    if live is not None:
        print(f'{f"test {live.test.name}" if live.test else "no test"}: {live.remark}')
    print(
        f'on ROS_DOMAIN_ID={environment["ROS_DOMAIN_ID"]}, this machine only; '
        f'recording into {folder}/bag'
    )
    monitor = _live(bench, folder, environment, duration_s, live, args.faults)
    failed = _verdicts(monitor)
    if args.faults:
        from imu_bench.cli.fault_lines import show_faults, show_gaps

        failed = max(show_faults(monitor.sensors), failed)
    code = _analyse(folder, live.analysis() if live else [])
    if args.faults and code == 0:
        show_gaps(folder / 'results.json', monitor.sensors)
    return max(code, failed)


def kinds(bench: BenchConfig) -> str:
    """
    Say how many sensors there are and what stands behind them.

    Examples
    --------
    >>> from imu_bench.config import BenchConfig, SensorConfig
    >>> kinds(BenchConfig(name='one', sensors=(SensorConfig('a', 'mpu9250', 'emulated'),)))
    '1 emulated sensor'
    """
    from imu_bench.offline.notation import count

    found = Counter(sensor.backend for sensor in bench.sensors)
    if len(found) == 1:
        return count(len(bench.sensors), f'{next(iter(found))} sensor')
    listed = ', '.join(f'{number} {kind}' for kind, number in found.items())
    return f'{count(len(bench.sensors), "sensor")} ({listed})'


def _live_test(bench: BenchConfig, args: argparse.Namespace, most_s: float) -> LiveTest | None:
    """Return what moves the bench; None if it stands still as its sensors' files say."""
    from imu_bench.cli.trial import of_scenario, of_test

    if args.scenario:
        return of_scenario(args.scenario, (), most_s)
    name = args.test or ('' if args.faults else bench.demo)
    return of_test(bench, name, most_s) if name else None


def _faults_over_s(bench: BenchConfig) -> float:
    """Return how long a bench takes for its faults, and to recover from the last one."""
    from imu_bench.bench import faults_of

    ends = [fault.over_s for sensor in bench.sensors for fault in faults_of(sensor)]
    if not ends:
        raise ConfigError(
            f'{bench.name}: no fault is scripted in this bench; give simulation.faults to a '
            f'sensor, like ["unplugged 10 2"], or leave the bench out for {FAULTY_BENCH!r}'
        )
    return max(ends) + AFTER_FAULTS_S


def _seconds(text: str) -> float:
    """Return a duration that is worth a demo."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is no number of seconds') from None
    if not 1.0 <= value <= 7 * 86400.0:
        raise argparse.ArgumentTypeError(f'{text} s is not between 1 s and a week')
    return value


def _new_folder(wanted: Path | None) -> Path:
    folder = wanted or Path(f'demo_{datetime.now():%Y%m%d_%H%M%S}')
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f'{folder}: exists and is not empty; name another folder with -o')
    (folder / 'log').mkdir(parents=True)
    return folder


def _environment(folder: Path) -> dict[str, str]:
    """Return the environment of the nodes: on this machine only, in a domain of their own."""
    from imu_bench.nodes.bench_nodes import environment

    # 0 to 101 are safe on Linux (ROS 2 documentation, "The ROS_DOMAIN_ID")
    domain = str(1 + os.getpid() % 100)
    alone = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_DOMAIN_ID': domain}
    return environment(folder / 'log', alone)


def _live(
    bench: BenchConfig,
    folder: Path,
    environment: dict[str, str],
    duration_s: float,
    live: LiveTest | None,
    faults: bool,
) -> BenchMonitor:
    """Run the nodes for a while, whatever ends it; return what the monitor saw."""
    from imu_bench.cli.fault_lines import FaultNews
    from imu_bench.cli.live import BenchShowing, show, stop
    from imu_bench.nodes.bench_monitor import BenchMonitor
    from imu_bench.nodes.processes import BenchProcesses

    processes = BenchProcesses(folder / 'log', environment)
    sensors = [sensor.name for sensor in bench.sensors]
    emulated = [sensor.name for sensor in bench.sensors if sensor.backend == 'emulated']
    played = [sensor.name for sensor in bench.sensors if sensor.backend == 'recorded']
    moved = live.write(folder / 'scenario') if live else {}
    begun: list[float] = []
    try:
        _start(bench, folder, processes, moved)
        with BenchMonitor(sensors) as monitor:

            def begin() -> float:
                if live is None:
                    return time.monotonic()
                at_s = time.time() + LEAD_S
                monitor.begin(at_s, emulated)
                begun.append(at_s)
                return time.monotonic() + at_s - time.time()

            news = FaultNews(monitor.sensors).lines if faults else tuple
            showing = BenchShowing(monitor, processes, duration_s, news, begin, played)
            try:
                show(showing, UP_WITHIN_S)
            except KeyboardInterrupt:
                print('stopping', file=sys.stderr)
            # while the monitor listens: a sensor says as it goes what it lost at last
            stop(processes, sensors)
            return monitor
    finally:
        # the recorder last: it writes down what the others say as they go
        for group in (sensors, ['analysis'], ['recorder']):
            stop(processes, group)
        if live and begun:
            _write_truth(bench, folder, live, begun[0])


def _write_truth(bench: BenchConfig, folder: Path, live: LiveTest, begin_s: float) -> None:
    """Write what is true about the recording beside it, as `imu-bench simulate` does."""
    from imu_bench.bench import simulate
    from imu_bench.simulation.recording import write_truth

    # what is played, or measured, does not know of the scenario
    emulated = [sensor for sensor in bench.sensors if sensor.backend == 'emulated']
    sensors = [simulate(sensor, live.scenario) for sensor in emulated]
    begin_ns = round(begin_s * 1e9)
    write_truth(folder, sensors, live.scenario, live.duration_s, start_ns=begin_ns)


def _start(
    bench: BenchConfig, folder: Path, processes: BenchProcesses, moved: Mapping[str, Any]
) -> None:
    from imu_bench.config.location import config_file
    from imu_bench.nodes import bench_nodes

    bench_nodes.start_recorder(processes, folder / 'bag', bench.recorder.storage)
    bench_nodes.start_analysis(processes, bench, config_file('analysis.yaml'))
    bench_nodes.start_sensors(processes, bench, folder / 'log', moved)


def _verdicts(monitor: BenchMonitor) -> int:
    """Say of every sensor whether it kept its rate; return 1 if one gave no data at all."""
    print()
    for sensor in monitor.sensors.values():
        print(f'{sensor.name}: {sensor.verdict}')
    print()
    return int(not all(sensor.publishing for sensor in monitor.sensors.values()))


def _analyse(folder: Path, plan: list[str]) -> int:
    from imu_bench.cli.main import main

    report = folder / 'report.html'
    outputs = ['--html', str(report), '--json', str(folder / 'results.json')]
    code = main(['analyze', str(folder / 'bag'), *plan, *outputs])
    if code == 0:
        print(f'report: {report.resolve()}')
    return code
