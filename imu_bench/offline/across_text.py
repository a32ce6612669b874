# SPDX-License-Identifier: Apache-2.0
"""Words for the comparison of runs: the cells of its tables and what it says on the whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import math
from typing import NamedTuple

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.across import Across, Line
from imu_bench.offline.notation import (
    count,
    number,
    percent,
    rate_text,
    readable_unit,
    text,
    value_text,
)
from imu_bench.units import convert

_TITLES = {
    'rate': 'sample rate',
    'mean': 'bias',
    'std': 'σ',
    'noise_density': 'noise density',
    'B': 'bias instability B',
    'K': 'rate random walk K',
}
_ROLES = {'mean': 'level', 'std': 'level', 'noise_density': 'density', 'B': 'B', 'K': 'K'}

_SMALL = 0.05  # a ratio closer to one is not worth a sentence


class Row(NamedTuple):
    """One line of a table: all cells as text, values in the unit that suits both."""

    axis: str
    parameter: str
    reference: str
    value: str
    difference: str
    ratio: str
    e_n: str
    verdict: str

    @property
    def change(self) -> str:
        """The ratio, or the difference of what has none."""
        return self.difference if self.ratio == '–' else self.ratio


def row(line: Line) -> Row:
    """Return the cells of one line."""
    if line.parameter == 'rate':
        return _rate(line)
    unit = line.reference.unit
    if line.parameter in _ROLES:
        sizes = [e.value if e.value is not None else e.high
                 for e in (line.reference, line.value)]  # fmt: skip
        unit = readable_unit(unit, _ROLES[line.parameter], sizes)
    return Row(
        line.axis or 'sensor',
        _TITLES[line.parameter],
        text(line.reference, unit),
        text(line.value, unit),
        _signed(line.difference, unit),
        '–' if line.ratio.value is None else f'{value_text(line.ratio)}',
        '–' if line.e_n is None else f'{line.e_n:+.2f}',
        line.verdict,
    )


def _rate(line: Line) -> Row:
    """Return the cells of a clock: nobody reads eleven digits, but everybody parts per million."""
    difference, reference = line.difference.value, line.reference.value
    known = difference is not None and reference
    return Row(
        line.axis or 'sensor',
        _TITLES[line.parameter],
        rate_text(line.reference),
        rate_text(line.value),
        _ppm((difference or 0.0) / (reference or 1.0)) if known else '–',
        '–',
        '–' if line.e_n is None else f'{line.e_n:+.2f}',
        line.verdict,
    )


def _ppm(share: float) -> str:
    """Return a share in parts per million; what is below 0.001 ppm is rounding of stamps."""
    shown = round(1e6 * share, 3)
    return f'{"+" if shown > 0.0 else ""}{number(shown, 3)} ppm'


def summary(across: Across) -> list[str]:
    """Return what the comparison says, a sentence each."""
    verdicts = Counter(line.verdict for line in across.lines)
    words = [f'{verdicts[v]} {v}' for v in ('same', 'higher', 'lower', 'undecided') if verdicts[v]]
    lines = [f'{count(len(across.lines), "number")} compared: {", ".join(words)}.']
    changed = verdicts['higher'] + verdicts['lower']
    by_chance = round(_chance(across.lines))
    if changed and by_chance:
        lines.append(
            f'Chance alone calls about {min(by_chance, changed)} of these higher or lower.'
        )
    largest = _largest(across.lines)
    if largest is not None:
        ratio = largest.ratio.value or 1.0
        of = f'{_TITLES[largest.parameter]} of {largest.axis or "the clock"} of {largest.sensor}'
        if abs(math.log(ratio)) < _SMALL:
            lines.append(f'No change beyond its uncertainty is larger than {percent(_SMALL)}.')
        else:
            lines.append(
                f'Largest change beyond its uncertainty: {of} is {number(ratio, 3)} times as '
                f'large in {largest.run}.'
            )
    for run, sensor in across.unmatched:
        lines.append(f'{sensor} of {run} has no counterpart.')
    return lines


def _chance(lines: Sequence[Line]) -> float:
    """Return how many equal numbers are expected outside of their intervals."""
    return sum(1.0 - line.difference.confidence for line in lines if line.e_n is not None)


def _largest(lines: Sequence[Line]) -> Line | None:
    """Return the line of the largest certain ratio, up or down."""
    certain = [line for line in lines if line.verdict in ('higher', 'lower') and line.ratio.value]
    return max(certain, key=lambda line: abs(math.log(line.ratio.value or 1.0)), default=None)


def _signed(difference: Estimate, unit: str) -> str:
    """Return a difference with its sign, and the half width of its interval."""
    if difference.value is None:
        return '–'
    factor = convert(1.0, difference.unit, unit)
    sign = '+' if difference.value > 0.0 else ''
    if difference.low is None or difference.high is None:
        return f'{sign}{number(difference.value * factor, 3)}'
    return f'{sign}{value_text(difference.scaled(factor, unit))}'
