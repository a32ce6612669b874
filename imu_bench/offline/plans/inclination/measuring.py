# SPDX-License-Identifier: Apache-2.0
"""What a tilted sensor shows, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology import allan
from imu_bench.metrology.combining import difference
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.statistics import describe
from imu_bench.metrology.trials.inclination import inclination
from imu_bench.metrology.trials.steps import find_stands, Stands
from imu_bench.offline.plans.plan import Floats, place, rate_of, seconds, thinned
from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.companions import companion
import numpy as np

HORIZONTAL = ('x', 'y', 'z')

FEWEST = 10
"""Samples of a step."""

AVERAGING_S = tuple(digit * 10.0**power for power in range(-3, 5) for digit in (1.0, 2.0, 5.0))
"""Averaging times at which the smallest step is given."""


@dataclass(frozen=True)
class TiltStep:
    """One step of one sensor."""

    # begin_s, end_s: s since the first sample of the recording's first sensor
    begin_s: float
    end_s: float
    samples: int
    # mean, three_sigma: of the angle, rad
    mean: Estimate
    three_sigma: Estimate
    on_chip: Estimate | None = None  # mean of the angle that the sensor computed itself
    disagreement: Estimate | None = None  # that minus `mean`


@dataclass(frozen=True, eq=False)
class Tilted:
    """One sensor on a tilt table."""

    source: str
    topic: str
    axis: str
    steps: tuple[TiltStep, ...]
    # time, angle: thinned, for the figure, s and rad
    time: Floats
    angle: Floats
    at_rest: DeviationCurve | None  # Allan deviation of the angle within the steps, rad


def choose_axis(recording: Recording, dwell_s: float, settle_s: float) -> tuple[str, Stands]:
    """Return the horizontal axis that was tilted most, and its steps."""
    found = {axis: find(recording, axis, dwell_s, settle_s) for axis in HORIZONTAL}
    axis = max(found, key=lambda name: _span(found[name]))
    if len(found[axis].stands) < 2:
        noise = math.degrees(found[axis].noise)
        raise RecordingError(
            f'{place(recording)}: no steps found: no angle has two levels apart from its noise '
            f'({noise:.2g}°) that last {dwell_s:g} s; give the times with --set '
            'times=0-20,23-43,… or another --set dwell'
        )
    return axis, found[axis]


def _span(stands: Stands) -> float:
    levels = [stand.level for stand in stands.stands]
    return max(levels) - min(levels) if len(levels) > 1 else 0.0


def find(recording: Recording, axis: str, dwell_s: float, settle_s: float) -> Stands:
    """Return the steps of one angle of a sensor."""
    try:
        return find_stands(
            angles(recording, axis), rate_of(recording), dwell_s=dwell_s, settle_s=settle_s
        )
    except DataError as error:
        raise RecordingError(f'{place(recording)}: no steps found: {error}') from error


def angles(recording: Recording, axis: str) -> Floats:
    """Return an angle of a sensor, rad."""
    force = recording.samples.acceleration
    if force is None or not np.isfinite(force[0]).all():
        raise RecordingError(
            f'{place(recording)}: no acceleration on three axes, so gravity gives no angle'
        )
    return inclination(force, axis)


def measure(
    recording: Recording,
    axis: str,
    spans: Sequence[tuple[float, float]],
    start_ns: int,
    confidence: float,
) -> Tilted:
    """Return what a sensor shows in the time spans of the steps."""
    angle = angles(recording, axis)
    when = seconds(recording, start_ns)
    own = _on_chip(recording, axis, start_ns)
    steps, held = [], np.zeros(angle.size, np.bool_)
    for number, (begin, end) in enumerate(spans, 1):
        inside = slice(*np.searchsorted(when, (begin, end)))
        part = angle[inside]
        if part.size < FEWEST:
            raise RecordingError(
                f'{place(recording)}: step {number} from {begin:g} s to {end:g} s holds '
                f'{part.size} samples; the recording ends at {when[-1]:.1f} s'
            )
        held[inside] = True
        found = describe(part, 'rad', confidence)
        chip = None if own is None else _mean_within(own, begin, end, confidence)
        apart = None if chip is None else difference(chip, found.mean)
        steps.append(TiltStep(begin, end, part.size, found.mean, found.three_sigma, chip, apart))
    curve = _at_rest(angle, held, rate_of(recording), steps, confidence)
    return Tilted(
        recording.source, recording.topic, axis, tuple(steps), *thinned(when, angle), curve
    )


def _on_chip(recording: Recording, axis: str, start_ns: int) -> tuple[Floats, Floats] | None:
    """Return times and angles that the sensor computed itself; None if there are none."""
    found = companion(recording, 'inclination') if axis[-1] in HORIZONTAL else None
    if found is None:
        return None
    sign = -1.0 if axis[0] == '-' else 1.0
    values = sign * found.values[:, HORIZONTAL.index(axis[-1])]
    return np.asarray((found.stamps - start_ns) * 1e-9, np.float64), values


def _mean_within(
    own: tuple[Floats, Floats], begin: float, end: float, confidence: float
) -> Estimate | None:
    part = own[1][slice(*np.searchsorted(own[0], (begin, end)))]
    return describe(part, 'rad', confidence).mean if part.size >= FEWEST else None


def _at_rest(
    angle: Floats,
    held: np.ndarray,
    rate_hz: float,
    steps: Sequence[TiltStep],
    confidence: float,
) -> DeviationCurve | None:
    """Return the Allan deviation of the angle within the steps, up to a quarter of one."""
    longest = 0.25 * min(step.end_s - step.begin_s for step in steps)
    factors = sorted({round(tau * rate_hz) for tau in AVERAGING_S if tau <= longest} - {0})
    if not factors:
        return None
    # a finite place for what is masked out
    filled = np.where(held, angle, 0.0)
    try:
        return allan.deviation(
            filled, rate_hz, tau=[m / rate_hz for m in factors], valid=held, unit='rad',
            confidence=confidence,
        )  # fmt: skip
    except DataError:  # not one averaging time: a note in the result says so
        return None
