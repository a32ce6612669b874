# SPDX-License-Identifier: Apache-2.0
"""What the health check says: one finding is one sentence of fact, effect and advice each."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imu_bench.counting import listed
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.typed import fields_of
from imu_bench.offline.notation import number

SEVERITIES = ('info', 'warning', 'severe')
"""In rising order: worth knowing; some results are affected; results are not to be trusted."""


@dataclass(frozen=True)
class Finding:
    """One thing that was found in a recording."""

    severity: str  # one of `SEVERITIES`
    code: str  # short fixed name for scripts, for example 'gaps'
    text: str  # what was found, with numbers and where
    effect: str  # what it does to the results
    action: str  # what to do about it
    # how many samples or messages it is about, where that is known exactly
    count: int | None = None
    # at which border they were lost, as `imu_bench.account` names it; empty for others
    border: str = ''

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object of schema imu_bench.analysis/1."""
        return fields_of(self, but=('count', 'border') if self.count is None else ())


def worst(findings: tuple[Finding, ...]) -> str:
    """Return the highest severity among findings; 'info' when there are none."""
    return max((f.severity for f in findings), key=SEVERITIES.index, default='info')


FALSE_ALARM = 1e-4
"""Probability that the noise of one axis shows a tone: a recording has six axes."""

_MAINS_HZ = (50.0, 60.0, 100.0, 120.0)
_MAINS_WIDTH = 0.01  # relative; covers the clock of the sensor, mains itself is held to 0.4 %
_STRONG = 0.1  # share of the variance of the axis: σ comes out 5 % too high
_NAMED = 4
_CROWD = 12
"""Tones of one axis: a knock has a spectrum of its own, and each of its lines looks like one."""


def tone_findings(
    tones: Mapping[str, Sequence[tuple[Estimate, Estimate]]],
    std: Mapping[str, float],
    unsteady: Collection[str] = (),
) -> Iterator[Finding]:
    """Yield one finding for all tones of a recording."""
    rows = []
    for axis, found in tones.items():
        for frequency, amplitude in found:
            if frequency.value is None or amplitude.value is None or not std[axis]:
                continue
            share = 0.5 * (amplitude.value / std[axis]) ** 2
            if axis in unsteady and len(found) > _CROWD and share <= _STRONG:
                continue
            rows.append((share, frequency.value, amplitude, axis))
    if not rows:
        return
    rows.sort(key=lambda row: -row[0])
    named = [
        f'{number(frequency, 3)} Hz{_origin(frequency)} in {axis}, amplitude '
        f'{number(amplitude.value or 0.0, 2)} {amplitude.unit}'
        for _, frequency, amplitude, axis in rows
    ]
    yield Finding(
        'warning' if rows[0][0] > _STRONG else 'info',
        'tones',
        f'Tones: {listed(named, _NAMED, "; ")}.',
        'A tone adds to σ and makes waves in the Allan deviation near half its period; N comes '
        'out too high where it dominates.',
        'Find the source (mains, fan, resonance of the mount), or move the sensor away from it.',
    )


def _origin(frequency: float) -> str:
    for mains in _MAINS_HZ:
        if abs(frequency / mains - 1.0) < _MAINS_WIDTH:
            return ' (mains)'
    return ''
