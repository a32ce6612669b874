# SPDX-License-Identifier: Apache-2.0
"""
Bias, scale and misalignment of an accelerometer from the gravity of several positions.

The model is raw = S true + b with a matrix S of scale (diagonal) and misalignment (beside it);
a correction is true = S⁻¹ (raw - b).

`six_faces` puts a housing on its six faces (F. Ferraris, U. Grimaldi and M. Parvis 1995,
"Procedure for effortless in-field calibration of three-axis rate gyros and accelerometers",
Sensors and Materials 7:311): all twelve numbers, in the frame of the housing.
`any_positions` needs no faces but many positions, for it uses only that gravity has the same
size in all of them (Tedaldi, Pretto and Menegatti 2014, ICRA): nine numbers,
in a frame of the sensor's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.combining import symmetric
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.moments import Moments
from imu_bench.units import STANDARD_GRAVITY
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

AXES = 'xyz'
FACES = ('+x', '-x', '+y', '-y', '+z', '-z')
NEAR_FACE = math.radians(30.0)
"""A position within this angle of an axis is that of a face; no two axes are so near."""

FEWEST_POSITIONS = 12
"""Nine numbers and three to see how well they fit."""

_OBSERVABLE = 1e-3
"""
Least singular value of the fit per position, of parameters in units of g: 10⁻⁴ g of noise in each
of n positions would be 0.1/√n g in a parameter.
"""


@dataclass(frozen=True, eq=False)
class Held:
    """The mean of a vector at one position."""

    # mean, error: mean, and half the width of its interval
    mean: Floats
    error: Floats


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is wrong with three axes, and how to put it right."""

    method: str  # 'faces', 'norm' or 'turns'
    bias: tuple[Estimate, ...]  # b, in the unit of the signal
    scale_error: tuple[Estimate, ...]  # diagonal of S, less one
    # what an output (first) shows of the true value along another axis (second): S beside its
    # diagonal, as an angle in rad
    misalignment: Mapping[tuple[str, str], Estimate]
    # matrix, offset: S⁻¹ and b for the correction; None if not all numbers are known
    matrix: Floats | None
    offset: Floats | None

    def corrected(self, raw: npt.ArrayLike) -> Floats:
        """
        Return true values of raw ones, shape (n, 3).

        Raises
        ------
        DataError
            If the calibration is not complete.
        """
        if self.matrix is None or self.offset is None:
            raise DataError('the calibration is not complete: positions are missing')
        return np.asarray((np.asarray(raw, np.float64) - self.offset) @ self.matrix.T)


def held(data: npt.ArrayLike, confidence: float = CONFIDENCE) -> Held:
    """
    Return the mean of a vector at rest, shape (n, 3), with its interval.

    Examples
    --------
    >>> held([[1.0, 2.0, 3.0], [1.0, 2.0, 5.0]]).mean.tolist()
    [1.0, 2.0, 4.0]
    """
    moments = Moments.of(np.ascontiguousarray(np.asarray(data, np.float64).T))
    found = [moments.mean_estimate(axis, '1', confidence) for axis in range(3)]
    error = [0.0 if e.high is None or e.low is None else 0.5 * (e.high - e.low) for e in found]
    return Held(moments.total_mean, np.array(error))


def face(mean: npt.ArrayLike) -> str | None:
    """
    Return on which face a sensor lies, named after the axis that points up; None if on none.

    Examples
    --------
    >>> face([0.1, -9.8, 0.2]), face([5.0, 5.0, 5.0])
    ('-y', None)
    """
    force = np.asarray(mean, np.float64)
    axis = int(np.argmax(np.abs(force)))
    size = float(np.linalg.norm(force))
    if size == 0.0 or abs(float(force[axis])) < math.cos(NEAR_FACE) * size:
        return None
    return f'{"+" if force[axis] > 0 else "-"}{AXES[axis]}'


def lean(mean: npt.ArrayLike) -> float:
    """
    Return the angle between gravity and the nearest axis in rad.

    Examples
    --------
    >>> round(math.degrees(lean([0.0, 1.0, -1.0])))
    45
    """
    force = np.abs(np.asarray(mean, np.float64))
    nearest = float(force.max()) / max(float(np.linalg.norm(force)), 1e-300)
    return math.acos(min(nearest, 1.0))


def by_face(positions: Sequence[Held], confidence: float = CONFIDENCE) -> dict[str, Held]:
    """
    Return the mean of all positions on each face; those on none are left out.

    Where a face was taken several times, how well the output along gravity repeats is part of
    the error of every face.

    Examples
    --------
    >>> zero = np.zeros(3)
    >>> twice = [Held(np.array([0.0, 0.0, 9.80]), zero), Held(np.array([0.0, 0.0, 9.82]), zero)]
    >>> by_face(twice)['+z'].mean.round(3).tolist()
    [0.0, 0.0, 9.81]
    """
    found: dict[str, list[Held]] = {}
    for position in positions:
        name = face(position.mean)
        if name is not None:
            found.setdefault(name, []).append(position)
    along = {
        name: np.array([held.mean[AXES.index(name[1])] for held in same])
        for name, same in found.items()
    }
    freedom = sum(values.size - 1 for values in along.values())
    square = sum(float(((values - values.mean()) ** 2).sum()) for values in along.values())
    repeat = math.sqrt(square / freedom) * _student(freedom, confidence) if freedom else 0.0
    made = {}
    for name, same in found.items():
        error = np.sqrt(np.sum([held.error**2 for held in same], axis=0)) / len(same)
        axis = AXES.index(name[1])
        error[axis] = math.hypot(float(error[axis]), repeat / math.sqrt(len(same)))
        made[name] = Held(np.mean([held.mean for held in same], axis=0), error)
    return made


