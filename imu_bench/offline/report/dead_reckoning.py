# SPDX-License-Identifier: Apache-2.0
"""What the noise comes to: how far an angle or a speed is off that nothing corrects."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.notation import readable_unit
from imu_bench.offline.report.text import Numbers, numbers
from imu_bench.offline.results import RecordingResult
from imu_bench.samples import ANGULAR_VELOCITY, LINEAR_ACCELERATION
import numpy as np

TIMES_S = {'1 s': 1.0, '10 s': 10.0, '1 min': 60.0, '10 min': 600.0, '1 h': 3600.0}

_KINDS = ((ANGULAR_VELOCITY, 'Angle', 'rad'), (LINEAR_ACCELERATION, 'Speed', 'm/s'))
_UNKNOWN = Numbers('–', '')


class Row(NamedTuple):
    """One sensor, and its error after each of the times."""

    label: str
    errors: list[Numbers]


class DeadReckoning(NamedTuple):
    """The errors of all sensors of a kind."""

    title: str
    unit: str
    times: list[str]
    rows: list[Row]


def error_after(curve: DeviationCurve, seconds: float, unit: str) -> Estimate | None:
    """
    Return the error of the integral over a time, None beyond the ends of the curve.

    Parameters
    ----------
    curve : DeviationCurve
        Allan deviation of what is integrated.
    seconds : float
        How long it is integrated.
    unit : str
        Of the integral.

    Notes
    -----
    The bias is the mean of a rest just as long.  The Allan variance is half the mean square of
    the difference of two such means in a row (NIST SP 1065 (2008), eq. (7)), so the root mean
    square of the integral is √2 τ σ(τ), whatever the noise.  Between averaging times the curve
    is a straight line on logarithmic axes.

    Examples
    --------
    >>> from imu_bench.metrology.allan import deviation
    >>> white = np.random.default_rng(1).normal(0.0, 1e-3, 100_000)
    >>> found = error_after(deviation(white, 100.0, unit='rad/s'), 4.0, 'rad')
    >>> found.low < math.sqrt(2.0 * 4.0) * 1e-4 < found.high
    True
    """
    if not curve.tau.size or not curve.tau[0] <= seconds <= curve.tau[-1]:
        return None
    if not np.all(curve.low > 0.0):
        return None
    value, low, high = (
        math.sqrt(2.0)
        * seconds
        * math.exp(float(np.interp(math.log(seconds), np.log(curve.tau), np.log(part))))
        for part in (curve.deviation, curve.low, curve.high)
    )
    return Estimate(value, low, high, unit, curve.confidence, method='Allan deviation')


def tables(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> list[DeadReckoning]:
    """
    Return the errors of gyroscopes and accelerometers, the smallest after the longest first.

    A recording with a severe finding has none: its curve may be that of a motion.
    """
    sound = [
        (recording, label)
        for recording, label in zip(recordings, labels, strict=True)
        if recording.health.severity != 'severe'
    ]
    made = []
    for quantity, title, unit in _KINDS:
        found = {
            label: [_worst(axes, seconds, unit) for seconds in TIMES_S.values()]
            for recording, label in sound
            if (axes := recording.of(quantity.name)) and all(axis.shows_constants for axis in axes)
        }
        used = [i for i in range(len(TIMES_S)) if any(row[i] for row in found.values())]
        if used:
            shown = _unit(unit, [e for row in found.values() for e in row if e is not None])
            rows = sorted(found.items(), key=lambda item: _rank(item[1]))
            made.append(
                DeadReckoning(
                    title,
                    shown,
                    [list(TIMES_S)[i] for i in used],
                    [Row(label, [_shown(row[i], shown) for i in used]) for label, row in rows],
                )
            )
    return made


def _unit(unit: str, found: Sequence[Estimate]) -> str:
    return '°' if unit == 'rad' else readable_unit(unit, 'Q', [e.value for e in found])


def _worst(axes: Sequence[AxisResult], seconds: float, unit: str) -> Estimate | None:
    found = [error_after(axis.allan, seconds, unit) for axis in axes if axis.allan is not None]
    return max((e for e in found if e is not None), key=lambda e: e.value or 0.0, default=None)


def _rank(row: Sequence[Estimate | None]) -> tuple[float, ...]:
    """Return the key by which the smallest error after the longest time that is known is first."""
    return tuple(math.inf if e is None else e.value or 0.0 for e in reversed(row))


def _shown(error: Estimate | None, unit: str) -> Numbers:
    return _UNKNOWN if error is None else numbers([error], unit, 2)
