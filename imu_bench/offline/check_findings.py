# SPDX-License-Identifier: Apache-2.0
"""Findings that only the finished analysis of the axes can make."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.health.hum import tone_findings
from imu_bench.offline.notation import number

_NAMED = 4

_SHAKEN = 10.0
"""Factor by which the noise of no sensor changes by itself, be it warm or cold."""


def axis_findings(
    axes: Sequence[AxisResult], *, moved: bool, coarse: Collection[str] = ()
) -> Iterator[Finding]:
    """
    Yield what the axes of one recording show.

    Parameters
    ----------
    axes : sequence of AxisResult
    moved : bool
        Whether the sensor moved so much that the noise is known to be something else: then only
        tones are worth a word.
    coarse : collection of str
        Axes whose noise is known to be below their resolution: what else is odd about it follows
        from that.
    """
    yield from tone_findings(
        {axis.name: axis.psd.tones for axis in axes if axis.psd is not None},
        {axis.name: axis.statistics['std'].value or 0.0 for axis in axes},
        [name for _, name in _changing(axes)],
    )
    if not moved:
        sound = [axis for axis in axes if axis.name not in coarse]
        yield from _unsteady(sound)
        yield from _disputed(sound)


def _changing(axes: Sequence[AxisResult]) -> list[tuple[Estimate, str]]:
    """Return the axes whose noise changed, and by which factor."""
    found: list[tuple[Estimate, str]] = []
    for axis in axes:
        steady = axis.checks and axis.checks.steadiness
        if steady and steady.verdict == 'changes':
            found.append((steady.ratio, axis.name))
    return found


def _unsteady(axes: Sequence[AxisResult]) -> Iterator[Finding]:
    found = _changing(axes)
    if not found:
        return
    found.sort(key=lambda row: -(row[0].value or 0.0))
    named = _listed(f'{name} by a factor of {number(e.value or 1.0, 2)}' for e, name in found)
    shaken = (found[0][0].value or 1.0) >= _SHAKEN
    yield Finding(
        'severe' if shaken else 'warning',
        'unsteady_noise',
        f'The noise changed during the recording: {named}.',
        'The coefficients describe what shook the sensor for a while, not the sensor.'
        if shaken
        else 'One set of coefficients describes an average that held at no time; their intervals '
        'are too narrow.',
        'Look at the noise over time in the report; analyse the steady part with --start and '
        '--end.',
    )


def _disputed(axes: Sequence[AxisResult]) -> Iterator[Finding]:
    found = [
        f'{", ".join(axis.checks.second.disputed)} of {axis.name}'
        for axis in axes
        if axis.checks and axis.checks.second and axis.checks.second.disputed
    ]
    if not found:
        return
    yield Finding(
        'warning',
        'methods_disagree',
        f'The spectrum contradicts the Allan deviation on {_listed(found)}.',
        'The data hold more than the noise of the model (vibration, steps, temperature): these '
        'coefficients depend on the method, and their intervals are too narrow.',
        'Look at the spectrum and the time series before using them.',
    )


def _listed(words: Iterable[str]) -> str:
    rows = list(words)
    more = f' and {len(rows) - _NAMED} more' if len(rows) > _NAMED else ''
    return f'{"; ".join(rows[:_NAMED])}{more}'
