# SPDX-License-Identifier: Apache-2.0
"""A sensor that was turned about, and the calibration that follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials import six_position, turns
from imu_bench.metrology.trials.six_position import Calibration, Held
from imu_bench.metrology.trials.still import find_positions, Position
from imu_bench.offline.notation import count
from imu_bench.offline.plans.common import Floats, place, rate_of
from imu_bench.offline.recordings import Recording
import numpy as np

METHODS = ('auto', 'faces', 'norm')

_ON_FACES = 0.75
"""Share of the positions that lie on faces when it was six faces that were meant."""


@dataclass(frozen=True)
class Choice:
    """
    How a calibration is made.

    Attributes
    ----------
    method : str
        One of `METHODS`.
    gravity : float
        m/s².
    shortest_s : float
        Shortest position.
    turn, turn_error : float
        Angle of one turn and its standard uncertainty, rad.
    confidence : float
    """

    method: str
    gravity: float
    shortest_s: float
    turn: float
    turn_error: float
    confidence: float


@dataclass(frozen=True, eq=False)
class Calibrated:
    """
    One sensor with its calibration.

    Attributes
    ----------
    source, topic : str
    spans : tuple of (float, float)
        Begin and end of every position, s.
    positions : tuple of Held
        Specific force at each, m/s².
    accelerometer : Calibration
    rest : Rest or None
        Of the gyroscope; None if it has none.
    turned : tuple of Turn
    gyroscope : Calibration or None
    before, after : ndarray
        |a| - g at every position, m/s²; `after` is empty without a complete calibration.
    """

    source: str
    topic: str
    spans: tuple[tuple[float, float], ...]
    positions: tuple[Held, ...]
    accelerometer: Calibration
    rest: turns.Rest | None
    turned: tuple[turns.Turn, ...]
    gyroscope: Calibration | None
    before: Floats
    after: Floats

    def to_json(self) -> dict[str, Any]:
        """Return every number in SI, ready for JSON."""
        document = {
            'source': self.source,
            'topic': self.topic,
            'positions': [
                {
                    'begin_s': begin,
                    'end_s': end,
                    'mean': held.mean.tolist(),
                    'face': six_position.face(held.mean),
                }
                for (begin, end), held in zip(self.spans, self.positions, strict=True)
            ],
            'acceleration': _json(self.accelerometer),
            'residuals_before': self.before.tolist(),
            'residuals_after': self.after.tolist(),
        }
        if self.gyroscope is not None:
            document['angular_velocity'] = _json(self.gyroscope)
        if self.rest is not None:
            document['acceleration_sensitivity'] = _by_name(self.rest.sensitivity)
        return document


def _json(calibration: Calibration) -> dict[str, Any]:
    matrix, offset = calibration.matrix, calibration.offset
    return {
        'method': calibration.method,
        'bias': [estimate.to_json() for estimate in calibration.bias],
        'scale_error': [estimate.to_json() for estimate in calibration.scale_error],
        'misalignment': _by_name(calibration.misalignment),
        'matrix': None if matrix is None else matrix.tolist(),
        'offset': None if offset is None else offset.tolist(),
    }


def _by_name(estimates: Mapping[tuple[str, str], Estimate]) -> dict[str, Any]:
    return {f'{row}{column}': value.to_json() for (row, column), value in estimates.items()}


def calibrate(recording: Recording, choice: Choice) -> Calibrated:
    """
    Return the calibration of one sensor.

    Raises
    ------
    RecordingError
        If it has no three axes of acceleration, or no still positions, or these do not suffice.
    """
    run, where = recording.samples, place(recording)
    if run.acceleration is None or not np.isfinite(run.acceleration[0]).all():
        raise RecordingError(f'{where}: no acceleration on three axes')
    rate = rate_of(recording)
    omega = run.angular_velocity
    if omega is not None and not np.isfinite(omega[0]).all():
        omega = None
    try:
        found = find_positions(run.acceleration, rate, omega, shortest_s=choice.shortest_s)
        positions = _held(run.acceleration, found, choice)
        accelerometer = _accelerometer(positions, choice)
    except DataError as error:
        raise RecordingError(f'{where}: {error}') from error
    rest, gyroscope = None, None
    turned: tuple[turns.Turn, ...] = ()
    if omega is not None:
        rest = turns.at_rest(_held(omega, found, choice), positions, choice.confidence)
        bias = np.array([estimate.value for estimate in rest.bias], float)
        turned = turns.find_turns(omega, 1.0 / rate, found, positions, bias)
        gyroscope = turns.gyroscope(
            rest, turned, choice.turn, choice.turn_error, choice.confidence
        )
    before = six_position.residuals(None, positions, choice.gravity)
    complete = accelerometer.matrix is not None
    after = six_position.residuals(accelerometer, positions, choice.gravity) if complete else None
    return Calibrated(
        recording.source, recording.topic,
        tuple((one.begin / rate, one.end / rate) for one in found), tuple(positions),
        accelerometer, rest, turned, gyroscope,
        before, np.empty(0) if after is None else after,
    )  # fmt: skip


def _held(data: Floats, found: Sequence[Position], choice: Choice) -> list[Held]:
    return [six_position.held(data[one.begin : one.end], choice.confidence) for one in found]


def _accelerometer(positions: Sequence[Held], choice: Choice) -> Calibration:
    """
    Return the calibration by the method chosen, or by that which suits the positions.

    Raises
    ------
    DataError
        If the positions do not suffice.
    """
    if len(positions) < 2:
        raise DataError(
            f'{count(len(positions), "still position")} found: lay the sensor still for '
            f'{choice.shortest_s:g} s or more on each of its six faces'
        )
    named = [name for held in positions if (name := six_position.face(held.mean)) is not None]
    method = choice.method
    if method == 'auto':
        enough = len(positions) >= six_position.FEWEST_POSITIONS
        meant = len(named) >= _ON_FACES * len(positions)
        method = 'norm' if enough and not meant else 'faces'
    if method == 'norm':
        return six_position.any_positions(positions, choice.gravity, choice.confidence)
    return six_position.six_faces(
        six_position.by_face(positions, choice.confidence), choice.gravity, choice.confidence
    )
