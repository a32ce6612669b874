# SPDX-License-Identifier: Apache-2.0
"""`imu-bench record`: the sensors of a bench, or what others publish, into a bag."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
import os
from pathlib import Path
import signal
import sys
from typing import TYPE_CHECKING

from imu_bench.counting import clean
from imu_bench.errors import ConfigError
from imu_bench.terminal.arguments import add_network, duration
from imu_bench.terminal.words import complain, DONE, FAULT

if TYPE_CHECKING:
    from imu_bench.config import BenchConfig
    from imu_bench.recording.judgement import Judgement
    from imu_bench.recording.place import Place

_DESCRIPTION = """\
Starts the sensors of a bench and records them, shows how they do, and ends at the duration, at
Ctrl-C or at SIGTERM with a bag that is complete.  Without a bench it records the Imu topics that
others publish, with magnetic fields, temperatures and diagnostics."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'record', help='record the sensors of a bench, or the Imu topics of others',
        description=_DESCRIPTION,
    )  # fmt: skip
    parser.add_argument(
        'bench', nargs='?', metavar='BENCH',
        help='a bench of config/benches or a YAML file, also that of a single sensor',
    )  # fmt: skip
    parser.add_argument(
        '--duration', type=duration, metavar='T',
        help='such as 14h, 20min or 90s (default until Ctrl-C)',
    )  # fmt: skip
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '-o', '--output', type=Path, metavar='DIR', help='the bag (default recording_<time>)'
    )
    where.add_argument(
        '--into', type=Path, metavar='CAMPAIGN',
        help='the folder of a campaign: the next run of --test goes where '
        '`imu-bench campaign --recorded` looks for it',
    )  # fmt: skip
    parser.add_argument(
        '--test', metavar='NAME', help='a test of the bench: its duration, and its plan afterwards'
    )
    parser.add_argument(
        '--run', dest='run_name', metavar='NAME', help='with --into: this run, not the next'
    )
    parser.add_argument(
        '--topic', action='append', default=[], metavar='T',
        help='without a bench: only this topic, or that of the sensor with this name (repeatable)',
    )  # fmt: skip
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3'), help="format of the bag (default the bench's)"
    )
    parser.add_argument(
        '--direct', action='store_true',
        help='straight from the sensors into the bag, with no ROS in between: nobody can watch '
        'the topics; what is done where ROS 2 is not installed',
    )  # fmt: skip
    add_network(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Record; return 0 if everything kept its rate to the end."""
    # a shell makes its background jobs ignore it; who sends it means it, also before all is up
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # imported here: help must not wait for scipy and ROS 2
    from imu_bench.bench import as_tested, load_bench
    from imu_bench.config.bench import RecorderConfig
    from imu_bench.config.location import named_file
    from imu_bench.nodes import network
    from imu_bench.nodes.spinning import require_ros
    from imu_bench.recording import place as places

    config = None
    if arguments.bench is not None:
        config = load_bench(named_file('benches', arguments.bench))
    place = places.choose(arguments, config)
    if config is not None and arguments.test:
        config = as_tested(config, config.test(arguments.test))
    direct = config is not None and (arguments.direct or not _ros_or_say())
    if arguments.direct and config is None:
        raise ConfigError('--direct reads the sensors itself: name a bench, or leave it out')
    if not direct:
        require_ros()
    recorder = config.recorder if config else RecorderConfig()
    storage = arguments.storage or recorder.storage
    free = f'{places.size(places.free_bytes(place.bag))} free'
    if config is not None:
        per_second = places.bytes_per_second(config, storage)
        free = places.check(place.bag, per_second, place.duration_s)
    reached = arguments.network or (network.ALL if config is None else network.ALONE)
    variables = network.variables(reached)
    _announce(config, place, free, '' if direct else network.words(variables))
    if config is not None and not direct:
        print(network.for_other_shells({**os.environ, **variables}), flush=True)
    if config is not None and direct:
        from imu_bench.recording.direct import Session as DirectSession

        recorded = DirectSession(place.bag, storage, place.duration_s, config).run()
        return conclude(recorded, place.duration_s, place.following)
    from imu_bench.recording.session import Plan, Session

    topics = tuple(arguments.topic)
    plan = Plan(place.bag, storage, place.duration_s, config, topics, network=reached)
    return conclude(Session(plan).run(), place.duration_s, place.following)


def _ros_or_say() -> bool:
    """Return whether ROS 2 is installed; say what that means if it is not."""
    if find_spec('rclpy') is not None:
        return True
    print(
        'ROS 2 is not installed here: the sensors are recorded without it, and nobody can watch '
        'their topics',
        file=sys.stderr,
    )
    return False


def _announce(config: BenchConfig | None, place: Place, room: str, reached: str) -> None:
    """Say what is recorded where, before anything starts."""
    from imu_bench.offline.notation import count

    if config is not None:
        what = [count(len(config.sensors), 'sensor'), *filter(None, [reached])]
        print(f'{config.title or config.name}: {", ".join(what)}')
        others = [sensor for sensor in config.sensors if not sensor.measured]
        if others:
            kinds = ' and '.join(sorted({sensor.backend for sensor in others}))
            names = ', '.join(sensor.name for sensor in others)
            which = 'all of them' if len(others) == len(config.sensors) else names
            print(f'{kinds}, these are not measurements: {which}', file=sys.stderr)
    if place.remark:
        print(place.remark)
    print(f'recording into {place.bag}; {room}', flush=True)


def conclude(judgement: Judgement, wanted_s: float | None, following: str) -> int:
    """Say what there is in the bag and what to do with it; return the exit code."""
    print()
    for line in judgement.lines:
        print(clean(line))
    print(judgement.total(wanted_s))
    print(f'next: {following}')
    if judgement.faults:
        complain(f'{judgement.bag}: {"; ".join(judgement.faults)}')
    return FAULT if judgement.faults else DONE
