# SPDX-License-Identifier: Apache-2.0
"""From a recording to results: health first, then every metric of every axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.stamps import timing
from imu_bench.metrology.stamps.timing import Grid
from imu_bench.offline import health
from imu_bench.offline.axes import axes, Axis
from imu_bench.offline.axis_analysis import measure
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.check_findings import axis_findings
from imu_bench.offline.health import Health
from imu_bench.offline.health.check import ranked
from imu_bench.offline.recordings import Recording
from imu_bench.offline.reduction import intervals
from imu_bench.offline.results import RecordingResult
from imu_bench.offline.settings import Settings
import numpy as np

__all__ = ['Prepared', 'Settings', 'analyse', 'cut', 'finish', 'measure', 'prepare']

Progress = Callable[[int, int], None]
"""Called with the number of axes done and their number."""

_FEWEST = 10  # samples; fewer give no curve worth the name


def analyse(
    recording: Recording,
    settings: Settings | None = None,
    *,
    problems: Sequence[str] = (),
    progress: Progress | None = None,
) -> RecordingResult:
    """
    Return health and metrics of one recording.

    Parameters
    ----------
    recording : Recording
    settings : Settings, optional
    problems : sequence of str, optional
        What went wrong while the recording was opened and read.
    progress : callable, optional
        Called with (axes done, axes) after each axis.

    Raises
    ------
    RecordingError
        If the part asked for holds too few samples, or no axis with numbers.
    """
    prepared = prepare(recording, settings or Settings(), problems)
    found = {}
    for axis in prepared.axes:
        try:
            found[axis.name] = measure(axis, prepared.grid, prepared.start_s, prepared.settings)
        except DataError as error:
            raise RecordingError(f'{prepared.result.where}: {error}') from error
        if progress is not None:
            progress(len(found), len(prepared.axes))
    return finish(prepared, found)


@dataclass(frozen=True, eq=False)
class Prepared:
    """
    A recording that was found fit to be measured.

    Attributes
    ----------
    result : RecordingResult
        Without axes so far.
    axes : tuple of Axis
        What is to be measured.
    grid : Grid
        Where on the time axis the samples are.
    start_s : float
        Time of the first sample in s after that of the recording.
    settings : Settings
    """

    result: RecordingResult
    axes: tuple[Axis, ...]
    grid: Grid
    start_s: float
    settings: Settings


def prepare(recording: Recording, settings: Settings, problems: Sequence[str] = ()) -> Prepared:
    """
    Return the health of a recording and what is to be measured on it.

    Parameters and errors are those of `analyse`.
    """
    origin = int(recording.samples.stamps[0])
    part = cut(recording, settings)
    stamps = part.samples.stamps
    where = f'{part.source}, topic {part.topic}'
    if stamps.size < _FEWEST:
        raise RecordingError(
            f'{where}: {stamps.size} samples are too few to analyse, at least {_FEWEST} are needed'
        )
    present = tuple(axes(part.samples))
    if not present:
        raise RecordingError(f'{where}: no axis holds numbers')
    try:
        clock = timing.analyse(stamps, confidence=settings.confidence)
        grid = timing.grid(stamps)
        state = health.check(part, problems=problems, timing=clock, origin_ns=origin)
    except DataError as error:
        raise RecordingError(f'{where}: {error}') from error
    result = RecordingResult(
        source=part.source,
        topic=part.topic,
        frame_id=part.frame_id,
        start_ns=int(stamps[0]),
        end_ns=int(stamps[-1]),
        origin_ns=origin,
        health=state,
        axes={},
        intervals=intervals(stamps, grid.period_s),
    )
    return Prepared(result, present, grid, (int(stamps[0]) - origin) * 1e-9, settings)


def finish(prepared: Prepared, found: Mapping[str, AxisResult]) -> RecordingResult:
    """Return the result with its axes, in their order, and with what only these show."""
    measured = {axis.name: found[axis.name] for axis in prepared.axes}
    health_ = _with_axes(prepared.result.health, measured)
    return replace(prepared.result, health=health_, axes=measured)


def cut(recording: Recording, settings: Settings) -> Recording:
    """
    Return the part of a recording that the settings ask for, the whole of it if nothing.

    Raises
    ------
    RecordingError
        If it holds no sample there.
    """
    stamps = recording.samples.stamps
    first, last = int(stamps[0]), int(stamps.max())
    low, high = settings.window_ns or (first, last)
    if settings.start_s is not None:
        low = first + round(settings.start_s * 1e9)
    if settings.end_s is not None:
        high = first + round(settings.end_s * 1e9)
    if settings.window_ns is None and settings.start_s is None and settings.end_s is None:
        return recording
    inside = np.flatnonzero((stamps >= low) & (stamps <= high))
    if not inside.size:
        asked = _asked(settings, first, last)
        raise RecordingError(f'{recording.source}, topic {recording.topic}: no sample {asked}')
    # one slice where the stamps are in order: views, not copies
    part = slice(int(inside[0]), int(inside[-1]) + 1)
    received = recording.receive_ns
    return replace(
        recording,
        samples=recording.samples[part],
        receive_ns=None if received is None else received[part],
    )


def _asked(settings: Settings, first: int, last: int) -> str:
    """Return which part was asked for, and which there is, in the terms of the option."""
    if settings.window_ns is not None:
        low, high = settings.window_ns
        return f'with a stamp from {low} to {high} ns; its stamps are {first} to {last} ns'
    begin, end, length = settings.start_s or 0.0, settings.end_s, (last - first) * 1e-9
    part = f'from {begin:.10g} s on' if end is None else f'between {begin:.10g} and {end:.10g} s'
    return f'{part}, counted from the first one; the last one is at {length:.10g} s'


def _with_axes(state: Health, found: Mapping[str, AxisResult]) -> Health:
    """Return the health with what only the finished axes show."""
    moved = any(f.code == 'motion' and f.severity == 'severe' for f in state.findings)
    extra = tuple(axis_findings(list(found.values()), moved=moved, coarse=state.coarse))
    return replace(state, findings=ranked([*state.findings, *extra])) if extra else state
