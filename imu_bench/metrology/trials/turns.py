# SPDX-License-Identifier: Apache-2.0
"""
Bias, scale and misalignment of a gyroscope from standing still and from turns.

A turn by a known angle about a vertical axis of the housing is integrated: what comes out about
every axis, over the angle, is a column of the matrix S of raw = S true + b (Ferraris, Grimaldi
and Parvis 1995, Sensors and Materials 7:311).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.combining import symmetric
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.trials.six_position import AXES, Calibration, Held
from imu_bench.metrology.trials.still import Position
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

UPRIGHT = math.radians(10.0)
"""
Gravity may lie this far from the same place after a turn: it was about the vertical, and by the
angle told to 1 − cos 10° = 1.5 %.
"""

DOMINANT = math.radians(30.0)
"""
A turn is about an axis of the housing if it lies within this angle of it; no two are so near.
"""

_REST = 4
"""Positions more than parameters, so that what is left over shows the error."""

_SPREAD = 0.2
"""Least singular value per position of bias and unit gravity; six faces have 1/√3 = 0.58."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A gyroscope that does not turn."""

    bias: tuple[Estimate, ...]  # rad/s, without gravity where its effect is known
    # what an output (first) shows of the specific force along an axis (second), rad/s/(m/s²);
    # empty where the positions do not show it
    sensitivity: dict[tuple[str, str], Estimate]


@dataclass(frozen=True, eq=False)
class Turn:
    """One turn about the vertical."""

    axis: str  # of the housing, of `AXES`
    measured: Floats  # integral of the angular velocity without its bias, rad
    duration_s: float


def at_rest(rates: Sequence[Held], forces: Sequence[Held], confidence: float = CONFIDENCE) -> Rest:
    """
    Return the bias of a gyroscope, and what gravity does to it, from still positions.

    Least squares of ω = b + G a over the positions where these are many and spread enough, else
    the mean; the interval is from the scatter between the positions.

    Parameters
    ----------
    rates, forces : sequence of Held
        Angular velocity and specific force at each position.

    Raises
    ------
    DataError
        If there is no position.

    Examples
    --------
    >>> zero = np.zeros(3)
    >>> still = [Held(np.array([value, 0.02, 0.03]), zero) for value in (0.010, 0.012)]
    >>> round(at_rest(still, still).bias[0].value, 4)
    0.011
    """
    if not rates:
        raise DataError('no still position: the bias of the gyroscope is not known')
    omega = np.array([rate.mean for rate in rates])
    force = np.array([position.mean for position in forces])
    design = np.column_stack([np.ones(len(omega)), force / _size(force)])
    least = float(np.linalg.svd(design, compute_uv=False)[-1]) / math.sqrt(len(omega))
    if len(omega) < design.shape[1] + _REST or least < _SPREAD:
        return Rest(tuple(_mean(omega[:, k], rates, k, confidence) for k in range(3)), {})
    gram = np.linalg.inv(design.T @ design)
    found = gram @ design.T @ omega
    freedom = len(omega) - design.shape[1]
    left = omega - design @ found
    sigma = np.sqrt((left**2).sum(axis=0) / freedom)
    errors = np.sqrt(np.diag(gram))
    bias = tuple(
        symmetric(
            float(found[0, k]), float(sigma[k] * errors[0]), 'rad/s', confidence, freedom=freedom
        )
        for k in range(3)
    )
    sensitivity = {
        (row, column): symmetric(
            float(found[1 + j, k]) / _size(force), float(sigma[k] * errors[1 + j]) / _size(force),
            'rad/s/(m/s²)', confidence, freedom=freedom,
        )
        for k, row in enumerate(AXES)
        for j, column in enumerate(AXES)
    }  # fmt: skip
    return Rest(bias, sensitivity)


def _size(force: Floats) -> float:
    return float(np.linalg.norm(force, axis=1).mean())


def _mean(values: Floats, rates: Sequence[Held], axis: int, confidence: float) -> Estimate:
    value = float(values.mean())
    if values.size == 1:
        half = float(rates[0].error[axis])
        return Estimate(value, value - half, value + half, 'rad/s', confidence)
    error = float(values.std(ddof=1)) / math.sqrt(values.size)
    return symmetric(value, error, 'rad/s', confidence, freedom=values.size - 1)


