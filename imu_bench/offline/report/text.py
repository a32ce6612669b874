# SPDX-License-Identifier: Apache-2.0
"""The words and table cells of the report; plain strings, escaped by the template."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import TERM_NAMES
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.comparison import Comparison, Standing
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
    value_text,
)
from imu_bench.offline.results import Analysis, RecordingResult
from imu_bench.samples import IMU_QUANTITIES

SENSOR_NAMES = {'linear_acceleration': 'accelerometer', 'angular_velocity': 'gyroscope'}
NO_CONSTANTS = (
    'shows no constant signal (its spectrum falls off towards low frequencies), so that bias '
    'instability and random walk mean nothing'
)
SIGNAL_NAMES = {'linear_acceleration': 'Acceleration', 'angular_velocity': 'Angular velocity'}


class Cell(NamedTuple):
    """One number in a table: in the unit of the column, in SI, and what there is to say."""

    shown: str
    si: str
    note: str
    observable: bool


class Column(NamedTuple):
    """A column of a table: title and unit, and one cell per axis."""

    title: str
    unit: str
    cells: list[Cell]


def sensor_words(recording: RecordingResult) -> list[str]:
    """Return what one recording says, a sentence per quantity."""
    lines = []
    for quantity in IMU_QUANTITIES:
        axes = recording.of(quantity.name)
        if axes:
            slow = (
                _term_words(axes) if any(axis.shows_constants for axis in axes) else [NO_CONSTANTS]
            )
            parts = [_density_words(axes), *slow]
            lines.append(f'{SENSOR_NAMES[quantity.name].capitalize()}: {"; ".join(parts)}.')
    return lines


def _density_words(axes: Sequence[AxisResult]) -> str:
    seen = [axis for axis in axes if axis.white_density.value is not None]
    if not seen:
        return 'no white noise was found'
    unit = readable_unit(
        seen[0].white_density.unit, 'density', [axis.white_density.value for axis in seen]
    )
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
            unit = readable_unit(observed[0][0].unit, term, [e.value for e, _ in observed])
            worst, letter = max(observed, key=lambda row: row[0].value or 0.0)
            words.append(f'{name} up to {short(worst.to(unit), 2)} {unit} ({letter})')
        elif any(e.high is not None for e, _ in seen):
            unit = readable_unit(seen[0][0].unit, term, [e.high for e, _ in seen])
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
        ('Jitter of intervals', _in_time_unit(health.jitter)),
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


def _in_time_unit(estimate: Estimate) -> str:
    if estimate.value is None:
        return value_text(estimate)
    if estimate.value < 1e-9:
        return 'below 1 ns'  # what stamps can tell
    for unit, limit in (('s', 1.0), ('ms', 1e-3), ('µs', 1e-6)):
        if estimate.value >= limit:
            return text(estimate, unit)
    return text(estimate, 'ns')


def cell(estimate: Estimate, unit: str) -> Cell:
    """Return one number of a table."""
    note = '' if estimate.observable else estimate.reason
    blank = estimate.unit == unit or (estimate.value is None and estimate.high is None)
    si = '' if blank else text(estimate)
    return Cell(value_text(estimate.to(unit)), si, note, estimate.observable)


def coefficient_columns(axes: Sequence[AxisResult]) -> list[Column]:
    """Return the noise table of one quantity: density and coefficients."""
    columns = [
        column('Noise density', 'density', [axis.white_density for axis in axes]),
    ]
    for term in 'NBKQR':
        estimates = [axis.coefficient(term) for axis in axes]
        if term in 'NBK' or any(e.observable for e in estimates):
            columns.append(column(f'{term}, {TERM_NAMES[term]}', term, estimates))
    return columns


_PARTIAL = (
    'averages count from {:g} % of their samples on (--min-share); white noise comes out too high '
    'by half of the share that is missing'
)


def fit_remarks(axes: Sequence[AxisResult]) -> list[str]:
    """Return why terms have no value, and what the fits want to be known."""
    said: dict[str, list[str]] = {}
    for axis in axes:
        if axis.allan and axis.allan.min_share < 1.0:
            said.setdefault(_PARTIAL.format(100.0 * axis.allan.min_share), []).append(axis.letter)
        if not axis.shows_constants:
            said.setdefault(NO_CONSTANTS, []).append(axis.letter)
            continue
        for flag in axis.model.flags:
            said.setdefault(flag, []).append(axis.letter)
        for term in 'NBK':
            estimate = getattr(axis.model, term)
            if not estimate.observable:
                said.setdefault(f'{term}: {estimate.reason}', []).append(axis.letter)
    return [f'{", ".join(letters)} – {remark}.' for remark, letters in said.items()]


def statistic_columns(axes: Sequence[AxisResult], health: Health) -> list[Column]:
    """Return the table of plain statistics of one quantity."""
    columns = [
        column(title, 'level', [axis.statistics[name] for axis in axes])
        for title, name in (
            ('Mean', 'mean'),
            ('σ', 'std'),
            ('RMS, bias removed', 'rms'),
            ('Peak to peak', 'peak_to_peak'),
        )
        if all(name in axis.statistics for axis in axes)
    ]
    steps = [health.resolution.get(axis.name) for axis in axes]
    if all(step is not None for step in steps):
        columns.append(column('Resolution', 'level', [s for s in steps if s is not None]))
    return columns


_METHODS = {
    'allan': 'Allan deviation, √2 N',
    'plateau': 'Plateau of the spectrum',
    'sigma': 'σ over √(half the rate)',
}


def method_columns(axes: Sequence[AxisResult]) -> list[Column]:
    """Return the noise density as found in different ways."""
    lost = Estimate.not_observable(axes[0].noise_density.unit, 'not computed')
    return [
        column(title, 'density', [axis.noise_density_methods.get(name, lost) for axis in axes])
        for name, title in _METHODS.items()
        if any(name in axis.noise_density_methods for axis in axes)
    ]


def method_verdicts(axes: Sequence[AxisResult]) -> list[str]:
    """Return why the ways to the noise density disagree, where they do."""
    said: dict[str, list[str]] = {}
    for axis in axes:
        found = axis.densities
        if found is not None and not found.agree:
            said.setdefault(found.verdict, []).append(axis.letter)
    return [f'{", ".join(letters)}: {verdict}.' for verdict, letters in said.items()]


def column(title: str, role: str, estimates: Sequence[Estimate]) -> Column:
    """Return one column of estimates in the unit that suits them."""
    sizes = [e.value if e.value is not None else e.high for e in estimates]
    unit = readable_unit(estimates[0].unit, role, sizes)
    return Column(title, unit, [cell(estimate, unit) for estimate in estimates])


class Numbers(NamedTuple):
    """The same quantity of all axes of a sensor, and the widest of their intervals."""

    shown: str
    spread: str


def numbers(estimates: Sequence[Estimate], unit: str, digits: int = 3) -> Numbers:
    """
    Return numbers side by side.

    Examples
    --------
    >>> numbers([Estimate(2.0, 1.9, 2.1, 'mg'), Estimate(1.0, 0.9, 1.1, 'mg')], 'mg', 2)
    Numbers(shown='2.0 / 1.0', spread='± 10 %')
    """
    halves = [
        0.5 * (e.high - e.low) / abs(e.value)
        for e in estimates
        if e.value and e.low is not None and e.high is not None
    ]
    shown = ' / '.join(short(e.to(unit), digits) for e in estimates)
    return Numbers(shown, f'± {number(100.0 * max(halves), 2)} %' if any(halves) else '')


class Row(NamedTuple):
    """One sensor in the comparison table."""

    label: str
    rate: str
    density: Numbers
    ratio: str
    bias: Numbers
    walk: Numbers
    severity: str


class Ranking(NamedTuple):
    """The comparison table of one quantity with the units of its columns."""

    title: str
    density_unit: str
    bias_unit: str
    walk_unit: str
    rows: list[Row]


def rankings(analysis: Analysis, comparison: Comparison) -> list[Ranking]:
    """Return the comparison tables, the quietest sensor first."""
    return [
        _ranking(quantity, rows, analysis.recordings)
        for quantity, rows in comparison.standings.items()
    ]


def _ranking(
    quantity: str, rows: Sequence[Standing], recordings: Sequence[RecordingResult]
) -> Ranking:
    axes = [recordings[row.index].of(quantity) for row in rows]
    flat = [axis for group in axes for axis in group]

    def unit_of(role: str, estimates: Sequence[Estimate]) -> str:
        sizes = [e.value if e.value is not None else e.high for e in estimates]
        return readable_unit(estimates[0].unit, role, sizes)

    density = unit_of('density', [axis.white_density for axis in flat])
    slow = [axis for axis in flat if axis.shows_constants] or flat
    bias = unit_of('B', [axis.model.B for axis in slow])
    walk = unit_of('K', [axis.model.K for axis in slow])
    return Ranking(
        SENSOR_NAMES[quantity].capitalize(),
        density,
        bias,
        walk,
        [
            Row(
                row.label,
                short(recordings[row.index].rate_of(quantity), 4),
                numbers([axis.white_density for axis in group], density),
                '1' if row.ratio.low == row.ratio.high == 1.0 else value_text(row.ratio),
                _slow([axis.model.B for axis in group], bias, group),
                _slow([axis.model.K for axis in group], walk, group),
                recordings[row.index].health.severity,
            )
            for row, group in zip(rows, axes, strict=True)
        ],
    )


def _slow(estimates: Sequence[Estimate], unit: str, axes: Sequence[AxisResult]) -> Numbers:
    """Return coefficients of slow noise; a high-pass has none, and its bounds would impress."""
    if any(axis.shows_constants for axis in axes):
        return numbers(estimates, unit, 2)
    return Numbers('–', 'no constant signal')
