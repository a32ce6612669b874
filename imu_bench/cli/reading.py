# SPDX-License-Identifier: Apache-2.0
"""What a user may say about recordings, for every verb that reads them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imu_bench.offline.recordings import ReadOptions


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add what says which recordings, and how to read them."""
    parser.add_argument(
        'inputs', nargs='+', metavar='INPUT', help='bag, text file, arrays, or a folder of them'
    )
    parser.add_argument(
        '--topic', action='append', default=[], metavar='T', help='only this topic (repeatable)'
    )
    parser.add_argument(
        '--rate', type=float, metavar='HZ', help='sample rate of a text file without a time column'
    )
    parser.add_argument(
        '--columns', metavar='NAMES', help='columns of a text file: names in order, - to ignore'
    )
    parser.add_argument(
        '--units', metavar='NAME=UNIT,…', help='units of the columns, as in angular_velocity=deg/s'
    )


def read_options(arguments: argparse.Namespace) -> ReadOptions:
    """
    Return what the user has said.

    Raises
    ------
    RecordingError
        If the rate makes no sense.
    """
    # imported here: help must not wait for scipy
    from imu_bench.offline.recordings import ReadOptions

    return ReadOptions(
        topics=tuple(arguments.topic),
        rate_hz=arguments.rate,
        columns=arguments.columns,
        units=arguments.units,
    )
