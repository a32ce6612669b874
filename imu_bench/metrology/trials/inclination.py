# SPDX-License-Identifier: Apache-2.0
"""
Tilt from gravity: angles, how far they are from those that were set, what can be resolved.

Angles follow the MSc thesis on two MEMS inclinometers for antenna masts (SCL3300, IIM-42652),
equation 26: the angle of an axis above the horizontal plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

from imu_bench.errors import DataError
from imu_bench.metrology.combining import difference, sample_statistics, shifted, symmetric
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

ANGLES = ('x', 'y', 'z', '-x', '-y', '-z', 'roll', 'pitch')
"""Angles that gravity gives; a sign turns the direction round."""


def inclination(acceleration: npt.ArrayLike, axis: str = 'x') -> Floats:
    """
    Return an angle of a sensor at rest against gravity, rad.

    Parameters
    ----------
    acceleration : array_like, shape (n, 3)
        Specific force: +g on z at rest with z up.
    axis : str
        'x', 'y' or 'z' for the angle of that axis above the horizontal plane,
        θ = atan2(a_x, √(a_y² + a_z²)) (mast thesis, equation 26; that of the angle
        outputs of the Murata SCL3300, Doc 4921 rev. 2, section 2.11); with a minus
        for its opposite.  'roll' = atan2(a_y, a_z) and 'pitch' = atan2(-a_x, √(a_y² + a_z²))
        are those of the rotation order x, y, z (Freescale AN3461 rev. 6, equations 25, 26).

    Raises
    ------
    DataError
        If the shape or the name is another.

    Examples
    --------
    >>> inclination([[1.0, 0.0, 1.0]], 'x').round(6).tolist()  # 45°
    [0.785398]
    >>> inclination([[0.0, 1.0, 1.0]], 'roll').round(6).tolist()
    [0.785398]
    """
    force = np.asarray(acceleration, np.float64)
    if force.ndim != 2 or force.shape[1] != 3:
        raise DataError(f'acceleration must have shape (n, 3), got {force.shape}')
    if axis not in ANGLES:
        raise DataError(f'no angle {axis!r}; there are {", ".join(ANGLES)}')
    if axis == 'roll':
        return np.asarray(np.arctan2(force[:, 1], force[:, 2]))
    name, sign = ('x', -1.0) if axis == 'pitch' else (axis[-1], -1.0 if axis[0] == '-' else 1.0)
    raised = 'xyz'.index(name)
    others = [index for index in range(3) if index != raised]
    across = np.hypot(force[:, others[0]], force[:, others[1]])
    return np.asarray(np.arctan2(sign * force[:, raised], across))


@dataclass(frozen=True)
class ErrorStatistics:
    """Errors of a series of angles, as in appendix 6 of the mast thesis."""

    mean: Estimate
    std: Estimate  # over the angles, n - 1
    three_sigma: Estimate
    variance: float  # square of the standard deviation, in the square of the unit
    largest: float  # error farthest from zero


def error_statistics(
    errors: npt.ArrayLike, unit: str = 'rad', confidence: float = CONFIDENCE
) -> ErrorStatistics:
    """
    Return mean, standard deviation and 3σ of the errors of a series of angles.

    Parameters
    ----------
    errors : array_like, shape (n,)
        Measured minus set angle.
    unit : str
        That of the errors.
    confidence : float
        Level of the intervals.

    Raises
    ------
    DataError
        If there are fewer than two errors.

    Examples
    --------
    >>> found = error_statistics([0.01, 0.03, 0.02], '°')
    >>> round(found.mean.value, 6), round(found.three_sigma.value, 6)
    (0.02, 0.03)
    """
    values = np.asarray(errors, np.float64)
    mean, std = sample_statistics(values, unit, confidence)
    farthest = float(values[np.argmax(np.abs(values))])
    variance = (std.value or 0.0) ** 2
    return ErrorStatistics(mean, std, std.scaled(3.0, unit), variance, farthest)


class Line(NamedTuple):
    """Measured against set angles: zero offset, relative error of the scale, what is left."""

    offset: Estimate
    scale_error: Estimate
    linearity: float


def straight_line(
    wanted: npt.ArrayLike, measured: npt.ArrayLike, confidence: float = CONFIDENCE
) -> Line:
    """
    Return the straight line through measured against set angles, least squares.

    Parameters
    ----------
    wanted, measured : array_like, shape (n,)
        rad.

    Raises
    ------
    DataError
        If fewer than three angles, or only one different one, were set.

    Examples
    --------
    >>> line = straight_line([0.0, 0.1, 0.2], [0.01, 0.111, 0.212])
    >>> round(line.offset.value, 6), round(line.scale_error.value, 6)
    (0.01, 0.01)
    """
    x, y = np.asarray(wanted, np.float64), np.asarray(measured, np.float64)
    if x.size < 3 or np.ptp(x) == 0.0:
        raise DataError('a line needs three set angles, not all the same')
    off = x - x.mean()
    square = float(off @ off)
    slope = float(off @ y) / square
    offset = float(y.mean()) - slope * float(x.mean())
    left = y - offset - slope * x
    freedom = x.size - 2
    sigma = math.sqrt(float(left @ left) / freedom)
    at_zero = sigma * math.sqrt(1.0 / x.size + float(x.mean()) ** 2 / square)
    return Line(
        symmetric(offset, at_zero, 'rad', confidence, freedom=freedom),
        symmetric(slope - 1.0, sigma / math.sqrt(square), '1', confidence, freedom=freedom),
        float(np.abs(left).max()),
    )


class Turn(NamedTuple):
    """One set angle, reached from below and from above, and the difference down minus up."""

    angle: float
    up: Estimate
    down: Estimate
    hysteresis: Estimate


def hysteresis(wanted: Sequence[float], measured: Sequence[Estimate]) -> tuple[Turn, ...]:
    """
    Return every set angle that was reached from both sides, with what differs.

    An angle is reached from the side of the one before it; the first one from that of a plan
    that begins with the move to the second.  The first of several visits counts.

    Parameters
    ----------
    wanted : sequence of float
        Set angles in their order, rad.

    Raises
    ------
    DataError
        If there are not as many of one as of the other.

    Examples
    --------
    >>> angles = [Estimate(value, None, None, 'rad') for value in (0.0, 0.1, 0.2, 0.103, 0.001)]
    >>> turns = hysteresis([0, 0.1, 0.2, 0.1, 0], angles)
    >>> [(turn.angle, round(turn.hysteresis.value, 3)) for turn in turns]
    [(0, 0.001), (0.1, 0.003)]
    """
    if len(wanted) != len(measured):
        raise DataError(f'{len(wanted)} set angles for {len(measured)} measured ones')
    if len(wanted) < 3:
        return ()
    moves = np.sign(np.diff(np.asarray(wanted, np.float64)))
    sides = [moves[0], *moves]
    seen: dict[float, dict[float, Estimate]] = {}
    for angle, side, value in zip(wanted, sides, measured, strict=True):
        if side:
            seen.setdefault(angle, {}).setdefault(float(side), value)
    return tuple(
        Turn(angle, visits[1.0], visits[-1.0], difference(visits[-1.0], visits[1.0]))
        for angle, visits in sorted(seen.items())
        if len(visits) == 2
    )


def compensated(measured: Sequence[Estimate], wanted: Sequence[float]) -> tuple[Estimate, ...]:
    """
    Return the errors of angles less that of the first one, as table 4 of the mast thesis.

    Examples
    --------
    >>> angles = [Estimate(0.01, 0.009, 0.011, 'rad'), Estimate(0.112, 0.111, 0.113, 'rad')]
    >>> [round(error.value, 6) for error in compensated(angles, [0.0, 0.1])]
    [0.0, 0.002]
    """
    errors = [shifted(angle, -zero) for angle, zero in zip(measured, wanted, strict=True)]
    zero = errors[0]
    own = Estimate(0.0, 0.0, 0.0, zero.unit, zero.confidence, method='the reference itself')
    return (own, *(difference(error, zero) for error in errors[1:]))


def smallest_step(curve: DeviationCurve, probability: float = 0.95) -> tuple[Estimate, ...]:
    """
    Return the smallest change of angle that is found, for every averaging time.

    Means over τ before and after the change are compared.  Without a change their difference
    scatters by √2 σ_A(τ), for that is how the Allan deviation is defined.  A difference counts
    as a change beyond the two-sided limit that noise alone passes with the chance 1 - P, and a
    change of the size returned passes it with the chance P (L. A. Currie 1968, "Limits for
    qualitative detection and quantitative determination", Anal. Chem. 40(3):586, detection
    limit; the limit here has two sides, for a step may go either way).

    Parameters
    ----------
    curve : DeviationCurve
        Of the angle at rest, rad.
    probability : float
        P, between 0.5 and 1.

    Raises
    ------
    DataError
        If the probability is none.

    Examples
    --------
    >>> from imu_bench.metrology.allan import deviation
    >>> white = np.random.default_rng(1).normal(scale=1e-4, size=100_000)
    >>> found = smallest_step(deviation(white, 100.0, tau=[1.0], unit='rad'))
    >>> round(found[0].value * 1e6, 1)  # about 1e-4 / √100 · √2 · (1.96 + 1.645), in µrad
    49.3
    """
    if not 0.5 < probability < 1.0:
        raise DataError(f'probability must lie between 0.5 and 1, got {probability}')
    limits = scipy.special.ndtri(0.5 + probability / 2.0) + scipy.special.ndtri(probability)
    factor = math.sqrt(2.0) * float(limits)
    return tuple(curve.at(index).scaled(factor, curve.unit) for index in range(len(curve)))
