# SPDX-License-Identifier: Apache-2.0
"""`imu-bench record`: the sensors of a bench, or what others publish, into a bag."""

from __future__ import annotations

import argparse
from pathlib import Path
import signal
import sys
from typing import TYPE_CHECKING

from imu_bench.cli.arguments import duration
from imu_bench.cli.main import complain, DONE, FAULT

if TYPE_CHECKING:
    from imu_bench.cli.record_place import Place
    from imu_bench.cli.record_session import Ended
    from imu_bench.config import BenchConfig

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
        help='without a bench: only this topic (repeatable)',
    )  # fmt: skip
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3'), help="format of the bag (default the bench's)"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Record; return 0 if everything kept its rate to the end."""
    # a shell makes its background jobs ignore it; who sends it means it, also before all is up
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # imported here: help must not wait for scipy and ROS 2
    from imu_bench.cli import record_place, record_room
    from imu_bench.config.bench import RecorderConfig
    from imu_bench.nodes.spinning import require_ros

    config = None if arguments.bench is None else _load(arguments.bench)
    place = record_place.choose(arguments, config)
    require_ros()
    recorder = config.recorder if config else RecorderConfig()
    storage = arguments.storage or recorder.storage
    room = f'{record_room.size(record_room.free_bytes(place.bag))} free'
    if config is not None:
        per_second = record_room.bytes_per_second(config, storage)
        room = record_room.check(place.bag, per_second, place.duration_s)
    _announce(config, place, room)
    from imu_bench.cli.record_session import Session

    return _conclude(place, Session(place, storage, config, arguments.topic).run())


def _load(name: str) -> BenchConfig:
    """Return the bench of a name or a file; that of a sensor is a bench of one."""
    from imu_bench import bench
    from imu_bench.config import BenchConfig
    from imu_bench.config.bench import holds_parameters
    from imu_bench.config.files import read_yaml
    from imu_bench.config.location import named_file

    path = named_file('benches', name)
    if not holds_parameters(read_yaml(path)):
        return bench.load_bench(path)
    sensor = bench.load_sensor(path)
    return BenchConfig(
        name=sensor.name,
        sensors=(sensor,),
        files={sensor.name: path},
        overrides={sensor.name: {}},
    )


def _announce(config: BenchConfig | None, place: Place, room: str) -> None:
    """Say what is recorded where, before anything starts."""
    from imu_bench.offline.notation import count

    if config is not None:
        print(f'{config.title or config.name}: {count(len(config.sensors), "sensor")}')
        others = [sensor for sensor in config.sensors if not sensor.measured]
        if others:
            kinds = ' and '.join(sorted({sensor.backend for sensor in others}))
            names = ', '.join(sensor.name for sensor in others)
            which = 'all of them' if len(others) == len(config.sensors) else names
            print(f'{kinds}, these are not measurements: {which}', file=sys.stderr)
    if place.remark:
        print(place.remark)
    print(f'recording into {place.bag}; {room}', flush=True)


def _conclude(place: Place, ended: Ended) -> int:
    """Say what there is in the bag and what to do with it; return the exit code."""
    from imu_bench.cli.record_room import size, stored_bytes
    from imu_bench.cli.record_session import stored
    from imu_bench.offline.notation import count
    from imu_bench.offline.notation import duration as length

    counts = stored(place.bag)
    faults = [ended.failure] if ended.failure else []
    print()
    for row in ended.rows:
        messages = None if counts is None else counts.get(row.topic, 0)
        line, fault = row.verdict(messages, ended.at_s)
        print(line)
        faults += [fault] if fault else []
    if ended.recorder.dropped and not ended.failure:
        faults.append(f'{count(ended.recorder.dropped, "message")} dropped: the disk is too slow')
    total = 'not finished'
    if counts is not None:
        total = count(sum(counts.values()), 'message')
    else:
        faults.append('the bag was not finished, analyze reads it as it is')
    ran = length(round(ended.ran_s, 1))
    if place.duration_s is not None and ended.asked:
        ran += f' of {length(place.duration_s)}, stopped by {ended.asked}'
    print(f'{place.bag}: {total}, {size(stored_bytes(place.bag))}, {ran}')
    print(f'next: {place.following}')
    if faults:
        complain(f'{place.bag}: {"; ".join(faults)}')
    return FAULT if faults else DONE
