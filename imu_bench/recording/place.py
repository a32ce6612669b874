# SPDX-License-Identifier: Apache-2.0
"""Where a recording goes, how long it takes, whether there is room, and what follows it."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
import shlex
import shutil
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from imu_bench.errors import ConfigError, RecordingError
from imu_bench.offline.notation import count, duration

if TYPE_CHECKING:
    from imu_bench.config import BenchConfig
    from imu_bench.config.campaign import BenchTest
if TYPE_CHECKING:
    from imu_bench.config import BenchConfig


@dataclass(frozen=True)
class Place:
    """Where a recording goes."""

    bag: Path  # its folder, which does not exist yet
    duration_s: float | None  # None is as long as nobody ends it
    following: str  # the command to run next
    remark: str = ''  # what the user should know; may be empty


def choose(arguments: argparse.Namespace, bench: BenchConfig | None) -> Place:
    """
    Return where a recording goes.

    Raises
    ------
    ConfigError
        If the options do not go together, there is no such test or run, or the place is taken.
    """
    from imu_bench.recording.trial import plan_arguments

    _refuse_what_does_not_fit(arguments, bench)
    test = bench.test(arguments.test) if bench and arguments.test else None
    if arguments.into is not None and bench is not None and test is not None:
        return _into(arguments, test)
    bag = arguments.output or Path(f'recording_{datetime.now():%Y%m%d_%H%M%S}')
    if bag.exists():
        raise ConfigError(f'{bag}: exists already; name another folder with -o')
    length_s = arguments.duration or (test.duration_s if test else None)
    plan = plan_arguments(test) if test else []
    report = bag / 'report.html'
    following = _command('analyze', bag, *plan, '--html', report)
    return Place(bag, length_s, following, _remark(test, length_s) if test else '')


def _refuse_what_does_not_fit(arguments: argparse.Namespace, bench: BenchConfig | None) -> None:
    if bench is None:
        own = {'test': arguments.test, 'into': arguments.into, 'run': arguments.run_name}
        for option, value in own.items():
            if value is not None:
                raise ConfigError(f'--{option} is about a test of a bench; name the bench')
    elif arguments.topic:
        raise ConfigError(
            '--topic is for what others publish; leave the bench out, or leave --topic out'
        )
    elif arguments.into is not None and arguments.test is None:
        names = ', '.join(test.name for test in bench.tests) or 'none'
        raise ConfigError(
            f'--into {arguments.into}: which test? Give --test; bench {bench.name} has: {names}'
        )
    elif arguments.run_name is not None and arguments.into is None:
        raise ConfigError(f'--run {arguments.run_name}: give --into CAMPAIGN and --test, too')


def _into(arguments: argparse.Namespace, test: BenchTest) -> Place:
    """Return the folder of the next run of a campaign's test, or of the one that is named."""
    folder = arguments.into / test.name
    names = [run.name for run in test.runs()]
    left = [name for name in names if not (folder / name).exists()]
    name = arguments.run_name or (left[0] if left else '')
    if not name:
        raise ConfigError(
            f'{folder}: {_all(names)} recorded already; remove what is to be recorded again, or '
            'name another folder with --into'
        )
    if name not in names:
        known = ', '.join(names[:6]) + (', …' if names[6:] else '')
        raise ConfigError(f'--run {name}: test {test.name} has: {known}')
    bag = folder / name
    if bag.exists():
        raise ConfigError(f'{bag}: exists already; remove it to record this run again')
    length_s = arguments.duration or test.duration_s
    options = ['--test', test.name]
    if set(left) - {name}:
        following = _command('record', arguments.bench, '--into', arguments.into, *options)
    else:
        following = _command(
            'campaign', arguments.bench, *options, '--recorded', '-o', arguments.into
        )
    remark = _remark(test, length_s)
    if names[1:]:
        number = len(names) - len(left) + 1
        remark = f'run {name}, number {number} of {len(names)}; {remark}'
    return Place(bag, length_s, following, remark)


def _all(names: list[str]) -> str:
    return 'the run is' if len(names) == 1 else f'all {count(len(names), "run")} are'


