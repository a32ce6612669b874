# SPDX-License-Identifier: Apache-2.0
"""What is kept of one recording of a shaker: its zones, and each axis in each of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.spectra.snr import snr
from imu_bench.metrology.stamps.time_grid import Grid, grid, place
from imu_bench.metrology.stretches import stretches
from imu_bench.metrology.trials import zones as zoning
from imu_bench.metrology.trials.crosstalk import mean_squares
from imu_bench.metrology.trials.zones import Run, Zone
from imu_bench.offline.analysis.axes import axes, Axis
from imu_bench.offline.comparing.sensors import labels
from imu_bench.offline.plans.sine_on_random.control import Controlled, controlled
from imu_bench.offline.plans.sine_on_random.identity import identify, Identity, SWEPT
from imu_bench.offline.recordings import Recording
from msg_conversions.quantities import ANGULAR_VELOCITY, LINEAR_ACCELERATION
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

FIGURE_POINTS = 600


@dataclass(frozen=True, eq=False)
class AxisRun:
    """One axis of one sensor in one repetition."""

    name: str
    unit: str
    # before, after: mean and standard deviation in the quiet zones
    before: tuple[Estimate, Estimate]
    after: tuple[Estimate, Estimate] | None
    # quiet, shaken: mean squares of successive blocks about the mean of the zone before, which is
    # what the axis shows without vibration, gravity included
    quiet: Floats
    shaken: Floats


@dataclass(frozen=True, eq=False)
class SensorRun:
    """One sensor in one repetition."""

    sensor: str
    source: str
    identity: Identity
    rate_hz: float
    zones: Run
    axes: Mapping[str, AxisRun]  # by name, such as 'linear_acceleration.x'
    snr: Estimate  # of the excited accelerometer axis in the test zone
    fundamental: float | None  # frequency of the sine as the sensor shows it, Hz
    # the spectrum of the test zone, of the control accelerometer alone
    control: Controlled | None = None


@dataclass(frozen=True, eq=False)
class Shaken:
    """What is kept of one recording."""

    source: str
    runs: tuple[SensorRun, ...]
    # time in s and acceleration (RMS of blocks, m/s²) of the first sensor, to look at the zones
    level: tuple[Floats, Floats]


def measure(
    source: str, recordings: Sequence[Recording], settings: Mapping[str, Any], confidence: float
) -> Shaken:
    """Return what is kept of one recording."""
    identity = identify(source, settings)
    excited = f'{LINEAR_ACCELERATION.name}.{identity.axis}'
    found: list[SensorRun] = []
    level: tuple[Floats, Floats] | None = None
    for name, recording in zip(labels(recordings), recordings, strict=True):
        there = list(axes(recording.samples))
        if not any(axis.name == excited for axis in there):
            continue
        where = grid(recording.samples.stamps)
        placed = [_Placed.of(axis, where) for axis in there]
        power, block_s = _power(placed, 1.0 / where.period_s, f'{source}, {name}')
        runs = _zones(power, block_s, where, settings, f'{source}, {name}')
        level = level or _level(power, block_s)
        reader = _Reader(name, source, identity, where, settings, confidence)
        found += [reader.read(run, placed) for run in runs]
    if not found or level is None:
        raise RecordingError(
            f'{source}: no sensor in it has the excited axis, accelerometer {identity.axis}'
        )
    return Shaken(source, tuple(found), level)


@dataclass(frozen=True, eq=False)
class _Placed:
    """An axis on the regular time grid."""

    axis: Axis
    values: Floats
    valid: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, axis: Axis, where: Grid) -> _Placed:
        return cls(axis, *place(axis.values, where))

    def chosen(self, zone: Zone, rate_hz: float) -> Floats:
        """Return the samples in a zone, missing ones left out."""
        part = zone.samples(rate_hz)
        values, valid = self.values[part], self.valid[part]
        return values if valid.all() else values[valid]


def _power(placed: Sequence[_Placed], rate_hz: float, where: str) -> tuple[Floats, float]:
    """Return how strongly a sensor moves, all accelerometer axes together."""
    columns = [p.values for p in placed if p.axis.quantity is LINEAR_ACCELERATION]
    try:
        return zoning.power(np.stack(columns, axis=1), rate_hz)
    except DataError as error:
        raise RecordingError(f'{where}: {error}') from error


def _zones(
    power: Floats, block_s: float, where: Grid, settings: Mapping[str, Any], name: str
) -> list[Run]:
    length_s = where.span * where.period_s
    given, shortest_s = settings['zones'], settings['shortest'][0]
    if given is not None:
        return _given(given, length_s, name)
    try:
        shaken = zoning.shaken(power, block_s, shortest_s)
    except DataError as error:
        raise RecordingError(f'{name}: no test zone found: {error}; {_ADVICE}') from error
    runs = zoning.runs(shaken, length_s, shortest_s)
    if not runs:
        raise RecordingError(
            f'{name}: no test zone of {shortest_s:g} s or more found; {_ADVICE}, or a smaller '
            '--set shortest='
        )
    quiet = [run for run in runs if run.before is not None]
    if not quiet:
        raise RecordingError(
            f'{name}: no quiet zone of {shortest_s:g} s before the vibration, which begins at '
            f'{runs[0].test.begin_s:.3g} s; {_ADVICE}'
        )
    return quiet


_ADVICE = "give the lengths of the zones with --set 'zones=3 min, 10 min, 3 min'"


def _given(lengths: Sequence[float], length_s: float, name: str) -> list[Run]:
    if len(lengths) != 3 or lengths[0] <= 0.0 or lengths[1] <= 0.0:
        raise RecordingError(
            f'{name}: --set zones= takes the lengths of the zones before, test and after, such '
            "as 'zones=3 min, 10 min, 3 min'"
        )
    before, test, after = lengths
    count = max(1, round(length_s / (before + test + after)))
    if length_s < before + test:
        raise RecordingError(
            f'{name}: {length_s:.4g} s long, but the zones before and test given with --set '
            f'zones= take {before + test:g} s'
        )
    runs = []
    for number in range(count):
        begin = number * (before + test + after)
        end = min(begin + before + test + after, length_s)
        quiet = Zone(begin + before + test, end)
        runs.append(
            Run(
                Zone(begin, begin + before),
                Zone(begin + before, min(begin + before + test, length_s)),
                quiet if quiet.length_s > 0.1 * before else None,
            )
        )
    return runs


def _level(power: Floats, block_s: float) -> tuple[Floats, Floats]:
    """Return the acceleration over time, thinned to what a figure can show."""
    size = max(1, -(-power.size // FIGURE_POINTS))
    count = power.size // size
    joined = power[: count * size].reshape(count, size).mean(axis=1)
    time = np.asarray((np.arange(count) + 0.5) * size * block_s, np.float64)
    return time, np.asarray(np.sqrt(joined), np.float64)


@dataclass(frozen=True)
class _Reader:
    """Reads the zones of one sensor."""

    sensor: str
    source: str
    identity: Identity
    where: Grid
    settings: Mapping[str, Any]
    confidence: float

    @property
    def rate_hz(self) -> float:
        return 1.0 / self.where.period_s

    def read(self, run: Run, placed: Sequence[_Placed]) -> SensorRun:
        guard = self.settings['guard'][0]
        inner = Run(
            run.before and run.before.inside(guard),
            run.test.inside(guard),
            run.after and run.after.inside(guard),
        )
        excited = f'{LINEAR_ACCELERATION.name}.{self.identity.axis}'
        main = next(p for p in placed if p.axis.name == excited)
        ratio, fundamental = self._snr(main, inner.test)
        control = None
        if self.sensor == self.settings['control']:
            values = main.chosen(inner.test, self.rate_hz)
            control = controlled(values, self.rate_hz, self.settings, self.confidence)
        return SensorRun(
            self.sensor, self.source, self.identity, self.rate_hz, run,
            {p.axis.name: axis for p in placed for axis in self._axis(p, inner)},
            ratio, fundamental, control,
        )  # fmt: skip

    def _axis(self, placed: _Placed, run: Run) -> Iterator[AxisRun]:
        if placed.axis.quantity not in (LINEAR_ACCELERATION, ANGULAR_VELOCITY):
            return
        unit = placed.axis.unit
        before, test, after = (
            None if zone is None else placed.chosen(zone, self.rate_hz)
            for zone in (run.before, run.test, run.after)
        )
        if before is None or test is None or min(before.size, test.size) < 2:
            raise RecordingError(f'{self.source}, {self.sensor}: a zone holds no samples')
        zero = float(before.mean())
        yield AxisRun(
            placed.axis.name, unit,
            self._quiet(before, unit),
            None if after is None or after.size < 2 else self._quiet(after, unit),
            mean_squares(before, zero), mean_squares(test, zero),
        )  # fmt: skip

    def _quiet(self, values: Floats, unit: str) -> tuple[Estimate, Estimate]:
        moments = Moments.of(values[None, :])
        return (
            moments.mean_estimate(0, unit, self.confidence),
            moments.std_estimate(0, unit, self.confidence),
        )

    def _snr(self, main: _Placed, test: Zone) -> tuple[Estimate, float | None]:
        if self.identity.condition in SWEPT:
            reason = 'a swept sine has no line in the spectrum'
            return Estimate.not_observable('dB', reason, confidence=self.confidence), None
        part = test.samples(self.rate_hz)
        values, valid = main.values[part], main.valid[part]
        # without a gap: the longest run of them
        begin, end = max(
            stretches(valid).tolist(), key=lambda run: run[1] - run[0], default=(0, 0)
        )
        run = values[begin:end]
        try:
            found = snr(
                run, self.rate_hz,
                harmonics=self.settings['harmonics'], confidence=self.confidence,
            )  # fmt: skip
        except DataError as error:
            reason = f'{error}'
            return Estimate.not_observable('dB', reason, confidence=self.confidence), None
        return found.ratio, found.frequency
