# SPDX-License-Identifier: Apache-2.0
"""Measured against the datasheet, in words and as a table: a line for the axes of a quantity."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.comparison import Verdict
from imu_bench.offline.notation import number, readable_unit
from imu_bench.offline.report.text import numbers

_ORDER = ('worse', 'better', 'as specified', 'not observable')
_SIGNALS = {'linear_acceleration': 'acceleration', 'angular_velocity': 'angular velocity'}


class Line(NamedTuple):
    """One parameter of one quantity of one sensor."""

    label: str
    parameter: str
    axes: str
    measured: str
    typical: str
    unit: str
    spread: str
    ratio: str
    verdict: str
    kind: str
    doubtful: bool
    source: str


def lines(verdicts: Sequence[Verdict], doubtful: Collection[str] = ()) -> list[Line]:
    """
    Return the table.

    Parameters
    ----------
    verdicts : sequence of Verdict
    doubtful : collection of str
        Labels of sensors with findings that affect the numbers.
    """
    return [_line(group, group[0].label in doubtful) for group in _groups(verdicts)]


def sources(verdicts: Sequence[Verdict]) -> list[str]:
    """Return where the typical values of each sensor come from."""
    found: dict[str, list[str]] = {}
    for verdict in verdicts:
        found.setdefault(verdict.label, []).append(verdict.source)
    return [f'{label}: {"; ".join(dict.fromkeys(said))}' for label, said in found.items()]


def summary(verdicts: Sequence[Verdict]) -> list[str]:
    """Return one sentence, or none without a datasheet."""
    if not verdicts:
        return []
    worse = [
        f'{group[0].label} ({_name(group[0])}{_axes(group, "worse")})'
        for group in _groups(verdicts)
        if any(verdict.verdict == 'worse' for verdict in group)
    ]
    good = sum(verdict.verdict in ('as specified', 'better') for verdict in verdicts)
    said = f'{good} of {len(verdicts)} numbers are as the datasheets say, or better'
    said += f'; worse: {", ".join(worse)}' if worse else ''
    unseen = sum(verdict.verdict == 'not observable' for verdict in verdicts)
    said += f'; {unseen} could not be observed' if unseen else ''
    return [f'{said}.']


def _groups(verdicts: Sequence[Verdict]) -> list[list[Verdict]]:
    found: dict[tuple[str, str, str], list[Verdict]] = {}
    for verdict in verdicts:
        quantity = verdict.axis.rpartition('.')[0]
        found.setdefault((verdict.label, quantity, verdict.parameter), []).append(verdict)
    return list(found.values())


def _line(group: Sequence[Verdict], doubtful: bool) -> Line:
    first = group[0]
    role = 'density' if first.parameter == 'noise density' else 'B'
    unit = readable_unit(first.measured.unit, role, [verdict.typical for verdict in group])
    measured = numbers([verdict.measured for verdict in group], unit)
    return Line(
        label=first.label,
        parameter=_name(first),
        axes=' / '.join(verdict.axis.rpartition('.')[2] for verdict in group),
        measured=measured.shown,
        spread=measured.spread,
        typical=' / '.join(dict.fromkeys(_typical(verdict, unit) for verdict in group)),
        unit=unit,
        ratio=' / '.join(_ratio(verdict) for verdict in group),
        verdict=_words(group),
        kind=min((verdict.verdict for verdict in group), key=_ORDER.index).replace(' ', '-'),
        doubtful=doubtful,
        source=first.source,
    )


def _name(verdict: Verdict) -> str:
    return f'{_SIGNALS[verdict.axis.rpartition(".")[0]]}, {verdict.parameter}'


def _typical(verdict: Verdict, unit: str) -> str:
    given = Estimate(verdict.typical, None, None, verdict.measured.unit)
    return number(given.to(unit).value or 0.0, 3)


def _ratio(verdict: Verdict) -> str:
    ratio = verdict.measured.value and verdict.measured.value / verdict.typical
    return number(ratio, 2) if ratio else '–'


def _words(group: Sequence[Verdict]) -> str:
    there = [kind for kind in _ORDER if any(verdict.verdict == kind for verdict in group)]
    if len(there) == 1:
        return there[0]
    return '; '.join(f'{kind}{_axes(group, kind)}' for kind in there)


def _axes(group: Sequence[Verdict], kind: str) -> str:
    """Return which axes are meant, if it is not all of them."""
    letters = [v.axis.rpartition('.')[2] for v in group if v.verdict == kind]
    return '' if len(letters) == len(group) else f' {", ".join(letters)}'
