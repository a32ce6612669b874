# SPDX-License-Identifier: Apache-2.0
"""Values of options that several verbs take."""

from __future__ import annotations

import argparse
import re

from imu_bench.errors import UnitError

_LONGEST_S = 366 * 86400.0


def duration(text: str) -> float:
    """
    Return seconds from a text such as '14h' or '20 min'; a bare number is seconds.

    Examples
    --------
    >>> duration('14h'), duration('90'), duration('1.5 min')
    (50400.0, 90.0, 90.0)
    """
    from imu_bench.units import convert

    match = re.fullmatch(r'\s*([0-9.]+(?:e[+-]?\d+)?)\s*(.*?)\s*', text)
    try:
        if match is None:
            raise ValueError
        seconds = convert(float(match[1]), match[2] or 's', 's')
    except (UnitError, ValueError):
        raise argparse.ArgumentTypeError(
            f'{text!r} is no duration; write a number and s, min or h, such as 14h'
        ) from None
    if not 0.1 <= seconds <= _LONGEST_S:
        raise argparse.ArgumentTypeError(f'{text} is not between 0.1 s and 366 days')
    return seconds