def six_faces(
    faces: Mapping[str, Held],
    gravity: float = STANDARD_GRAVITY,
    confidence: float = CONFIDENCE,
) -> Calibration:
    """
    Return the calibration of a housing that was put on its faces.

    With u_i(±j) the output i when axis j points up or down (Ferraris et al. 1995; the same
    numbers as the Python package imucal):

        b_i = (u_i(+i) + u_i(-i)) / 2,   S_ij = (u_i(+j) - u_i(-j)) / (2 g).

    A face that is not level turns the outputs across: by how much is seen from the sums
    u_i(+j) + u_i(-j), which should be 2 b_i.  That scatter δ widens the intervals: of the
    misalignment by δ/√2, of bias and scale by what crosses over.

    Parameters
    ----------
    faces : mapping of str to Held
        By name of the face, of `FACES`, m/s².
    gravity : float
        m/s².

    Raises
    ------
    DataError
        If no axis was turned over.

    Examples
    --------
    >>> up = {name: Held(np.array(mean), np.zeros(3)) for name, mean in {
    ...     '+x': [10.0, 0, 0], '-x': [-9.8, 0, 0], '+y': [0.1, 9.8, 0], '-y': [0.1, -9.8, 0],
    ...     '+z': [0.1, 0, 9.9], '-z': [0.1, 0, -9.9]}.items()}
    >>> found = six_faces(up, 9.9)
    >>> [round(b.value, 3) for b in found.bias], round(found.scale_error[1].value, 4)
    ([0.1, 0.0, 0.0], -0.0101)
    """
    complete = [axis for axis in AXES if f'+{axis}' in faces and f'-{axis}' in faces]
    if not complete:
        raise DataError(
            f'positions on {", ".join(sorted(faces)) or "no face"} only: turn every axis up '
            'and down'
        )
    half = {axis: _half(faces, axis, -1.0) / gravity for axis in complete}  # columns of S
    middle = {axis: _half(faces, axis, 1.0) for axis in complete}
    tilt, freedom = _tilt(middle, complete, gravity)
    uneven = tilt * _student(freedom, confidence)
    cross = {
        (row, column): _plus_minus(
            float(half[column][k]),
            math.hypot(_noise(faces, column, k) / gravity, uneven / math.sqrt(2.0)),
            'rad',
            confidence,
        )
        for column in complete
        for k, row in enumerate(AXES)
        if row != column
    }
    bias, scale = [], []
    for index, axis in enumerate(AXES):
        if axis not in complete:
            missing = [name for name in (f'+{axis}', f'-{axis}') if name not in faces]
            reason = f'position {" and ".join(missing)} is missing'
            bias.append(Estimate.not_observable('m/s²', reason, confidence=confidence))
            scale.append(Estimate.not_observable('1', reason, confidence=confidence))
            continue
        leak = math.sqrt(
            sum((e.value or 0.0) ** 2 for (row, _), e in cross.items() if row == axis)
        )
        crossed = gravity * uneven * math.hypot(2.0 * tilt, leak / math.sqrt(2.0))
        error = math.hypot(_noise(faces, axis, index), crossed)
        bias.append(_plus_minus(float(middle[axis][index]), error, 'm/s²', confidence))
        own = float(half[axis][index]) - 1.0
        scale.append(_plus_minus(own, error / gravity, '1', confidence))
    matrix = offset = None
    if len(complete) == len(AXES):
        matrix = np.asarray(np.linalg.inv(np.column_stack([half[a] for a in AXES])), np.float64)
        offset = np.array([middle[axis][index] for index, axis in enumerate(AXES)])
    return Calibration('faces', tuple(bias), tuple(scale), cross, matrix, offset)


def _noise(faces: Mapping[str, Held], axis: str, output: int) -> float:
    """Return the error of half the sum or difference of an output on two faces."""
    up, down = (faces[f'{sign}{axis}'].error[output] for sign in '+-')
    return 0.5 * math.hypot(float(up), float(down))


def _half(faces: Mapping[str, Held], axis: str, sign: float) -> Floats:
    return np.asarray(0.5 * (faces[f'+{axis}'].mean + sign * faces[f'-{axis}'].mean), np.float64)