def _remark(test: BenchTest, length_s: float | None) -> str:
    """Say which test it is, and whether somebody has to end it."""
    text = f'test {test.name}' + (f' ({test.title})' if test.title else '')
    if length_s is None:
        return f'{text}: takes as long as you take for it; end it with Ctrl-C'
    if test.duration_s is not None and length_s < test.duration_s:
        return f'{text}: {duration(length_s)} of its {duration(test.duration_s)}'
    return text


def _command(verb: str, *words: object) -> str:
    """Return a command that a shell takes."""
    return shlex.join(['imu-bench', verb, *map(str, words)])


REHEARSED_S = (2.0, 6.0)
"""Simulated lengths whose difference is what a second takes, without what a bag has once."""

MARGIN = 1.25
"""
What a live bag takes beside: diagnostics, and stamps that a clock gave.  Six emulated sensors
took 1.2 times what was simulated (machine_vibration as mcap, with the topics of the analysis).
"""

SHORTEST_S = 60.0
"""A disk that has no room for so much is full."""

RESERVE_S, RESERVE_BYTES, RESERVE_SHARE = 5.0, 1 << 20, 0.01
"""
Kept free, so that a bag can be finished: what comes in so many seconds, metadata, and the
summary of an mcap, which is 0.6 % of the smallest messages and less of others.
"""


def bytes_per_second(bench: BenchConfig, storage: str) -> float:
    """
    Return what a second of a bench takes in a bag, from a few simulated seconds of its sensors.

    Compression makes this depend on the sensors: 42 bytes per message on the average as mcap,
    376 as sqlite3, which rosbag2 does not compress.

    Raises
    ------
    ConfigError
        If settings of a sensor make no sense.
    """
    from imu_bench.bench import simulate
    from imu_bench.simulation.recording import write_bag
    from imu_bench.simulation.scenario import load_scenario

    scenario = load_scenario('still')
    sizes = []
    for length_s in REHEARSED_S:
        sensors = [simulate(sensor, scenario) for sensor in bench.sensors]
        with TemporaryDirectory() as folder:
            bag = Path(folder) / 'bag'
            write_bag(bag, sensors, scenario, length_s, storage=storage)
            sizes.append(stored_bytes(bag, '*_0.*'))
    return MARGIN * (sizes[1] - sizes[0]) / (REHEARSED_S[1] - REHEARSED_S[0])


def stored_bytes(bag: Path, pattern: str = '*') -> int:
    """Return the bytes of the files of a bag."""
    return sum(file.stat().st_size for file in bag.glob(pattern) if file.is_file())


def free_bytes(path: Path) -> int:
    """Return what is free on the disk where a path is, or will be."""
    place = path.absolute()
    while not place.exists():
        place = place.parent
    return shutil.disk_usage(place).free


def reserve(stored: float, per_second: float) -> float:
    """Return how much has to stay free, so that a bag of this size can be finished."""
    return RESERVE_BYTES + RESERVE_SHARE * stored + RESERVE_S * per_second


def check(bag: Path, per_second: float, length_s: float | None) -> str:
    """
    Say what a recording takes and what there is.

    Parameters
    ----------
    bag : Path
        Where it will be.
    per_second : float
        Bytes.
    length_s : float or None
        None is as long as nobody ends it.

    Raises
    ------
    RecordingError
        If it does not fit.
    """
    free = free_bytes(bag)
    usable = (free - RESERVE_BYTES) / ((1.0 + RESERVE_SHARE) * per_second) - RESERVE_S
    if length_s is None and usable >= SHORTEST_S:
        return f'{size(free)} free, room for about {duration(usable)}'
    wanted = SHORTEST_S if length_s is None else length_s
    needed = wanted * per_second + reserve(wanted * per_second, per_second)
    if needed > free:
        shorter = f', or record {usable:.0f} s at most' if usable >= SHORTEST_S else ''
        raise RecordingError(
            f'{bag}: {duration(wanted)} of recording take about {size(needed)}, and {size(free)} '
            f'are free there; make room, or name another disk{shorter}'
        )
    return f'about {size(needed)} of the {size(free)} that are free'


def size(count: float) -> str:
    """
    Return bytes as disks are sold by them.

    Examples
    --------
    >>> size(850), size(6_574_205), size(84.96e9)
    ('850 B', '6.6 MB', '85.0 GB')
    """
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000.0:
            return f'{count:.0f} B' if unit == 'B' else f'{count:.1f} {unit}'
        count /= 1000.0
    return f'{count:.1f} TB'
