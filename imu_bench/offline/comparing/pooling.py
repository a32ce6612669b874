# SPDX-License-Identifier: Apache-2.0
"""Several recordings of one sensor as one: those of one serial number, or all with `--pool`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
import itertools

from imu_bench.counting import listed
from imu_bench.errors import DataError, RecordingError
from imu_bench.metrology.coefficients import noise_density
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.model_choice import EQUIVALENT
from imu_bench.metrology.fitting.noise_model import NoiseModel, TERMS
from imu_bench.metrology.likelihood.choice import walks
from imu_bench.metrology.likelihood.verdict import floor_seen
from imu_bench.metrology.noise_fit import fitted
from imu_bench.metrology.pooling import pooled, Scatter, scatter
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.runs import distinct
from imu_bench.offline.health.check import ranked
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.notation import date, number, text

_NAMED = 4
"""Names spelled out in one line."""

_FEW = 0.1
"""Share of recordings that may refuse a model by chance: 1 of 160 of 10 min did (misfit table)."""

COMPARED = ('N', 'B', 'K')
"""Coefficients whose scatter from recording to recording is given, beside mean and σ."""


def pool(results: Sequence[RecordingResult], confidence: float) -> list[RecordingResult]:
    """
    Return one result of every sensor that several recordings show, with its runs inside.

    A sensor is a topic with a serial number, or whatever each file holds where a file holds
    one.  What is in one recording only stays as it is.

    Raises
    ------
    RecordingError
        If no sensor is in two recordings, or rates or units differ.
    """
    sources = {result.source for result in results}
    if len(sources) < 2:
        raise RecordingError('--pool: give two recordings of a sensor or more')
    of_one = len(sources) == len(results) and not _serials(results)
    sensors: dict[tuple[str, str], list[RecordingResult]] = {}
    for result in results:
        key = ('', '') if of_one else (result.topic, result.serial)
        sensors.setdefault(key, []).append(result)
    if max(map(len, sensors.values())) < 2:
        raise RecordingError(
            '--pool: no topic is in two recordings with the same serial number; there are '
            f'{listed(sorted({result.topic for result in results}), _NAMED)}'
        )
    try:
        return [
            found[0] if len(found) == 1 else _sensor(found, confidence)
            for found in sensors.values()
        ]
    except RecordingError as error:
        raise RecordingError(f'--pool: {error}') from error


def pool_known(results: Sequence[RecordingResult], confidence: float) -> list[RecordingResult]:
    """
    Return results in which recordings of one topic and one serial number are one sensor.

    What tells no number stays as it is, and so does what cannot be pooled, with the reason.
    """
    sensors: dict[tuple[object, ...], list[RecordingResult]] = {}
    for index, one in enumerate(results):
        # an emulated chip has the number of no chip
        key = (one.topic, one.serial, bool(one.simulated)) if one.serial else (index,)
        sensors.setdefault(key, []).append(one)
    told = []
    for found in sensors.values():
        reason = _at_once(found)
        if len(found) > 1 and not reason:
            try:
                told.append(_by_number(_sensor(found, confidence)))
                continue
            except RecordingError as error:
                reason = str(error)
        told += [_apart(one, len(found), reason) for one in found] if reason else found
    return told


def _at_once(found: Sequence[RecordingResult]) -> str:
    """Return that recordings hold the same time, and so the same noise twice; empty if not."""
    in_order = sorted(found, key=lambda one: one.start_ns)
    for first, second in itertools.pairwise(in_order):
        if second.start_ns <= first.end_ns:
            return (
                f'{first.topic}: {first.source} and {second.source} are of the same time, '
                'and the same noise counts once'
            )
    return ''


def _by_number(sensor: RecordingResult) -> RecordingResult:
    """Return a pooled sensor that says why it is one, and how to see its recordings apart."""
    told = Finding(
        'info',
        'one_sensor',
        f'All {len(sensor.runs)} recordings tell the serial number {sensor.serial}.',
        'They are one sensor here.',
        'To see each for itself: --no-pool.',
    )
    return _with(sensor, told)


def _apart(one: RecordingResult, recordings: int, reason: str) -> RecordingResult:
    told = Finding(
        'info',
        'not_pooled',
        f'{recordings} recordings tell the serial number {one.serial} and cannot be pooled: '
        f'{reason}.',
        'None: each stands for itself.',
        'Give those together that belong together.',
    )
    return _with(one, told)


def _with(result: RecordingResult, told: Finding) -> RecordingResult:
    health = result.health
    return replace(result, health=replace(health, findings=ranked([*health.findings, told])))


def _serials(results: Sequence[RecordingResult]) -> set[str]:
    """Return the serial numbers if sensors differ in them."""
    found = {result.serial for result in results}
    return found if len(found) > 1 else set()


def run_names(runs: Sequence[RecordingResult]) -> list[str]:
    """Return the names of the files of runs, with what is before them where they are the same."""
    return distinct([run.source for run in runs])


def _sensor(found: Sequence[RecordingResult], confidence: float) -> RecordingResult:
    if all(date(one.start_ns) for one in found):  # seconds since power-up tell no order
        found = sorted(found, key=lambda one: one.start_ns)
    first = found[0]
    axes = {}
    for name in first.axes:
        if all(name in one.axes for one in found):
            try:
                axes[name] = _axis([one.axes[name] for one in found], confidence)
            except DataError as error:
                raise RecordingError(f'{first.topic}, {name}: {error}') from error
    finding = _differs({name: axis.between for name, axis in axes.items()}) or Finding(
        'info',
        'pooled',
        f'{len(found)} recordings are pooled; N, B and K differ between them by no more than the '
        'intervals of each explain.',
        'The intervals of the pooled numbers hold for all of them.',
        'Nothing needs to be done.',
    )
    every = [one.health for one in found]
    health = replace(
        first.health,
        findings=ranked([finding, *_shared(found)]),
        samples=sum(one.samples for one in every),
        stored=sum(one.stored for one in every),
        left_out=sum(one.left_out for one in every),
        announced=None,
        duration_s=sum(one.duration_s for one in every),
        rate=_mean([one.rate for one in every], confidence),
        jitter=_mean([one.jitter for one in every], confidence),
        missing=sum(one.missing for one in every),
        gap_count=sum(one.gap_count for one in every),
        gaps=(),
        duplicates=sum(one.duplicates for one in every),
        order_faults=sum(one.order_faults for one in every),
        motion=(),
        temperature=(),
        timing=None,
    )
    return replace(
        first,
        source=f'{len(found)} recordings',
        topic=_topic(found),
        end_ns=max(one.end_ns for one in found),
        health=health,
        axes=axes,
        intervals=None,
        rates={
            name: _mean([one.rates[name] for one in found if name in one.rates], confidence)
            for name in first.rates
        },
        runs=tuple(found),
    )


def _topic(found: Sequence[RecordingResult]) -> str:
    """Return the topic, or the name that numbered files have in common."""
    topics = {one.topic: one.topic.rstrip(' _-.0123456789') for one in found}
    bare = set(topics.values())
    return bare.pop() if len(topics) > 1 and len(bare) == 1 and '' not in bare else found[0].topic


def _mean(estimates: Sequence[Estimate], confidence: float) -> Estimate:
    """Return the mean over the runs; their scatter gives its interval."""
    spread = scatter(estimates, confidence)
    return estimates[0] if spread is None else spread.mean


def _shared(found: Sequence[RecordingResult]) -> Iterator[Finding]:
    """Yield every kind of finding of the runs once, and which of them have it."""
    kinds: dict[tuple[str, str], list[tuple[str, Finding]]] = {}
    for name, one in zip(run_names(found), found, strict=True):
        for finding in one.health.findings:
            kinds.setdefault((finding.severity, finding.code), []).append((name, finding))
    for several in kinds.values():
        names = list(dict.fromkeys(name for name, _ in several))
        told = several[0][1]
        if len(names) < len(found) or len({finding.text for _, finding in several}) > 1:
            who = f'{len(names)} of {len(found)} runs ({listed(names, _NAMED)})'
            if len(names) > 1:
                who += ', the first'
            told = replace(told, text=f'{who}: {told.text}', count=None, border='')
        if told.severity == 'severe' and len(names) < len(found):
            told = replace(told, action=f'{told.action} Or pool the others without it.')
        yield told


def _axis(same: Sequence[AxisResult], confidence: float) -> AxisResult:
    curves = [axis.allan for axis in same if axis.allan is not None]
    curve = pooled(curves)
    between = {
        name: spread
        for name in ('mean', 'std')
        if (spread := scatter([axis.statistics[name] for axis in same], confidence)) is not None
    }
    between |= {
        term: spread
        for term in COMPARED
        if (spread := scatter([axis.coefficient(term) for axis in same], confidence)) is not None
    }
    model = _heard(fitted(curve, confidence), same, between)
    model = floor_seen(model, max(curves, key=lambda one: one.span))
    density = noise_density(model)
    statistics = dict(same[0].statistics)
    for name in statistics:
        spread = between.get(name) or scatter([axis.statistics[name] for axis in same], confidence)
        if spread is not None:
            statistics[name] = spread.mean
    return AxisResult(
        name=same[0].name,
        unit=same[0].unit,
        statistics=statistics,
        noise_density=density,
        noise_density_methods={'allan': density},
        allan=curve,
        model=model,
        between=between,
    )


def _heard(
    model: NoiseModel, same: Sequence[AxisResult], between: Mapping[str, Scatter]
) -> NoiseModel:
    """Return the fit of the pool, or what the recordings give where their samples refuse it."""
    if len(same) == 1:
        return same[0].model
    events = sum(bool(c.events) for axis in same if (c := axis.choice) and c.speaks)
    against = sum(_refuses(axis, model) for axis in same)
    if against > _FEW * len(same):
        letters = TERMS
        why = f'in {against} of {len(same)} recordings the samples refuse the fit of the curve'
    elif not events:
        return _opened(model, same)
    else:
        letters = 'BKR'
        why = f'in {events} of {len(same)} recordings the bias does more than noise does'
    kept = {
        term: between[term].mean
        if term in between and between[term].records == len(same)
        else _none(found, why)
        for term, found in model.coefficients.items()
        if (term in letters and found.observable) or (term == 'N' and letters is TERMS)
    }
    if not kept:
        return model
    values = {term: estimate.value for term, estimate in kept.items()}
    model = replace(
        model,
        fitted={t: v for t, old in model.fitted.items() if (v := values.get(t, old)) is not None},
        low_pass=None if letters is TERMS else model.low_pass,
        flags=(f'{why}: {", ".join(kept)} are the means of what all of them give, or nothing',),
    )
    for term, estimate in kept.items():
        # a field of its own name for each letter
        model = replace(model, **{term: estimate})  # type: ignore[arg-type]
    return model


def _opened(model: NoiseModel, same: Sequence[AxisResult]) -> NoiseModel:
    """Return a model whose K has a remark if the samples do not tell it from something else."""
    heard = [c for axis in same if (c := axis.choice) and c.speaks]
    if not model.K.observable or not heard or walks(heard):
        return model
    flag = (
        f'K is not told from a Gauss-Markov process, or another power law, in {len(heard)} '
        'recordings together: what it makes of longer times is open'
    )
    return replace(model, flags=(*model.flags, flag))


def _none(found: Estimate, why: str) -> Estimate:
    return Estimate.not_observable(found.unit, why, high=found.high, confidence=found.confidence)


def _refuses(axis: AxisResult, pool: NoiseModel) -> bool:
    """Return whether the samples of a recording refuse what the pooled curve was fitted with."""
    choice = axis.choice
    if choice is None or not choice.speaks:
        return False
    if choice.lowered or choice.refutes_filter or not choice.described:
        return True
    other = set(choice.best.terms) & set('GF') and choice.without('GF') > EQUIVALENT
    return bool(other) and pool.gauss_markov is None


def _differs(spread: Mapping[str, Mapping[str, Scatter]]) -> Finding | None:
    found = [
        f'{term} of {axis} by {number(one.excess.value or 0.0, 2)} times ({text(one.std)})'
        for axis, by_term in spread.items()
        for term, one in by_term.items()
        if term in COMPARED and one.excess.low is not None and one.excess.low > 1.0
    ]
    if not found:
        return None
    return Finding(
        'warning',
        'recordings_differ',
        'The recordings differ by more than the intervals within them explain: '
        f'{"; ".join(found)}.',
        'The intervals of the pooled numbers are those within recordings; another recording may '
        'lie outside of them.',
        'Use mean and scatter of the recordings (between_recordings in the JSON document), and '
        'look for what changed.',
    )
