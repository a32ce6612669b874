# SPDX-License-Identifier: Apache-2.0
"""A sensor that was turned about, and the calibration that follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials import six_position, turns
from imu_bench.metrology.trials.six_position import Calibration, Held
from imu_bench.metrology.trials.still import find_positions, Position
from imu_bench.offline.analysis.pairing import one_sensor
from imu_bench.offline.notation import count
from imu_bench.offline.plans.plan import Floats, place, rate_of
from imu_bench.offline.recordings import Recording
import numpy as np

METHODS = ('auto', 'faces', 'norm')

_BLOCKS_HZ = 50.0
"""Blocks per second of a gyroscope that is kept by itself: a turn takes a second or more."""

LARGE = 5e-3
"""
Share of g that the correction may leave over before the result is doubted: the non-linearity of
consumer parts (0.5 % of full scale, MPU-9250).
"""

_ON_FACES = 0.75
"""Share of the positions that lie on faces when it was six faces that were meant."""


@dataclass(frozen=True)
class Choice:
    """How a calibration is made."""

    method: str  # one of `METHODS`
    gravity: float  # m/s²
    shortest_s: float  # shortest position
    # turn, turn_error: angle of one turn and its standard uncertainty, rad
    turn: float
    turn_error: float
    confidence: float


@dataclass(frozen=True, eq=False)
class Calibrated:
    """One sensor with its calibration."""

    source: str
    topic: str
    spans: tuple[tuple[float, float], ...]  # begin and end of every position, s
    positions: tuple[Held, ...]  # specific force at each, m/s²
    accelerometer: Calibration
    rest: turns.Rest | None  # of the gyroscope; None if it has none
    turned: tuple[turns.Turn, ...]
    gyroscope: Calibration | None
    # before, after: |a| - g at every position, m/s²; `after` is empty without a complete
    # calibration
    before: Floats
    after: Floats
    # half the intervals that the means of the positions give them
    before_error: Floats
    after_error: Floats

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


@dataclass(frozen=True, eq=False)
class Stream:
    """Angular velocity of a recording without acceleration: means over short blocks, rad/s."""

    start_ns: int
    rate_hz: float
    values: Floats


@dataclass(frozen=True, eq=False)
class StillPositions:
    """The still positions of one recording."""

    source: str
    topic: str
    spans: tuple[tuple[float, float], ...]  # begin and end of every position, s
    # positions, rates: specific force and angular velocity at each; no rates without a gyroscope
    positions: tuple[Held, ...]
    rates: tuple[Held, ...]
    turned: tuple[turns.Turn, ...] = ()  # between them
    start_ns: int = 0  # stamp that the spans count from
    # of a gyroscope that was recorded by itself: it has no positions of its own
    stream: Stream | None = None


def lay(recording: Recording, choice: Choice) -> StillPositions:
    """Return the still positions of one sensor."""
    run, where = recording.samples, place(recording)
    if run.acceleration is None and run.angular_velocity is not None:
        return _alone(recording, run.angular_velocity)
    if run.acceleration is None or not np.isfinite(run.acceleration[0]).all():
        raise RecordingError(f'{where}: no acceleration on three axes')
    rate = rate_of(recording)
    omega = run.angular_velocity
    if omega is not None and not np.isfinite(omega[0]).all():
        omega = None
    try:
        found = find_positions(run.acceleration, rate, omega, shortest_s=choice.shortest_s)
        positions = _held(run.acceleration, found, choice)
    except DataError as error:
        raise RecordingError(f'{where}: {error}') from error
    rates: list[Held] = []
    turned: tuple[turns.Turn, ...] = ()
    if omega is not None:
        rates = _held(omega, found, choice)
        if len(positions) > 1:
            rest = turns.at_rest(rates, positions, choice.confidence)
            bias = np.array([estimate.value for estimate in rest.bias], float)
            turned = turns.find_turns(omega, 1.0 / rate, found, positions, bias)
    return StillPositions(
        recording.source, recording.topic,
        tuple((one.begin / rate, one.end / rate) for one in found), tuple(positions),
        tuple(rates), turned, int(run.stamps[0]),
    )  # fmt: skip


def _alone(recording: Recording, omega: Floats) -> StillPositions:
    """Return the gyroscope of a recording without accelerometer."""
    rate = rate_of(recording)
    size = max(1, round(rate / _BLOCKS_HZ))
    count = len(omega) // size
    values = omega[: count * size].reshape(count, size, 3).mean(axis=1)
    stream = Stream(int(recording.samples.stamps[0]), rate / size, values)
    return StillPositions(
        recording.source, recording.topic, (), (), (), (), stream.start_ns, stream
    )


def _paired(laid: Sequence[StillPositions], choice: Choice) -> list[StillPositions]:
    """Return accelerometers with the gyroscopes that were recorded beside them."""
    streams = [one for one in laid if one.stream is not None]
    found = []
    for one in laid:
        if one.stream is not None:
            continue
        names = [s for s in streams if one_sensor(one.topic, s.topic)]
        lonely = [other for other in laid if other.stream is None and not other.rates]
        if not names and len(streams) == len(lonely) == 1:
            names = streams
        if not one.rates and len(names) == 1 and names[0].stream is not None:
            streams.remove(names[0])
            one = _with_rates(one, names[0].stream, choice)
        found.append(one)
    if streams:
        raise RecordingError(
            f'{streams[0].source}, {streams[0].topic}: no accelerometer belongs to it by its '
            'name, as in Accelerometer.csv and Gyroscope.csv'
        )
    return found


def _with_rates(one: StillPositions, stream: Stream, choice: Choice) -> StillPositions:
    late = 1e-9 * (one.start_ns - stream.start_ns)
    # a block at the edge of a position may hold a part of the move
    places = [
        Position(
            math.ceil((begin + late) * stream.rate_hz), math.floor((end + late) * stream.rate_hz)
        )
        for begin, end in one.spans
    ]
    if any(p.begin < 0 or p.end > len(stream.values) or p.end - p.begin < 2 for p in places):
        raise RecordingError(
            f'{one.source}, {one.topic}: the gyroscope does not cover its positions: the two '
            'were not recorded at the same time, or by other clocks'
        )
    rates = _held(stream.values, places, choice)
    turned: tuple[turns.Turn, ...] = ()
    if len(places) > 1:
        rest = turns.at_rest(rates, one.positions, choice.confidence)
        bias = np.array([estimate.value for estimate in rest.bias], float)
        turned = turns.find_turns(stream.values, 1.0 / stream.rate_hz, places, one.positions, bias)
    return replace(one, rates=tuple(rates), turned=turned)


def together(laid: Sequence[StillPositions], choice: Choice) -> list[StillPositions]:
    """
    Return sensors of what belongs together.

    A gyroscope beside its accelerometer, and recordings that hold a single position each.
    """
    laid = _paired(laid, choice)
    single = [one for one in laid if len(one.positions) == 1]
    if len(single) < 2:
        return list(laid)
    topics = {one.topic for one in single}
    if len(topics) > 1 and len({one.source for one in single}) < len(single):
        raise RecordingError(
            'recordings of one position each hold several sensors of different names: choose '
            'one with --topic'
        )
    groups = [[one for one in single if one.topic == topic] for topic in sorted(topics)]
    if len({one.source for one in single}) == len(single):
        groups = [single]
    merged = [
        StillPositions(
            f'{len(group)} recordings',
            group[0].topic,
            tuple(one.spans[0] for one in group),
            tuple(one.positions[0] for one in group),
            tuple(one.rates[0] for one in group) if all(one.rates for one in group) else (),
        )
        for group in groups
    ]
    return [*merged, *(one for one in laid if len(one.positions) != 1)]


def calibrate(laid: StillPositions, choice: Choice) -> Calibrated:
    """Return the calibration of one sensor."""
    positions = laid.positions
    try:
        accelerometer = _accelerometer(positions, choice)
    except DataError as error:
        raise RecordingError(f'{laid.source}, {laid.topic}: {error}') from error
    rest, gyroscope = None, None
    if laid.rates:
        rest = turns.at_rest(laid.rates, positions, choice.confidence)
        gyroscope = turns.gyroscope(
            rest, laid.turned, choice.turn, choice.turn_error, choice.confidence
        )
    before, before_error = six_position.residuals(None, positions, choice.gravity)
    complete = accelerometer.matrix is not None
    after, after_error = (
        six_position.residuals(accelerometer, positions, choice.gravity)
        if complete
        else (np.empty(0), np.empty(0))
    )
    return Calibrated(
        laid.source, laid.topic, laid.spans, positions, accelerometer, rest, laid.turned,
        gyroscope, before, after, before_error, after_error,
    )  # fmt: skip


def _fits(positions: Sequence[Held], choice: Choice) -> bool:
    """Return whether a calibration from faces leaves the size of gravity where it is."""
    faces = six_position.by_face(positions, choice.confidence)
    if len(faces) < len(six_position.FACES):
        return True
    found = six_position.six_faces(faces, choice.gravity, choice.confidence)
    off, _ = six_position.residuals(found, positions, choice.gravity)
    return float(np.sqrt(np.mean(off**2))) <= LARGE * choice.gravity


def _held(data: Floats, found: Sequence[Position], choice: Choice) -> list[Held]:
    return [six_position.held(data[one.begin : one.end], choice.confidence) for one in found]


def _accelerometer(positions: Sequence[Held], choice: Choice) -> Calibration:
    """Return the calibration by the method chosen, or by that which suits the positions."""
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
        method = 'norm' if enough and not (meant and _fits(positions, choice)) else 'faces'
    if method == 'norm':
        return six_position.any_positions(positions, choice.gravity, choice.confidence)
    return six_position.six_faces(
        six_position.by_face(positions, choice.confidence), choice.gravity, choice.confidence
    )
