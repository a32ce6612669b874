# SPDX-License-Identifier: Apache-2.0
"""The health check of one recording: every finding, and the facts about its clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.stamps.timing import analyse, Gap, Timing
from imu_bench.offline.analysis.axes import axes, Axis
from imu_bench.offline.analysis.typed import fields_of
from imu_bench.offline.health import runs, signals, stamps
from imu_bench.offline.health.finding import Finding, SEVERITIES, worst
from imu_bench.offline.health.motion import detect, Motion
from imu_bench.offline.health.runs import AxisFacts
from imu_bench.offline.health.signals import Spikes
from imu_bench.offline.health.stamps import delivery_findings, reading_findings
from imu_bench.offline.notation import number, percent
from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.companions import companion
import numpy as np
import numpy.typing as npt

_SEVERE_MOTION = 0.1  # share of the recording: of ten blocks one, no more a touch
# K; an IIM-42652 drifts by 0.15 mg per K, an MPU-9250 by 1.5 mg, a BNO055 by 1 mg and 0.015 °/s:
# 2 K are more than the bias instability of any of them
_TEMPERATURE_SPAN = 2.0


@dataclass(frozen=True, eq=False)
class Health:
    """What is to be known about a recording before believing its numbers."""

    findings: tuple[Finding, ...]  # the severe ones first
    # samples, stored, left_out: analysed; read; read but not a number
    samples: int
    stored: int
    left_out: int
    announced: int | None  # messages according to the metadata
    duration_s: float  # from the first to the last stamp
    # rate, jitter: true sample rate in Hz; scatter of the sample intervals in s
    rate: Estimate
    jitter: Estimate
    gaps: tuple[Gap, ...]  # the longest ones, in the order of time
    gap_count: int  # all of them
    # missing, duplicates, order_faults: samples that the true time grid lacks; stamps that repeat
    # or step back
    missing: int
    duplicates: int
    order_faults: int
    resolution: Mapping[str, Estimate]  # step between the values of each axis that is quantised
    # when the sensor moved: begin and end in s after the first sample of the recording
    motion: tuple[tuple[float, float], ...]
    still: tuple[float, float]  # the longest stretch without motion, counted in the same way
    # stamp_source, stamp_reason: which stamps were used and why
    stamp_source: str
    stamp_reason: str
    # mean in °C of the first and the last twentieth; empty where none was recorded
    temperature: tuple[float, ...] = ()
    # the full analysis of the stamps; None when read from JSON
    timing: Timing | None = field(default=None, repr=False)
    # axes whose noise is below their resolution; empty when read from JSON
    coarse: frozenset[str] = frozenset()
    # outliers of each axis; empty when read from JSON
    spikes: Mapping[str, Spikes] = field(default_factory=dict, repr=False)

    @property
    def severity(self) -> str:
        """The worst severity among the findings."""
        return worst(self.findings)

    @property
    def severe(self) -> tuple[Finding, ...]:
        """The findings for which the numbers are not to be trusted."""
        return tuple(found for found in self.findings if found.severity == 'severe')

    @property
    def moved(self) -> bool:
        """Whether the sensor moved, so that its noise figures describe the motion."""
        return any(finding.code == 'motion' for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object of schema imu_bench.analysis/1."""
        without = ('timing', 'coarse', 'spikes')
        document = fields_of(self, but=without, motion='motion_s', still='still_s')
        return {'severity': self.severity, **document}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Health:
        """Return the health that `to_json` wrote."""
        plain = (
            'samples', 'stored', 'left_out', 'announced', 'duration_s', 'gap_count', 'missing',
            'duplicates', 'order_faults', 'stamp_source', 'stamp_reason',
        )  # fmt: skip
        first, last = document['still_s']
        return cls(
            **{name: document[name] for name in plain},
            findings=tuple(Finding(**finding) for finding in document['findings']),
            rate=Estimate.from_json(document['rate']),
            jitter=Estimate.from_json(document['jitter']),
            gaps=tuple(Gap(**gap) for gap in document['gaps']),
            resolution={n: Estimate.from_json(e) for n, e in document['resolution'].items()},
            motion=tuple((a, b) for a, b in document['motion_s']),
            still=(first, last),
            temperature=tuple(document.get('temperature', ())),
        )


