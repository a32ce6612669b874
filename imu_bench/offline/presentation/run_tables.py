# SPDX-License-Identifier: Apache-2.0
"""The comparison of runs: its tables, and what it says on the whole."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
import math

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.runs import Change, RunComparison
from imu_bench.offline.notation import (
    count,
    number,
    percent,
    rate_text,
    text,
    unit_of,
    value_text,
)
from imu_bench.offline.presentation.tables import Column, Shown, Table
from imu_bench.units import convert

ALL = ('axis', 'parameter', 'reference', 'value', 'difference', 'ratio', 'e_n', 'verdict')
ON_PAGE = ('axis', 'parameter', 'verdict', *ALL[2:-1])
"""The verdict first: a page may be narrow, and then what is on the right is out of sight."""

NARROW = ('axis', 'parameter', 'change', 'verdict')
"""Columns where there is little room: the ratio, or the difference of what has none."""

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


def table(compared: RunComparison, sensor: str, run: str, columns: Sequence[str] = ALL) -> Table:
    """
    Return a sensor in one run against the reference.

    Parameters
    ----------
    columns : sequence of str
        `ALL`, or `NARROW`.
    """
    reference = compared.runs[0].name
    titles = {'reference': reference, 'value': run, 'e_n': 'E_n'}
    lines = [line for line in compared.lines if (line.sensor, line.run) == (sensor, run)]
    units = units_of(compared.lines)
    return Table(
        f'{run} against {reference}',
        tuple(Column(titles.get(name, name)) for name in columns),
        tuple(tuple(map(row(line, units).__getitem__, columns)) for line in lines),
        _doubts(compared, sensor, (reference, run)),
        heads=2,
    )


def units_of(lines: Sequence[Change]) -> dict[tuple[str, str], str]:
    """Return one unit for all numbers of a parameter, so that they can be read down a column."""
    found: dict[tuple[str, str], list[Estimate]] = {}
    for line in lines:
        key = line.parameter, line.reference.unit
        found.setdefault(key, []).extend((line.reference, line.value))
    return {
        key: unit_of(numbers, _ROLES[key[0]]) for key, numbers in found.items() if key[0] in _ROLES
    }


def _doubts(compared: RunComparison, sensor: str, runs: Sequence[str]) -> str:
    """Return which findings affect the numbers of a table."""
    said = [
        f'{run}: {_codes(compared.doubted[sensor, run])}'
        for run in runs
        if (sensor, run) in compared.doubted
    ]
    return f'Findings that affect these numbers: {"; ".join(said)}.' if said else ''


def _codes(recording: RecordingResult) -> str:
    severity = recording.health.severity
    codes = (f.code for f in recording.health.findings if f.severity == severity)
    return f'{severity}, {", ".join(dict.fromkeys(codes)).replace("_", " ")}'


def row(line: Change, units: Mapping[tuple[str, str], str]) -> dict[str, str | Shown]:
    """Return the cells of one line by the names in `ALL`, in the units of `units_of`."""
    if line.parameter == 'rate':
        shown = [rate_text(line.reference), rate_text(line.value), _drift(line), '–']
    else:
        unit = units.get((line.parameter, line.reference.unit), line.reference.unit)
        shown = [
            text(line.reference, unit),
            text(line.value, unit),
            _signed(line.difference, unit),
            '–' if line.ratio.value is None else value_text(line.ratio),
        ]
    shown.append('–' if line.e_n is None else f'{line.e_n:+.2f}')
    cells: dict[str, str | Shown] = dict(zip(ALL[2:-1], map(Shown, shown), strict=True))
    return cells | {
        'axis': line.axis or 'sensor',
        'parameter': _TITLES[line.parameter],
        'change': cells['difference'] if shown[3] == '–' else Shown(f'× {shown[3]}'),
        'verdict': Shown(line.verdict, kind=f'verdict-{line.verdict}'),
    }


def _drift(line: Change) -> str:
    """Return how a clock changed: nobody reads eleven digits, but everybody parts per million."""
    difference, reference = line.difference.value, line.reference.value
    return '–' if difference is None or not reference else _ppm(difference / reference)


def _ppm(share: float) -> str:
    """Return a share in parts per million; what is below 0.001 ppm is rounding of stamps."""
    shown = round(1e6 * share, 3)
    return f'{"+" if shown > 0.0 else ""}{number(shown, 3)} ppm'


def summary(compared: RunComparison) -> list[str]:
    """Return what the comparison says, a sentence each."""
    verdicts = Counter(line.verdict for line in compared.lines)
    words = [f'{verdicts[v]} {v}' for v in ('same', 'higher', 'lower', 'undecided') if verdicts[v]]
    lines = [f'{count(len(compared.lines), "number")} compared: {", ".join(words)}.']
    changed = verdicts['higher'] + verdicts['lower']
    by_chance = round(_chance(compared.lines))
    if changed and by_chance:
        lines.append(
            f'Chance alone calls about {min(by_chance, changed)} of these higher or lower.'
        )
    largest = _largest(compared.lines)
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
    severe = [
        f'{sensor} in {run} ({_codes(recording)})'
        for (sensor, run), recording in compared.doubted.items()
        if recording.health.severity == 'severe'
    ]
    if severe:
        lines.insert(0, f'Not to be trusted without reading the findings: {"; ".join(severe)}.')
    elif compared.doubted:
        doubted = ', '.join(f'{sensor} in {run}' for sensor, run in compared.doubted)
        lines.append(f'Findings affect part of the numbers of {doubted}.')
    for run, sensor in compared.unmatched:
        lines.append(f'{sensor} of {run} has no counterpart.')
    return lines


def _chance(lines: Sequence[Change]) -> float:
    """Return how many equal numbers are expected outside of their intervals."""
    return sum(1.0 - line.difference.confidence for line in lines if line.e_n is not None)


def _largest(lines: Sequence[Change]) -> Change | None:
    """Return the line of the largest certain ratio, up or down."""
    certain = [line for line in lines if line.verdict in ('higher', 'lower') and line.ratio.value]
    return max(certain, key=lambda line: abs(math.log(line.ratio.value or 1.0)), default=None)


def _signed(difference: Estimate, unit: str) -> str:
    """Return a difference with its sign, the half width of its interval, and the unit."""
    if difference.value is None:
        return '–'
    factor = convert(1.0, difference.unit, unit)
    sign = '+' if difference.value > 0.0 else ''
    if difference.low is None or difference.high is None:
        return f'{sign}{number(difference.value * factor, 3)} {unit}'
    return f'{sign}{text(difference.scaled(factor, unit))}'
