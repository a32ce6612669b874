# SPDX-License-Identifier: Apache-2.0
"""From a recording to results: health first, then every metric of every axis."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from imu_bench.counting import listed
from imu_bench.errors import DataError, RecordingError, TooShort
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.likelihood.events import Event
from imu_bench.metrology.likelihood.verdict import event_text
from imu_bench.metrology.stamps import timing
from imu_bench.metrology.stamps.timing import Grid
from imu_bench.offline import health, stages
from imu_bench.offline.analysis.axes import axes, Axis
from imu_bench.offline.analysis.axis import intervals, measure
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.analysis.temperature import said, Warmth, warmth
from imu_bench.offline.health import Health
from imu_bench.offline.health.check import ranked
from imu_bench.offline.health.finding import Finding, tone_findings
from imu_bench.offline.notation import number
from imu_bench.offline.recordings import Recording
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
    """Return health and metrics of one recording."""
    prepared = prepare(recording, settings or Settings(), problems)
    found = {}
    for axis in prepared.axes:
        try:
            found[axis.name] = prepared.measure(axis)
        except DataError as error:
            raise RecordingError(f'{prepared.result.where}: {error}') from error
        if progress is not None:
            progress(len(found), len(prepared.axes))
    return finish(prepared, found)


@dataclass(frozen=True, eq=False)
class Prepared:
    """A recording that was found fit to be measured."""

    result: RecordingResult  # without axes so far
    axes: tuple[Axis, ...]  # what is to be measured
    grid: Grid  # where on the time axis the samples are
    start_s: float  # time of the first sample in s after that of the recording
    settings: Settings
    warmth: Warmth | None  # the temperature, where it is known

    def measure(self, axis: Axis) -> AxisResult:
        """Return everything that is measured on one axis."""
        return measure(axis, self.grid, self.start_s, self.settings, self.warmth)


@stages.stage('health')
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
        raise TooShort(
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
        serial=part.serial,
    )
    present = tuple(
        axis._replace(spikes=state.spikes[axis.name].single) if axis.name in state.spikes else axis
        for axis in present
    )
    since_s = (int(stamps[0]) - origin) * 1e-9
    return Prepared(result, present, grid, since_s, settings, warmth(part))


def finish(prepared: Prepared, found: Mapping[str, AxisResult]) -> RecordingResult:
    """Return the result with its axes, in their order, and with what only these show."""
    measured = {axis.name: found[axis.name] for axis in prepared.axes}
    health_ = _with_axes(prepared, measured)
    return replace(prepared.result, health=health_, axes=measured)


def _why(prepared: Prepared, found: Mapping[str, AxisResult]) -> str:
    """Return whether the temperature is why the bias of axes moved; empty if none is known."""
    coarse = prepared.result.health.coarse
    moved = [name for name, axis in found.items() if name not in coarse and _events(axis)]
    return said((name, found[name].temperature) for name in moved)


def cut(recording: Recording, settings: Settings) -> Recording:
    """Return the part of a recording that the settings ask for, the whole of it if nothing."""
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


def _with_axes(prepared: Prepared, found: Mapping[str, AxisResult]) -> Health:
    """Return the health with what only the finished axes show."""
    state = prepared.result.health
    moved = any(f.code == 'motion' and f.severity == 'severe' for f in state.findings)
    why = '' if moved else _why(prepared, found)
    extra = tuple(axis_findings(list(found.values()), moved=moved, coarse=state.coarse, why=why))
    return replace(state, findings=ranked([*state.findings, *extra])) if extra else state


_NAMED = 4

_SHAKEN = 10.0
"""Factor by which the noise of no sensor changes by itself, be it warm or cold."""


def axis_findings(
    axes: Sequence[AxisResult], *, moved: bool, coarse: Collection[str] = (), why: str = ''
) -> Iterator[Finding]:
    """Yield what the axes of one recording show, and `why` the bias of some moved."""
    yield from tone_findings(
        {axis.name: axis.psd.tones for axis in axes if axis.psd is not None},
        {axis.name: axis.statistics['std'].value or 0.0 for axis in axes},
        [name for _, name in _changing(axes)],
    )
    if not moved:
        sound = [axis for axis in axes if axis.name not in coarse]
        yield from _unsteady(sound)
        yield from _moving(sound, why)
        yield from _disputed(sound)


def _changing(axes: Sequence[AxisResult]) -> list[tuple[Estimate, str]]:
    """Return the axes whose noise changed, and by which factor."""
    found: list[tuple[Estimate, str]] = []
    for axis in axes:
        steady = axis.checks.steadiness
        if steady and steady.verdict == 'changes':
            found.append((steady.ratio, axis.name))
    return found


def _unsteady(axes: Sequence[AxisResult]) -> Iterator[Finding]:
    found = _changing(axes)
    if not found:
        return
    found.sort(key=lambda row: -(row[0].value or 0.0))
    named = [f'{name} by a factor of {number(e.value or 1.0, 2)}' for e, name in found]
    shaken = (found[0][0].value or 1.0) >= _SHAKEN
    yield Finding(
        'severe' if shaken else 'warning',
        'unsteady_noise',
        f'The noise changed during the recording: {listed(named, _NAMED, "; ")}.',
        'The coefficients describe what shook the sensor for a while, not the sensor.'
        if shaken
        else 'One set of coefficients describes an average that held at no time; their intervals '
        'are too narrow.',
        'Look at the noise over time in the report; analyse the steady part with --start and '
        '--end.',
    )


def _events(axis: AxisResult) -> Sequence[Event]:
    """Return what the bias of an axis does that no noise does."""
    return axis.choice.events if axis.choice and axis.choice.speaks else ()


def _moving(axes: Sequence[AxisResult], why: str) -> Iterator[Finding]:
    """Yield what the bias does that no noise does, and spectra that no model describes."""
    found = [
        f'{axis.name}: {event_text(event, axis.unit)}' for axis in axes for event in _events(axis)
    ]
    if found:
        yield Finding(
            'warning',
            'bias_moves',
            f'The bias does more than noise does: {listed(found, _NAMED, "; ")}.'
            + (f' {why}' if why else ''),
            'B, K and R are withheld on these axes: they would describe this, not the sensor.',
            'Find the cause (temperature, supply, somebody touched it), or analyse a part without '
            'it with --start and --end.',
        )
    odd = [
        f'{axis.name} above {number(axis.choice.highest if axis.choice.described else 0.0, 3)} Hz'
        for axis in axes
        if axis.choice and axis.choice.speaks
        if axis.choice.lowered or not axis.choice.described
    ]
    if odd:
        yield Finding(
            'warning',
            'no_model',
            f'No model that was tried describes the spectrum of {listed(odd, _NAMED, "; ")}.',
            'N, B and K are those of the slower noise; what is above is not in them.',
            'Look at the spectrum: a resonance, vibration or noise that comes and goes.',
        )


def _disputed(axes: Sequence[AxisResult]) -> Iterator[Finding]:
    found = [
        f'{", ".join(axis.checks.second.disputed)} of {axis.name}'
        for axis in axes
        if axis.checks.second and axis.checks.second.disputed
    ]
    if not found:
        return
    yield Finding(
        'warning',
        'methods_disagree',
        f'The spectrum contradicts the Allan deviation on {listed(found, _NAMED, "; ")}.',
        'The data hold more than the noise of the model (vibration, steps, temperature): these '
        'coefficients depend on the method, and their intervals are too narrow.',
        'Look at the spectrum and the time series before using them.',
    )
