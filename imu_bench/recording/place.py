# SPDX-License-Identifier: Apache-2.0
"""Where a recording goes, how long it takes, and what is done with it afterwards."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
import shlex
from typing import TYPE_CHECKING

from imu_bench.errors import ConfigError
from imu_bench.offline.notation import count, duration

if TYPE_CHECKING:
    from imu_bench.config import BenchConfig
    from imu_bench.config.campaign import BenchTest


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