def _tilt(
    middle: Mapping[str, Floats], complete: Sequence[str], gravity: float
) -> tuple[float, int]:
    """Return how far the faces were from level, rad, and how many differences show it."""
    off = [
        float(middle[column][AXES.index(row)] - middle[row][AXES.index(row)])
        for row in complete
        for column in complete
        if row != column
    ]
    if not off:
        return 0.0, 1
    return math.sqrt(2.0 * sum(v**2 for v in off) / len(off)) / gravity, len(off)


def _student(freedom: float, confidence: float) -> float:
    return float(scipy.special.stdtrit(freedom, 0.5 + confidence / 2.0))


def _plus_minus(value: float, half: float, unit: str, confidence: float) -> Estimate:
    return Estimate(value, value - half, value + half, unit, confidence)


def any_positions(
    positions: Sequence[Held],
    gravity: float = STANDARD_GRAVITY,
    confidence: float = CONFIDENCE,
) -> Calibration:
    """
    Return the calibration from many positions, whatever they are.

    Least squares of |S⁻¹ (raw - b)| - g with S upper triangular: the corrected z axis is that
    of the sensor, the corrected y axis lies in the plane of its y and z axes.

    Parameters
    ----------
    positions : sequence of Held
        m/s².
    gravity, confidence
        As in `six_faces`.

    Raises
    ------
    DataError
        If there are fewer than `FEWEST_POSITIONS`, or they do not tell the numbers apart.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> true = rng.normal(size=(30, 3))
    >>> true *= 9.80665 / np.linalg.norm(true, axis=1, keepdims=True)
    >>> raw = true * [1.01, 0.99, 1.0] + [0.1, 0.2, -0.3] + rng.normal(0, 1e-3, (30, 3))
    >>> found = any_positions([Held(mean, np.zeros(3)) for mean in raw])
    >>> [round(b.value, 2) for b in found.bias], round(found.scale_error[0].value, 3)
    ([0.1, 0.2, -0.3], 0.01)
    """
    if len(positions) < FEWEST_POSITIONS:
        raise DataError(
            f'{len(positions)} positions are too few for any position; '
            f'{FEWEST_POSITIONS} or more are needed, or the six faces'
        )
    raw = np.array([position.mean for position in positions])

    def off(parameters: Floats) -> Floats:
        response, bias = _response(parameters)
        true = np.linalg.solve(response, (raw / gravity - bias).T)
        return np.asarray(np.linalg.norm(true, axis=0) - 1.0, np.float64)

    start = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    found = scipy.optimize.least_squares(off, start, method='lm', xtol=1e-12, ftol=1e-14)
    least = float(np.linalg.svd(found.jac, compute_uv=False)[-1]) / math.sqrt(len(raw))
    if least < _OBSERVABLE:
        raise DataError(
            f'the {len(raw)} positions do not tell bias, scale and misalignment apart: turn '
            'every axis up and down'
        )
    freedom = len(raw) - start.size
    covariance = 2.0 * found.cost / freedom * np.linalg.inv(found.jac.T @ found.jac)
    errors = np.sqrt(np.diag(covariance))

    def estimate(index: int, unit: str, factor: float = 1.0, less: float = 0.0) -> Estimate:
        value = factor * (float(found.x[index]) - less)
        return symmetric(value, factor * float(errors[index]), unit, confidence, freedom=freedom)

    response, bias = _response(found.x)
    return Calibration(
        'norm',
        tuple(estimate(index, 'm/s²', gravity) for index in range(3)),
        tuple(estimate(3 + index, '1', less=1.0) for index in range(3)),
        {
            ('x', 'y'): estimate(6, 'rad'),
            ('x', 'z'): estimate(7, 'rad'),
            ('y', 'z'): estimate(8, 'rad'),
        },
        np.asarray(np.linalg.inv(response), np.float64),
        gravity * bias,
    )


def _response(parameters: Floats) -> tuple[Floats, Floats]:
    """Return S and b / g."""
    xx, yy, zz, xy, xz, yz = parameters[3:]
    return np.array([[xx, xy, xz], [0.0, yy, yz], [0.0, 0.0, zz]]), parameters[:3]


def residuals(
    calibration: Calibration | None, positions: Sequence[Held], gravity: float = STANDARD_GRAVITY
) -> tuple[Floats, Floats]:
    """
    Return how far the size of what was measured is from gravity at every position, m/s².

    And half the interval that the means give it; that of the calibration is not in it.

    Parameters
    ----------
    calibration : Calibration or None
        None for the values as measured.

    Examples
    --------
    >>> off, half = residuals(None, [Held(np.array([0.0, 0.0, 9.9]), np.full(3, 0.01))], 9.8)
    >>> off.round(3).tolist(), half.tolist()
    ([0.1], [0.01])
    """
    raw = np.array([position.mean for position in positions])
    true = raw if calibration is None else calibration.corrected(raw)
    size = np.linalg.norm(true, axis=1)
    along = true / size[:, None]
    if calibration is not None and calibration.matrix is not None:
        along = along @ calibration.matrix
    error = np.array([position.error for position in positions])
    return size - gravity, np.sqrt(np.sum((along * error) ** 2, axis=1))
