# SPDX-License-Identifier: Apache-2.0
"""Findings about tones: mains hum, fans, resonances."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.notation import number

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
    """
    Yield one finding for all tones of a recording.

    Parameters
    ----------
    tones : mapping of str to sequence of (Estimate, Estimate)
        Frequency and amplitude of each tone, by axis.
    std : mapping of str to float
        Standard deviation, by axis.
    unsteady : collection of str
        Axes whose noise changed: of a crowd of tones on them only the strong ones count.
    """
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
    named = '; '.join(
        f'{number(frequency, 3)} Hz{_origin(frequency)} in {axis}, amplitude '
        f'{number(amplitude.value or 0.0, 2)} {amplitude.unit}'
        for _, frequency, amplitude, axis in rows[:_NAMED]
    )
    more = f' and {len(rows) - _NAMED} more' if len(rows) > _NAMED else ''
    yield Finding(
        'warning' if rows[0][0] > _STRONG else 'info',
        'tones',
        f'Tones: {named}{more}.',
        'A tone adds to σ and makes waves in the Allan deviation near half its period; N comes '
        'out too high where it dominates.',
        'Find the source (mains, fan, resonance of the mount), or move the sensor away from it.',
    )


def _origin(frequency: float) -> str:
    for mains in _MAINS_HZ:
        if abs(frequency / mains - 1.0) < _MAINS_WIDTH:
            return ' (mains)'
    return ''
