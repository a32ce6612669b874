# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs take: durations, recordings and how to read them, outputs."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import os
from pathlib import Path
import re
from typing import TYPE_CHECKING

from imu_bench.errors import RecordingError, UnitError

if TYPE_CHECKING:
    from imu_bench.offline.recordings import ReadOptions

_LONGEST_S = 366 * 86400.0


def moment(text: str) -> float:
    """
    Return seconds from a text such as '14h' or '20 min'; a bare number is seconds.

    Examples
    --------
    >>> moment('14h'), moment('0'), moment('1.5 min')
    (50400.0, 0.0, 90.0)
    """
    from imu_bench.units import convert

    match = re.fullmatch(r'\s*([0-9.]+(?:e[+-]?\d+)?)\s*(.*?)\s*', text)
    try:
        if match is None:
            raise ValueError
        return convert(float(match[1]), match[2] or 's', 's')
    except (UnitError, ValueError):
        raise argparse.ArgumentTypeError(
            f'{text!r} is no duration; write a number and s, min or h, such as 14h'
        ) from None


def duration(text: str) -> float:
    """Return the seconds of `moment` if something can last so long."""
    seconds = moment(text)
    if not 0.1 <= seconds <= _LONGEST_S:
        raise argparse.ArgumentTypeError(f'{text} is not between 0.1 s and 366 days')
    return seconds


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add what says which recordings, and how to read them."""
    parser.add_argument(
        'inputs', nargs='+', metavar='INPUT', help='bag, text file, arrays, or a folder of them'
    )
    parser.add_argument(
        '--topic', action='append', default=[], metavar='T',
        help='only this topic, or that of the sensor with this name (repeatable)',
    )  # fmt: skip
    parser.add_argument(
        '--rate', type=float, metavar='HZ', help='sample rate of a text file without a time column'
    )
    parser.add_argument(
        '--layout', type=int, default=0, metavar='N',
        help='numbers of a sample in a text file whose lines are no rows: all on one line, say',
    )  # fmt: skip
    parser.add_argument(
        '--columns', metavar='NAMES', help='columns of a text file: names in order, - to ignore'
    )
    parser.add_argument(
        '--units', metavar='NAME=UNIT,…', help='units of the columns, as in angular_velocity=deg/s'
    )


def read_options(arguments: argparse.Namespace) -> ReadOptions:
    """Return what the user has said."""
    # imported here: help must not wait for scipy
    from imu_bench.offline.recordings import ReadOptions

    return ReadOptions(
        topics=tuple(arguments.topic),
        rate_hz=arguments.rate,
        columns=arguments.columns,
        layout=arguments.layout,
        units=arguments.units,
    )


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[str | Path] = ()) -> None:
    """Check that files can be written, each one another, and none of them over an input."""
    taken = {Path(path).resolve(): 'an input' for path in inputs}
    for path in outputs:
        if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
            continue  # a device or a pipe takes anything
        if path.is_dir():
            raise RecordingError(f'{path} is a folder: name a file to write')
        _check_parent(path)
        role = taken.setdefault(path.resolve(), '')
        if role:
            raise RecordingError(f'{path} is {role}, too: name another file to write')
        taken[path.resolve()] = 'another output'


def check_folder(path: Path) -> None:
    """Check that a folder can be written to, or made."""
    if path.exists() and not path.is_dir():
        raise RecordingError(f'{path} is a file: name a folder')
    _check_parent(path / 'file' if path.is_dir() else path)


def _check_parent(path: Path) -> None:
    if not path.parent.is_dir():
        raise RecordingError(f'{path}: the folder {path.parent} does not exist')
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise RecordingError(f'{path}: no permission to write in the folder {path.parent}')


def add_network(parser: argparse.ArgumentParser) -> None:
    """Add the option that opens the nodes of a bench to others."""
    parser.add_argument(
        '--network', default='', metavar='IFACE|all',
        help='let other machines reach the nodes, on this interface or on all (default: nobody '
        'but this machine)',
    )  # fmt: skip
