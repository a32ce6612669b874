# SPDX-License-Identifier: Apache-2.0
"""What results say in words: each sensor, what qualifies its numbers, and the whole run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import TERM_NAMES
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.drift import METHODS, Tracking
from imu_bench.offline.analysis.results import Analysis, RecordingResult
from imu_bench.offline.comparing.sensors import Comparison
from imu_bench.offline.health import Health
from imu_bench.offline.notation import (
    count,
    duration,
    grouped,
    number,
    percent,
    rate_text,
    readable_unit,
    short,
    text,
    unit_of,
    value_text,
)
from imu_bench.offline.presentation.sensor_tables import datasheet_sentence
from imu_bench.offline.presentation.uses import answers
from msg_conversions.quantities import IMU_QUANTITIES

NO_CONSTANTS = (
    'shows no constant signal (its spectrum falls off towards low frequencies), so that bias '
    'instability and random walk mean nothing'
)
_PARTIAL = (
    'averages count from {:g} % of their samples on (--min-share); white noise comes out too high '
    'by half of the share that is missing'
)


def of_sensor(recording: RecordingResult) -> list[str]:
    """Return what one recording says, a sentence per quantity."""
    lines = []
    for quantity in IMU_QUANTITIES:
        axes = recording.of(quantity.name)
        if axes:
            slow = (
                _term_words(axes) if any(axis.shows_constants for axis in axes) else [NO_CONSTANTS]
            )
            parts = [_density_words(axes), *slow]
            parts += _scatter_words(axes)
            lines.append(f'{quantity.sensor.capitalize()}: {"; ".join(parts)}.')
    return lines


def _scatter_words(axes: Sequence[AxisResult]) -> list[str]:
    """Return how far the bias differs from run to run, on the worst axis."""
    found = [(axis.between['mean'], axis.letter) for axis in axes if 'mean' in axis.between]
    if not found:
        return []
    worst, letter = max(found, key=lambda row: row[0].std.value or 0.0)
    unit = unit_of([worst.std], 'level')
    return [f'bias from run to run σ up to {text(worst.std, unit)} ({letter})']


def _density_words(axes: Sequence[AxisResult]) -> str:
    seen = [axis for axis in axes if axis.white_density.value is not None]
    if not seen:
        return 'no white noise was found'
    unit = unit_of([axis.white_density for axis in seen], 'density')
    seen.sort(key=lambda axis: axis.white_density.value or 0.0)
    low, high = seen[0].white_density.to(unit), seen[-1].white_density.to(unit)
    if short(low) == short(high):
        return f'noise density {short(low)} {unit}'
    first, last = seen[0].letter, seen[-1].letter
    return f'noise density {short(low)} ({first}) to {short(high)} {unit} ({last})'


def _term_words(axes: Sequence[AxisResult]) -> list[str]:
    words = []
    for term in 'BK':
        seen = [(getattr(axis.model, term), axis.letter) for axis in axes]
        observed = [(e, letter) for e, letter in seen if e.value is not None]
        name = TERM_NAMES[term]
        if observed:
            unit = unit_of([e for e, _ in observed], term)
            worst, letter = max(observed, key=lambda row: row[0].value or 0.0)
            words.append(f'{name} up to {short(worst.to(unit), 2)} {unit} ({letter})')
        elif any(e.high is not None for e, _ in seen):
            unit = unit_of([e for e, _ in seen], term)
            bound = max(e.to(unit).high or 0.0 for e, _ in seen)
            words.append(f'{name} not observable, below {number(bound, 2)} {unit}')
        else:
            words.append(f'{name} not observable')
    return words


def health_facts(health: Health) -> list[tuple[str, str]]:
    """Return the facts about a recording as names and values."""
    facts = [
        ('Duration', duration(health.duration_s)),
        ('Samples', count(health.samples, 'sample')),
        ('True rate', rate_text(health.rate)),
        ('Jitter of intervals', in_time_unit(health.jitter)),
        ('Missing', _missing(health)),
    ]
    if health.announced is not None:
        facts.append(
            ('Announced / read', f'{grouped(health.announced)} / {grouped(health.stored)}')
        )
    repeats = health.duplicates + health.order_faults
    if repeats:
        facts.append(('Duplicates / order faults', f'{health.duplicates} / {health.order_faults}'))
    facts.append(('Stamps from', health.stamp_source))
    return facts


def _missing(health: Health) -> str:
    if not health.missing:
        return 'none'
    share = health.missing / (health.missing + health.samples)
    return (
        f'{count(health.missing, "sample")} in {count(health.gap_count, "gap")}, {percent(share)}'
    )


def in_time_unit(estimate: Estimate) -> str:
    if estimate.value is None:
        return value_text(estimate)
    if estimate.value < 1e-9:
        return 'below 1 ns'  # what stamps can tell
    for unit, limit in (('s', 1.0), ('ms', 1e-3), ('µs', 1e-6)):
        if estimate.value >= limit:
            return text(estimate, unit)
    return text(estimate, 'ns')


def _once(said: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return (axis, words) with the letters of all axes of which the same is said."""
    letters: dict[str, list[str]] = {}
    for letter, words in said:
        letters.setdefault(words, []).append(letter)
    return [(', '.join(found), words) for words, found in letters.items()]