def find_turns(
    angular_velocity: npt.ArrayLike,
    period_s: float,
    positions: Sequence[Position],
    forces: Sequence[Held],
    bias: npt.ArrayLike,
) -> tuple[Turn, ...]:
    """
    Return the turns about an axis of the housing that stood upright.

    A turn is a move between two still positions with gravity at the same place, about the axis
    that it lies along.

    Parameters
    ----------
    angular_velocity : array_like, shape (n, 3)
        rad/s.
    forces : sequence of Held
        Specific force at each position.
    bias : array_like, shape (3,)
        rad/s.
    """
    omega = np.asarray(angular_velocity, np.float64)
    found = []
    for place in range(len(positions) - 1):
        before, after = forces[place].mean, forces[place + 1].mean
        up = before / np.linalg.norm(before)
        if _angle(up, after) > UPRIGHT:
            continue
        move = slice(positions[place].end, positions[place + 1].begin)
        part = omega[move] - np.asarray(bias, np.float64)
        turned = part.sum(axis=0) * period_s
        size = float(np.linalg.norm(turned))
        axis = int(np.argmax(np.abs(turned)))
        if size < DOMINANT or abs(float(turned[axis])) < math.cos(DOMINANT) * size:
            continue
        if abs(float(up[axis])) < math.cos(DOMINANT):
            continue
        found.append(Turn(AXES[axis], turned, len(part) * period_s))
    return tuple(found)


def _angle(first: Floats, second: Floats) -> float:
    cosine = float(first @ second) / float(np.linalg.norm(first) * np.linalg.norm(second))
    return math.acos(min(1.0, max(-1.0, cosine)))


def gyroscope(
    rest: Rest,
    turns: Sequence[Turn],
    turn: float = 2.0 * math.pi,
    turn_error: float = math.radians(1.0),
    confidence: float = CONFIDENCE,
) -> Calibration:
    """
    Return the calibration of a gyroscope.

    Every turn counts as the nearest multiple of `turn`.  Several about one axis are averaged.
    The interval holds the error of the angle and what the uncertainty of the bias adds up to;
    misalignment is that against the axis of the turn.

    Parameters
    ----------
    turn : float
        Angle of one turn, rad.
    turn_error : float
        Standard uncertainty of that angle, rad; zero for a turn-table.

    Examples
    --------
    >>> still = Rest(tuple(Estimate(0.0, 0.0, 0.0, 'rad/s') for _ in AXES), {})
    >>> made = [Turn('x', np.array([6.3, 0.1, 0.0]), 3.0)]
    >>> found = gyroscope(still, made)
    >>> round(found.scale_error[0].value, 4), found.scale_error[1].observable
    (0.0027, False)
    """
    quantile = float(scipy.special.ndtri(0.5 + confidence / 2.0))
    columns = {
        axis: made
        for axis in AXES
        if (made := _column(axis, rest, turns, turn, quantile * turn_error)) is not None
    }
    scale, misalignment = [], {}
    for index, axis in enumerate(AXES):
        if axis not in columns:
            reason = f'no turn about {axis} by a multiple of {math.degrees(turn):g}°'
            scale.append(Estimate.not_observable('1', reason, confidence=confidence))
            continue
        column, half = columns[axis]
        for row, name in enumerate(AXES):
            value, error = float(column[row]) - (row == index), float(half[row])
            unit = '1' if row == index else 'rad'
            found = Estimate(value, value - error, value + error, unit, confidence)
            if row == index:
                scale.append(found)
            else:
                misalignment[name, axis] = found
    matrix = offset = None
    if len(columns) == len(AXES):
        response = np.column_stack([columns[axis][0] for axis in AXES])
        matrix = np.asarray(np.linalg.inv(response), np.float64)
        offset = np.array([estimate.value for estimate in rest.bias], np.float64)
    return Calibration('turns', rest.bias, tuple(scale), misalignment, matrix, offset)


def _column(
    axis: str, rest: Rest, turns: Sequence[Turn], turn: float, angle_error: float
) -> tuple[Floats, Floats] | None:
    """Return a column of S with half its interval; None if there was no turn about the axis."""
    ratios, errors = [], []
    for one in turns:
        own = float(one.measured[AXES.index(axis)])
        times = round(abs(own) / turn)
        if one.axis != axis or times == 0:
            continue
        angle = math.copysign(times * turn, own)
        drift = np.array([_half(estimate) for estimate in rest.bias]) * one.duration_s
        ratios.append(one.measured / angle)
        errors.append(np.hypot(angle_error * ratios[-1], drift) / abs(angle))
    if not ratios:
        return None
    half = np.sqrt(np.sum(np.square(errors), axis=0)) / len(errors)
    return np.asarray(np.mean(ratios, axis=0), np.float64), np.asarray(half, np.float64)


def _half(estimate: Estimate) -> float:
    if estimate.low is None or estimate.high is None:
        return 0.0
    return 0.5 * (estimate.high - estimate.low)
