# SPDX-License-Identifier: Apache-2.0
"""`imu-bench demo`: a whole bench on emulated sensors, live, recorded, then analysed."""

from __future__ import annotations

import argparse
from collections import Counter
from datetime import datetime
import os
from pathlib import Path
import shlex
import signal
from typing import TYPE_CHECKING

from imu_bench.cli.record import conclude
from imu_bench.errors import ConfigError
from imu_bench.terminal.arguments import add_network, duration
from imu_bench.terminal.words import DONE, FAULT

if TYPE_CHECKING:
    from imu_bench.config import BenchConfig
    from imu_bench.config.campaign import BenchTest
    from imu_bench.recording.judgement import Judgement
    from imu_bench.recording.session import Plan
    from imu_bench.recording.trial import LiveTest

BENCH, FAULTY_BENCH = 'machine_vibration', 'faults'
DURATION_S = 60.0
AFTER_FAULTS_S = 6.0
"""So long the demo goes on behind its last fault."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser(
        'demo', help='run a bench of emulated sensors under ROS 2, record it, analyse it'
    )
    parser.add_argument(
        'bench',
        nargs='?',
        help=f'a bench of config/benches or a YAML, also of one sensor (default {BENCH})',
    )
    parser.add_argument(
        '--duration',
        type=_worthwhile,
        metavar='T',
        help=f'such as 90 or 2min (default {DURATION_S:g} s)',
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
    add_network(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """
    Run the demo: record a bench, then analyse it; return 0 if both went well.

    With faults every one of them has to be recovered from, too.
    """
    # a shell makes its background jobs ignore it; who sends it means it, also before all is up
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # imported here: help must not wait for scipy and ROS 2
    from imu_bench.bench import as_tested, load_bench
    from imu_bench.config.location import config_file
    from imu_bench.nodes import network
    from imu_bench.nodes.spinning import require_ros
    from imu_bench.recording.session import Plan, Session

    require_ros()
    chosen = args.bench or (FAULTY_BENCH if args.faults else BENCH)
    name = chosen if chosen.endswith('.yaml') else f'benches/{chosen}.yaml'
    bench = load_bench(config_file(name))
    duration_s = args.duration or (_faults_over_s(bench) if args.faults else DURATION_S)
    live = _live_test(bench, args, duration_s)
    if live is not None:
        duration_s = live.duration_s
        bench = as_tested(bench, live.test) if live.test else bench
    folder = _new_folder(args.output)
    chosen = network.variables(args.network or network.ALONE)
    domain = _domain()
    who = network.words(chosen)
    print(f'{bench.title or bench.name}: {kinds(bench)}, {duration_s:g} s, {who}')
    if live is not None:
        print(f'{f"test {live.test.name}" if live.test else "no test"}: {live.remark}')
    print(network.for_other_shells({**os.environ, **chosen, 'ROS_DOMAIN_ID': domain}))
    print(f'recording into {folder}/bag', flush=True)
    plan = Plan(
        folder / 'bag',
        bench.recorder.storage,
        duration_s,
        bench,
        logs=folder / 'log',
        analysis=config_file('analysis.yaml'),
        test=live,
        faults=args.faults,
        ros={'ROS_DOMAIN_ID': domain},
        network=args.network or network.ALONE,
    )
    judgement = Session(plan).run()
    return _conclude(judgement, folder, plan)


def _conclude(judgement: Judgement, folder: Path, plan: Plan) -> int:
    """Say how it went, analyse what was recorded, and return the exit code."""
    from imu_bench.terminal.tables import show_faults, show_gaps

    analysis = plan.test.analysis() if plan.test else []
    report, results = folder / 'report.html', folder / 'results.json'
    outputs = ['--html', str(report), '--json', str(results)]
    command = ['imu-bench', 'analyze', str(folder / 'bag'), *analysis, *outputs]
    failed = conclude(judgement, plan.duration_s, shlex.join(command))
    if plan.faults:
        print()
        failed = max(show_faults(judgement.sensors), failed)
    if judgement.asked not in ('', 'SIGINT'):  # who ends a service or a terminal does not wait
        return failed
    print()
    code = _analyse(folder, plan.test.test if plan.test else None)
    print(f'report: {report.resolve()}')
    if plan.faults:
        show_gaps(results, judgement.sensors)
    return max(code, failed)


def _analyse(folder: Path, test: BenchTest | None) -> int:
    """Analyse the bag, by the plan of the test if there is one; show and write the results."""
    from imu_bench import offline
    from imu_bench.offline.comparing.sensors import compare
    from imu_bench.offline.running import one_thread_each
    from imu_bench.terminal import tables, working
    from imu_bench.terminal.progress import Bar

    one_thread_each()
    if test is not None:
        result = working.run_test_plan(test, [folder / 'bag'], folder)
        tables.show_plan(result)
        return FAULT if result.failures else DONE
    with working.team() as team, Bar() as bar:
        analysis = offline.analyze([folder / 'bag'], workers=team, watch=working.watch(bar))
    offline.write_results(analysis, folder / 'results.json')
    offline.write_report(analysis, folder / 'report.html')
    tables.show(analysis, compare(analysis.recordings))
    return FAULT if analysis.failed else DONE


def kinds(bench: BenchConfig) -> str:
    """Say how many sensors there are and what stands behind them."""
    from imu_bench.counting import count

    found = Counter(sensor.backend for sensor in bench.sensors)
    if len(found) == 1:
        return count(len(bench.sensors), f'{next(iter(found))} sensor')
    listed = ', '.join(f'{number} {kind}' for kind, number in found.items())
    return f'{count(len(bench.sensors), "sensor")} ({listed})'


def _live_test(bench: BenchConfig, args: argparse.Namespace, most_s: float) -> LiveTest | None:
    """Return what moves the bench; None if it stands still as its sensors' files say."""
    from imu_bench.recording.trial import of_scenario, of_test

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


def _worthwhile(text: str) -> float:
    """Return a duration that is worth a demo."""
    value = duration(text)
    if not 1.0 <= value <= 7 * 86400.0:
        raise argparse.ArgumentTypeError(f'{text} is not between 1 s and a week')
    return value


def _new_folder(wanted: Path | None) -> Path:
    folder = wanted or Path(f'demo_{datetime.now():%Y%m%d_%H%M%S}')
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f'{folder}: exists and is not empty; name another folder with -o')
    (folder / 'log').mkdir(parents=True)
    return folder


def _domain() -> str:
    """Return the ROS domain of the user, or one of the demo's own."""
    # 0 to 101 are safe on Linux (ROS 2 documentation, "The ROS_DOMAIN_ID")
    return os.environ.get('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