def check(
    recording: Recording,
    *,
    problems: Sequence[str] = (),
    timing: Timing | None = None,
    origin_ns: int | None = None,
) -> Health:
    """
    Return the health of a recording.

    Tones are found in the spectrum and are added by the analysis, which has it.
    """
    timing = analyse(recording.samples.stamps) if timing is None else timing
    rate = 1.0 / timing.period_s
    present = list(axes(recording.samples))
    facts = {axis.name: runs.examine(axis.values) for axis in present}
    motion = detect(present, rate)
    spikes = signals.spikes(facts, present, motion)
    stamps_ns = recording.samples.stamps
    origin = int(stamps_ns[0]) if origin_ns is None else origin_ns
    when = _clock(stamps_ns, origin)
    findings = [
        *reading_findings(recording, problems),
        *delivery_findings(recording.delivery, origin),
        *stamps.timing_findings(timing, origin),
        *stamps.clock_findings(recording),
        *_signal_findings(recording, present, facts, motion, when),
        *signals.spike_findings(spikes, when),
    ]
    first, last = motion.longest_still()
    return Health(
        findings=ranked(findings),
        samples=timing.samples,
        stored=recording.stored,
        left_out=recording.left_out,
        announced=recording.announced,
        duration_s=timing.duration_s,
        rate=typed(timing.rate) if recording.stamp_source == 'rate' else timing.rate,
        jitter=timing.jitter,
        gaps=timing.gaps,
        gap_count=timing.gap_count,
        missing=timing.missing,
        duplicates=timing.duplicates,
        order_faults=timing.order_faults,
        resolution={
            axis.name: Estimate(step, step, step, axis.unit, method='smallest step')
            for axis in present
            if (step := facts[axis.name].resolution) is not None
        },
        motion=tuple((when(a), when(b)) for a, b in motion.intervals()),
        still=(when(first), when(last))
        if motion.moving.any()
        else (when(0), when(stamps_ns.size)),
        stamp_source=recording.stamp_source,
        stamp_reason=recording.stamp_reason,
        temperature=_ends(recording),
        timing=timing,
        coarse=frozenset(name for name, fact in facts.items() if signals.is_coarse(fact)),
        spikes=spikes,
    )


def typed(rate: Estimate) -> Estimate:
    """Return a rate that the user gave: nothing measured it."""
    return Estimate(rate.value, None, None, 'Hz', rate.confidence, method='given with --rate')


def ranked(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return findings with the severe ones first."""
    return tuple(sorted(findings, key=lambda f: -SEVERITIES.index(f.severity)))


def _signal_findings(
    recording: Recording,
    present: list[Axis],
    facts: Mapping[str, AxisFacts],
    motion: Motion,
    when: Callable[[int], float],
) -> Iterator[Finding]:
    samples = recording.samples
    yield from signals.constant(facts)
    yield from signals.stuck(facts, present, when)
    yield from signals.repeated(samples, facts)
    yield from signals.saturated(facts, present)
    yield from signals.coarse(facts, present)
    yield from signals.impossible(facts, present, when)
    yield from signals.gravity(samples, motion.size, moved=motion.share > _SEVERE_MOTION)
    yield from _motion_finding(motion, when)
    yield from _temperature_finding(_ends(recording))


def _clock(stamps_ns: npt.NDArray[np.int64], origin: int) -> Callable[[int], float]:
    """Return the function from the position of a sample to its time in s."""

    def when(position: int) -> float:
        return (int(stamps_ns[min(position, stamps_ns.size - 1)]) - origin) * 1e-9

    return when


def _motion_finding(motion: Motion, when: Callable[[int], float]) -> Iterator[Finding]:
    intervals = motion.intervals()
    if not intervals:
        return
    named = ', '.join(f'{number(when(a), 3)} to {number(when(b), 3)} s' for a, b in intervals[:3])
    left = len(intervals) - 3
    more = '' if left < 1 else ' and once more' if left == 1 else f' and {left} more times'
    first, last = motion.longest_still()
    advice = 'Record again with the sensor at rest on a solid base.'
    if last - first > 0.1 * motion.moving.size * motion.size:
        advice = (
            f'Analyse the longest still stretch: --start {when(first):.0f} --end {when(last):.0f}.'
        )
    yield Finding(
        'severe' if motion.share > _SEVERE_MOTION else 'warning',
        'motion',
        f'The sensor moved {percent(motion.share)} of the time: {named}{more}.',
        'Noise, bias instability and random walk describe the motion, not the sensor.',
        advice,
    )


def _ends(recording: Recording) -> tuple[float, ...]:
    """Return the mean of the first and of the last twentieth, where it is known."""
    found = companion(recording, 'temperature')
    if found is None:
        return ()
    stamps = recording.samples.stamps
    during = (found.stamps >= stamps[0]) & (found.stamps <= stamps[-1])
    celsius = found.values[during, 0]
    edge = celsius.size // 20 or 1
    return (float(celsius[:edge].mean()), float(celsius[-edge:].mean())) if celsius.size else ()


def _temperature_finding(ends: Sequence[float]) -> Iterator[Finding]:
    if ends and abs(ends[1] - ends[0]) > _TEMPERATURE_SPAN:
        yield Finding(
            'info',
            'temperature',
            f'The sensor went from {ends[0]:.1f} to {ends[1]:.1f} °C.',
            'Bias drift with temperature appears as rate random walk and ramp.',
            'Let the sensor warm up as long before the test, in a room without draught.',
        )