def fit_remarks(axes: Sequence[AxisResult]) -> list[str]:
    """Return why terms have no value, and what the fits want to be known."""
    said: list[tuple[str, str]] = []
    for axis in axes:
        if axis.allan and axis.allan.min_share < 1.0:
            said.append((axis.letter, _PARTIAL.format(100.0 * axis.allan.min_share)))
        if not axis.shows_constants:
            said.append((axis.letter, NO_CONSTANTS))
            continue
        said += [(axis.letter, flag) for flag in axis.model.flags]
        for term in 'NBK':
            estimate = getattr(axis.model, term)
            if not estimate.observable:
                said.append((axis.letter, f'{term}: {estimate.reason}'))
    return [f'{letters} – {remark}.' for letters, remark in _once(said)]


def fits(axes: Sequence[AxisResult]) -> list[str]:
    """Return over which averaging times the models were fitted, and how well they fit."""
    said: list[tuple[str, str]] = []
    for axis in axes:
        model = axis.model
        if model.fitted and axis.allan is not None:
            last = min(model.tau_high, float(axis.allan.tau[-1]))
            terms = ', '.join(model.fitted) + (' and T_c' if model.gauss_markov else '')
            taus = f'τ = {duration(model.tau_low)} to {duration(last)}'
            line = (
                f'fitted from {taus} with {terms}; mean squared residual '
                f'{number(model.chi2, 2)} times that expected'
            )
            said.append((axis.letter, line))
        if axis.choice:
            said += [(axis.letter, words) for words in axis.choice.words]
    return [f'{letters} – {line}.' for letters, line in _once(said)]


def density_verdicts(axes: Sequence[AxisResult]) -> list[str]:
    """Return why the ways to the noise density disagree, where they do."""
    found = [(axis.letter, axis.densities) for axis in axes]
    said = ((letter, d.verdict) for letter, d in found if d is not None and not d.agree)
    return [f'{letters}: {verdict}.' for letters, verdict in _once(said)]


def disagreements(axes: Sequence[AxisResult]) -> list[str]:
    """Return where the spectrum contradicts the fit."""
    return [
        f'{axis.letter}: {sentence}.'
        for axis in axes
        if axis.checks.second
        for sentence in axis.checks.second.disagreements
    ]


def tracking(axes: Sequence[AxisResult]) -> list[str]:
    """Return how well a filter with the Gauss-Markov models follows the bias."""
    return [
        f'{axis.letter}: {_tracking_words(axis.checks.drift.tracking)}'
        for axis in axes
        if axis.checks.drift and axis.checks.drift.tracking
    ]


def _tracking_words(found: Tracking) -> str:
    unit = readable_unit(found.rmse.unit, 'level', [found.rmse.value])
    claimed = number(found.deviation.to(unit).value or 0.0, 2)
    verdict = (
        'its innovations are white, so this model describes the drift'
        if found.white
        else 'its innovations are not white, so the drift is more than this one process'
    )
    return (
        f'a Kalman filter with the process of the {METHODS[found.source]} follows the bias to '
        f'{claimed} {unit} by its own account; it differs by {text(found.rmse, unit)} RMS from '
        f'the average over {duration(found.window_s)}; {verdict} (normalised variance '
        f'{number(found.variance, 3)}).'
    )


def steadiness(axes: Sequence[AxisResult]) -> list[str]:
    """Return whether the noise stayed the same, one line for axes that say the same."""
    said = ((axis.letter, axis.checks.steadiness.text) for axis in axes if axis.checks.steadiness)
    return [f'{letters}: {words}.' for letters, words in _once(said)]


def of_all(analysis: Analysis, comparison: Comparison, *, si: bool = False) -> list[str]:
    """Return what the whole run says, a sentence each, perhaps in SI."""
    recordings = analysis.sensors
    labels = comparison.labels[: len(recordings)]
    simulated = of_simulation([recording.simulated for recording in recordings])
    lines = [*simulated, _recorded(analysis), *_perhaps_one(recordings)]
    lines += answers(recordings, labels, comparison, si=si)
    lines += _without_constants(recordings, labels)
    lines += [
        f'Of the simulation, which takes its noise from data sheets: {line}' if simulated else line
        for line in datasheet_sentence(comparison.verdicts)
    ]
    lines.append(_health_line(recordings, labels))
    return lines + _unseen(recordings, labels)


