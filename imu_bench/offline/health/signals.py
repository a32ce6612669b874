# SPDX-License-Identifier: Apache-2.0
"""Findings about the numbers themselves: constant, stuck, saturated, coarse, spikes, scale."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import math
from typing import NamedTuple

from imu_bench.metrology.spikes import bent, EQUAL, FAR, standing_alone, standing_out
from imu_bench.offline.analysis.axes import Axis
from imu_bench.offline.health import runs
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.health.motion import Motion
from imu_bench.offline.health.runs import AxisFacts
from imu_bench.offline.notation import count, duration, number, percent
from imu_bench.samples import Samples
from imu_bench.units import STANDARD_GRAVITY
from msg_conversions.quantities import LINEAR_ACCELERATION
import numpy as np
import numpy.typing as npt

_STUCK_SEVERE = 0.05  # share of the recording: σ comes out 2.5 % too low
# samples at the extreme; times as many as at a value next to it: 1 of 5460 ends of rounded
# Gaussian records (10³ to 10⁵ samples, steps of 0.03 σ to 0.6 σ) was taken for saturated
_SATURATED, _PILE = 5, 3
_LEVELS = 16  # fewer levels make piling up at the extreme normal
_REPEATED, _REPEATED_SEVERE = 0.01, 0.2  # share of whole samples that repeat, beyond chance
_CUT_SEVERE = 1e-3  # share of samples at the end of the range: those beyond 3.3 σ of noise
_FEW_SPIKES = 0.01  # share of samples; replacing them changes N by half of it at most
_ROUNDED = 0.5  # steps by which rounding can move the median that the noise is taken from
_COARSE = 0.5  # steps; rounding adds a twelfth of a squared step to the variance
_GRAVITY = 0.15  # relative: scale and offset of consumer parts, ±3 % and ±80 mg of an MPU-9250
# relative; no part at rest is as far off as its ±3 % ±80 mg, twice; on the move averages of a
# second differ from gravity, but not by all of it
_WRONG_SCALE, _WRONG_ON_THE_MOVE = 0.2, 1.0
_SHOWN = 3  # impossible values of an axis that are spelled out
_SCALE = 0.02  # relative: a sensor as good as its typical data sheet is within it
# m/s² and rad/s: a shock sensor of 200 000 g, and 57 000 °/s, twice what any gyroscope measures
_IMPOSSIBLE = {'linear_acceleration': 2e6, 'angular_velocity': 1e3}


class Spikes(NamedTuple):
    """Positions of samples far off their neighbours, and of those alone or in short bursts."""

    positions: npt.NDArray[np.int64]
    single: npt.NDArray[np.int64]


def constant(facts: Mapping[str, AxisFacts]) -> Iterator[Finding]:
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
    facts: Mapping[str, AxisFacts], signals: Sequence[Axis], when: Callable[[int], float]
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


def repeated(samples: Samples, facts: Mapping[str, AxisFacts]) -> Iterator[Finding]:
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


def saturated(facts: Mapping[str, AxisFacts], signals: Sequence[Axis]) -> Iterator[Finding]:
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


def is_coarse(fact: AxisFacts) -> bool:
    """Return whether the noise of an axis that is not constant is below its resolution."""
    step = fact.resolution
    if step is None or fact.lowest == fact.highest:
        return False
    # neighbours behind a low-pass differ by less than the noise
    return fact.noise < _COARSE * step and fact.scatter < math.sqrt(_COARSE**2 + 1 / 12) * step


def coarse(facts: Mapping[str, AxisFacts], signals: Sequence[Axis]) -> Iterator[Finding]:
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
    facts: Mapping[str, AxisFacts], signals: Sequence[Axis], motion: Motion
) -> dict[str, Spikes]:
    """Return the single samples of each axis far off their neighbours, outside of motion."""
    found = {}
    for axis in signals:
        fact = facts[axis.name]
        # where many neighbours are equal, of repeated or coarse samples, they tell no noise
        noise = max(fact.noise, fact.scatter) if fact.repeated > EQUAL else fact.noise
        limit = FAR * (noise + _ROUNDED * (fact.resolution or 0.0))
        if limit <= 0.0 or motion.share == 1.0:
            continue
        tried = bent(axis.values, 0.5 * limit)
        positions = standing_out(axis.values, tried, limit)
        single = standing_alone(axis.values, tried, limit)
        single = single[~motion.at(single)]
        # a burst also bends the lines of its neighbours
        told = np.isin(positions, (single[:, None] + np.arange(-2, 3)).ravel())
        positions = np.union1d(positions[~told & ~motion.at(positions)], single)
        if positions.size:
            few = single.size <= _FEW_SPIKES * axis.values.size
            found[axis.name] = Spikes(positions, single if few else single[:0])
    return found


def spike_findings(found: Mapping[str, Spikes], when: Callable[[int], float]) -> Iterator[Finding]:
    """Yield what the spikes are and which of them the noise figures do without."""
    if not found:
        return
    total = sum(spikes.positions.size for spikes in found.values())
    masked = sum(spikes.single.size for spikes in found.values())
    first = min(int(spikes.positions[0]) for spikes in found.values())
    whole = 'all' if masked == total else f'{masked}' if masked else 'none'
    yield Finding(
        'warning',
        'outliers',
        f'{count(total, "outlier")} beyond {FAR:g} σ in {_names(list(found))}, the first at '
        f't = {duration(when(first))}.',
        f'Each one raises σ and peak values. Allan deviation, spectrum, N, B and K are without '
        f'{whole} of them: the median of its neighbours stands for a single sample.'
        if masked
        else 'They raise σ, peak values and the deviation at short averaging times: they are no '
        f'single samples, or more than {percent(_FEW_SPIKES)}, and N, B and K hold them.',
        'Look for transfer errors on the bus; touch nothing near the sensor during the test.',
    )


def impossible(
    facts: Mapping[str, AxisFacts], signals: Sequence[Axis], when: Callable[[int], float]
) -> Iterator[Finding]:
    """Yield values that no sensor measures, with time and value."""
    found, total = [], 0
    for axis in signals:
        fact, limit = facts[axis.name], _IMPOSSIBLE[axis.quantity.name]
        if max(-fact.lowest, fact.highest) <= limit:
            continue
        over = np.flatnonzero(np.abs(axis.values) > limit)
        total += over.size
        named = [
            f'{number(float(axis.values[at]), 5)} {axis.unit} at t = {duration(when(at))}'
            for at in over[:_SHOWN].tolist()
        ]
        more = f' and {over.size - _SHOWN} more' if over.size > _SHOWN else ''
        found.append(f'{axis.name} {", ".join(named)}{more}')
    if found:
        yield Finding(
            'severe',
            'impossible',
            f'{count(total, "value")} that no sensor measures: {"; ".join(found)}.',
            'Mean, σ and every noise figure of these axes describe them, not the sensor.',
            'Check the unit and the driver; cut the recording before or after (--start, --end).',
        )


def gravity(samples: Samples, block: int, *, moved: bool = False) -> Iterator[Finding]:
    """Yield an acceleration whose size is not that of gravity: units or scale are wrong."""
    vectors = samples.acceleration
    if vectors is None or not np.isfinite(vectors[0]).all() or not np.any(vectors[0]):
        return
    # averages of a second: noise must not add to the size, and the sensor may be turned
    blocks = max(1, len(samples) // block)
    means = np.array([vectors[i * block : (i + 1) * block].mean(axis=0) for i in range(blocks)])
    size = float(np.median(np.linalg.norm(means, axis=1)))
    off = size / STANDARD_GRAVITY - 1.0
    if abs(off) <= _SCALE or (moved and abs(off) <= _GRAVITY):
        return
    if abs(off) <= _GRAVITY:
        yield Finding(
            'info',
            'gravity_scale',
            f'At rest the acceleration is {number(size, 4)} m/s², {percent(abs(off))} '
            f'{"above" if off > 0 else "below"} gravity.',
            'Bias or scale are off by that: noise of the accelerometer may scale with it.',
            'Calibrate it: imu-bench analyze --plan six-position.',
        )
        return
    in_g = abs(size - 1.0) <= _GRAVITY
    absent = size < _GRAVITY * STANDARD_GRAVITY and not in_g
    wrong = in_g or abs(off) > (_WRONG_ON_THE_MOVE if moved else _WRONG_SCALE)
    name = LINEAR_ACCELERATION.name
    yield Finding(
        'info' if absent else 'severe' if wrong else 'warning',
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
    """Return axis names in short."""
    grouped: dict[str, list[str]] = {}
    for name in names:
        quantity, _, letter = name.rpartition('.')
        grouped.setdefault(quantity, []).append(letter)
    return ' and '.join(
        f'{quantity}.{", ".join(letters)}' for quantity, letters in grouped.items()
    )
