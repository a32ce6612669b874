# SPDX-License-Identifier: Apache-2.0
"""Findings about the numbers themselves: constant, stuck, saturated, coarse, spikes, scale."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import math

from imu_bench.offline.axes import Axis
from imu_bench.offline.health import runs
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.health.motion import Motion
from imu_bench.offline.health.runs import Numbers
from imu_bench.offline.notation import count, duration, number, percent
from imu_bench.samples import LINEAR_ACCELERATION, Samples
from imu_bench.units import STANDARD_GRAVITY
import numpy as np

_STUCK_SEVERE = 0.05  # share of the recording: σ comes out 2.5 % too low
# samples at the extreme; times as many as at a value next to it: 1 of 5460 ends of rounded
# Gaussian records (10³ to 10⁵ samples, steps of 0.03 σ to 0.6 σ) was taken for saturated
_SATURATED, _PILE = 5, 3
_LEVELS = 16  # fewer levels make piling up at the extreme normal
_REPEATED, _REPEATED_SEVERE = 0.01, 0.2  # share of whole samples that repeat, beyond chance
_CUT_SEVERE = 1e-3  # share of samples at the end of the range: those beyond 3.3 σ of noise
# σ of a sample off the line between its neighbours, 8.2 of what this has itself: Gaussian noise
# gets there once in 3·10¹⁵ samples
_SPIKE = 10.0
_EQUAL = 0.25  # share of samples that repeat: half of them make the median step zero
_ROUNDED = 0.5  # steps by which rounding can move the median that the noise is taken from
_COARSE = 0.5  # steps; rounding adds a twelfth of a squared step to the variance
_GRAVITY = 0.15  # relative: scale and offset of consumer parts, ±3 % and ±80 mg of an MPU-9250


def constant(facts: Mapping[str, Numbers]) -> Iterator[Finding]:
    """Yield axes that never change."""
    still = [name for name, fact in facts.items() if fact.lowest == fact.highest]
    if not still:
        return
    zero = all(facts[name].lowest == 0.0 for name in still)
    yield Finding(
        'severe',
        'constant',
        f'{_names(still)} {"is" if len(still) == 1 else "are"} constant'
        f'{" at zero" if zero else ""}.',
        'There is no noise to measure: only mean values are given.',
        'Check that the sensor measures this axis; a driver that does not should set covariance '
        'element 0 to -1.',
    )


def stuck(
    facts: Mapping[str, Numbers], signals: Sequence[Axis], when: Callable[[int], float]
) -> Iterator[Finding]:
    """Yield axes that hold one value for longer than chance allows."""
    held = {
        name: fact.frozen
        for name, fact in facts.items()
        if fact.frozen and fact.lowest != fact.highest
    }
    if not held:
        return
    size = signals[0].values.size
    lost = max(sum(length for _, length in spans) for spans in held.values())
    name, (first, length) = max(
        ((n, max(spans, key=lambda run: run[1])) for n, spans in held.items()),
        key=lambda item: item[1][1],
    )
    yield Finding(
        'severe' if lost / size > _STUCK_SEVERE else 'warning',
        'stuck',
        f'{_names(list(held))} held one value too long, {percent(lost / size)} of the time: '
        f'{name} for {count(length, "sample")} at t = {duration(when(first))}.',
        'Frozen samples carry no noise: σ and noise density come out too low.',
        'Look for a driver that repeats old data after a read error, or a sensor that stopped.',
    )


def repeated(samples: Samples, facts: Mapping[str, Numbers]) -> Iterator[Finding]:
    """Yield whole samples that repeat the one before: read faster than the sensor measures."""
    moving = {n: f for n, f in facts.items() if f.lowest != f.highest}
    size = len(samples)
    if len(moving) < 2 or any(f.frozen for f in moving.values()):
        return
    chance = float(np.prod([fact.repeated for fact in moving.values()]))
    if min(fact.repeated for fact in moving.values()) <= _REPEATED + 5.0 * chance:
        return
    columns = [
        column
        for vectors in (samples.acceleration, samples.angular_velocity)
        if vectors is not None
        for column in vectors.T
        if not np.isnan(column[0])
    ]
    share = runs.repeated_rows(columns) / max(size - 1, 1)
    if share > _REPEATED + 5.0 * chance:
        yield Finding(
            'severe' if share > _REPEATED_SEVERE else 'warning',
            'repeated',
            f'{percent(share)} of the samples repeat the one before in every axis.',
            'The sensor is read faster than it measures: neighbouring samples are not '
            'independent, and the noise density is wrong at short averaging times.',
            'Read on the data-ready interrupt or the FIFO, or lower the read rate.',
        )


def saturated(facts: Mapping[str, Numbers], signals: Sequence[Axis]) -> Iterator[Finding]:
    """Yield axes that pile up at an extreme value: the signal was cut off there."""
    cut: list[str] = []
    share = 0.0
    for axis in signals:
        fact = facts[axis.name]
        if fact.lowest == fact.highest:
            continue
        if fact.resolution and fact.highest - fact.lowest < _LEVELS * fact.resolution:
            continue
        for top, at in ((False, fact.at_lowest), (True, fact.at_highest)):
            extreme = fact.highest if top else fact.lowest
            if at < _SATURATED or extreme == 0.0:
                continue
            if at > _PILE * runs.levels_inside(axis.values, extreme, top=top):
                cut.append(f'{axis.name} at {number(extreme)} {axis.unit}')
                share = max(share, at / axis.values.size)
    if cut:
        yield Finding(
            'severe' if share > _CUT_SEVERE else 'warning',
            'saturated',
            f'Saturated: {"; ".join(cut)} (up to {percent(share)} of the samples).',
            'The signal was cut off: mean, σ and spectrum are wrong there.',
            'Choose a larger measuring range, or keep the sensor still.',
        )


def is_coarse(fact: Numbers) -> bool:
    """Return whether the noise of an axis that is not constant is below its resolution."""
    step = fact.resolution
    if step is None or fact.lowest == fact.highest:
        return False
    # neighbours behind a low-pass differ by less than the noise
    return fact.noise < _COARSE * step and fact.scatter < math.sqrt(_COARSE**2 + 1 / 12) * step


def coarse(facts: Mapping[str, Numbers], signals: Sequence[Axis]) -> Iterator[Finding]:
    """Yield axes whose noise is smaller than their resolution."""
    found = [
        f'{axis.name} ({number(facts[axis.name].resolution or 0.0, 3)} {axis.unit})'
        for axis in signals
        if is_coarse(facts[axis.name])
    ]
    if found:
        yield Finding(
            'warning',
            'resolution',
            f'The noise is smaller than the resolution: {"; ".join(found)}.',
            'σ, noise density and N describe the steps of the numbers, not the sensor.',
            'Choose a smaller measuring range or a message with more digits.',
        )


def spikes(
    facts: Mapping[str, Numbers],
    signals: Sequence[Axis],
    motion: Motion,
    when: Callable[[int], float],
) -> Iterator[Finding]:
    """Yield single samples far off their neighbours, outside of motion."""
    total, named = 0, []
    first = signals[0].values.size if signals else 0
    for axis in signals:
        fact = facts[axis.name]
        # where many neighbours are equal, of repeated or coarse samples, they tell no noise
        noise = max(fact.noise, fact.scatter) if fact.repeated > _EQUAL else fact.noise
        limit = _SPIKE * (noise + _ROUNDED * (fact.resolution or 0.0))
        if limit <= 0.0 or motion.share == 1.0:
            continue
        found = runs.spikes(axis.values, limit)
        found = found[~motion.at(found)]
        if found.size:
            total += found.size
            named.append(axis.name)
            first = min(first, int(found[0]))
    if total:
        yield Finding(
            'warning',
            'outliers',
            f'{count(total, "outlier")} beyond {_SPIKE:g} σ in {_names(named)}, the first at '
            f't = {duration(when(first))}.',
            'Each one raises σ, peak values and the deviation at short averaging times.',
            'Look for transfer errors on the bus; touch nothing near the sensor during the test.',
        )


def gravity(samples: Samples, block: int) -> Iterator[Finding]:
    """Yield an acceleration whose size is not that of gravity: units or scale are wrong."""
    vectors = samples.acceleration
    if vectors is None or not np.isfinite(vectors[0]).all() or not np.any(vectors[0]):
        return
    # averages of a second: noise must not add to the size, and the sensor may be turned
    blocks = max(1, len(samples) // block)
    means = np.array([vectors[i * block : (i + 1) * block].mean(axis=0) for i in range(blocks)])
    size = float(np.median(np.linalg.norm(means, axis=1)))
    if abs(size / STANDARD_GRAVITY - 1.0) <= _GRAVITY:
        return
    in_g = abs(size - 1.0) <= _GRAVITY
    absent = size < _GRAVITY * STANDARD_GRAVITY and not in_g
    name = LINEAR_ACCELERATION.name
    yield Finding(
        'info' if absent else 'severe' if in_g else 'warning',
        'gravity',
        f'The mean {name} is {number(size, 3)} m/s², '
        + (
            'which is one g: the values look like g, not m/s².'
            if in_g
            else 'gravity is not in it.'
            if absent
            else f'gravity is {STANDARD_GRAVITY} m/s².'
        ),
        'None on noise if gravity was removed on purpose.'
        if absent
        else 'Every acceleration result scales with it.',
        'Check the unit and the scale factor of the driver or of --units.',
    )


def _names(names: list[str]) -> str:
    """
    Return axis names in short.

    Examples
    --------
    >>> _names(['linear_acceleration.x', 'linear_acceleration.y', 'angular_velocity.z'])
    'linear_acceleration.x, y and angular_velocity.z'
    """
    grouped: dict[str, list[str]] = {}
    for name in names:
        quantity, _, letter = name.rpartition('.')
        grouped.setdefault(quantity, []).append(letter)
    return ' and '.join(
        f'{quantity}.{", ".join(letters)}' for quantity, letters in grouped.items()
    )