OF_OTHERS = 'Of others: recorded as well, though nobody asked for it'
"""Heading of topics that are of no sensor of the bench."""


def of_simulation(found: Sequence[str]) -> list[str]:
    """
    Return one sentence if recordings were simulated, or none.

    Parameters
    ----------
    found : sequence of str
        Of each recording what made it, empty if it was measured.

    Examples
    --------
    >>> of_simulation(['', ''])
    []
    >>> of_simulation(['emulated mpu9250', ''])[0][:58]
    'SIMULATED DATA: 1 of 2 recordings are of no real sensor. T'
    """
    made = sum(map(bool, found))
    if not made:
        return []
    who = f'{made} of {len(found)} recordings are' if len(found) > 1 else 'this recording is'
    said = f'SIMULATED DATA: {who} of no real sensor.'
    return [f'{said} The numbers say what went into the simulation, not what a sensor does.']


def _recorded(analysis: Analysis) -> str:
    """Return how much was recorded."""
    recordings = analysis.sensors
    samples = count(sum(r.health.samples for r in recordings), 'sample')
    seconds = [recording.health.duration_s for recording in recordings]
    first, last = duration(min(seconds)), duration(max(seconds))
    length = first if first == last else f'{first} to {last}'
    failed = len(analysis.failures)
    lost = f' {count(failed, "input")} could not be analysed, see below.' if failed else ''
    others = count(len(analysis.recordings) - len(recordings), 'topic')
    apart = f' {others} of others, apart.' if analysis.recordings != recordings else ''
    runs = sum(len(recording.runs) for recording in recordings)
    pooled = f' in {count(runs, "run")}' if runs else ''
    return f'{count(len(recordings), "sensor")}{pooled}, {length}, {samples}.{apart}{lost}'


def _perhaps_one(recordings: Sequence[RecordingResult]) -> list[str]:
    """Return that recordings of one topic, of which no serial number is known, can be pooled."""
    topics, sources = ({getattr(one, name) for one in recordings} for name in ('topic', 'source'))
    if len(topics) > 1 or len(sources) < 2 or any(one.serial for one in recordings):
        return []
    return [f'If the {len(recordings)} recordings are of one sensor, --pool makes one of them.']


def _without_constants(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> list[str]:
    return [
        f'{label}: the {quantity.sensor} {NO_CONSTANTS}; '
        'it suits vibration, not tilt or navigation.'
        for recording, label in zip(recordings, labels, strict=True)
        for quantity in IMU_QUANTITIES
        if (axes := recording.of(quantity.name)) and not any(axis.shows_constants for axis in axes)
    ]


def _health_line(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> str:
    if bad := _found('severe', recordings, labels):
        return f'Not to be trusted without reading its findings: {bad}.'
    if doubtful := _found('warning', recordings, labels):
        return f'Findings affect part of the numbers of {doubtful}.'
    return 'The recordings are in good health: nothing casts doubt on the numbers.'


def _found(severity: str, recordings: Sequence[RecordingResult], labels: Sequence[str]) -> str:
    """Return the sensors with findings of a severity by what was found, said once for many."""
    found: dict[str, list[str]] = {}
    for recording, label in zip(recordings, labels, strict=True):
        codes = dict.fromkeys(
            finding.code.replace('_', ' ')
            for finding in recording.health.findings
            if finding.severity == severity
        )
        if codes:
            found.setdefault(', '.join(codes), []).append(label)
    return '; '.join(f'{_all_of(names, labels)} ({codes})' for codes, names in found.items())


def _all_of(names: Sequence[str], labels: Sequence[str]) -> str:
    return f'all {len(labels)}' if len(names) == len(labels) > 1 else ', '.join(names)


def _unseen(recordings: Sequence[RecordingResult], labels: Sequence[str]) -> list[str]:
    """Return one sentence on the coefficients that the recordings were too short for."""
    missing = {
        term: [
            label
            for recording, label in zip(recordings, labels, strict=True)
            if (slow := [axis for axis in recording.axes.values() if axis.shows_constants])
            and all(not getattr(axis.model, term).observable for axis in slow)
        ]
        for term in 'BK'
    }
    return [
        f'No {TERM_NAMES[term]} ({term}) was observable in '
        f'{"any recording" if len(names) == len(labels) else ", ".join(names)}; '
        'the tables give upper bounds and how long to record.'
        for term, names in missing.items()
        if names
    ]
