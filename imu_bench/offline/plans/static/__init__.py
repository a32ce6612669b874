# SPDX-License-Identifier: Apache-2.0
"""
Static comparison: the tables of Shabulinzenze 2020 (Tampere University MSc thesis), section 5.1.

Tables 5.1 (stationary data), 5.2 (noise density, rate and bandwidth), 5.4 to 5.6 (N, B, K), 5.7
(correlation time of the bias) and 5.8 (how well a Kalman filter follows it), for any sensors.
Table 5.3 is the slopes at which N, B and K are read; here all are fitted at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import math
from typing import NamedTuple

from imu_bench.config.schema import Setting
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.spectrum import density_from_sigma
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.sensors import driver_of, labels, ratio, stated_rate, typical_of
from imu_bench.offline.health import Finding
from imu_bench.offline.notation import number, short, text, unit_of
from imu_bench.offline.plans.plan import NoisePlan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Cell, Column, Table
from imu_bench.registers import Typical
from imu_bench.units import convert
from msg_conversions.quantities import IMU_QUANTITIES, Quantity

_CONSTANTS = {'linear_acceleration': 'gravity', 'angular_velocity': 'the rotation of the Earth'}
_TERMS = {
    'N': (
        'random walk N (Shabulinzenze 2020, table 5.4)',
        'White noise; slope −1/2 of the Allan deviation.',
    ),
    'B': (
        'bias instability B (Shabulinzenze 2020, table 5.5)',
        'Flicker noise; the floor is 0.664 B.',
    ),
    'K': (
        'rate random walk K (Shabulinzenze 2020, table 5.6)',
        'Slope +1/2 of the Allan deviation.',
    ),
}
_RATE_DIGITS = 7
_MEMORY = 10.0
"""Samples; what is forgotten sooner is the filter of the sensor, or a tone, and no bias."""
_DRIFTS = ('autocorrelation', 'allan_fit', 'bias_instability')


class _Sensor(NamedTuple):
    """One sensor in one quantity."""

    label: str
    result: RecordingResult
    axes: list[AxisResult]
    sheet: Typical | None


class Static(NoisePlan):
    """Sensors at rest, side by side as in the thesis."""

    name = 'static'
    title = 'Static comparison'
    document = (
        'Shabulinzenze, Comparison of MEMS sensors in machine vibration monitoring, MSc thesis, '
        'Tampere University 2020, section 5.1'
    )
    SETTINGS = (
        Setting(
            'bandwidth', None, 'Bandwidth of every sensor, instead of its datasheet.', (),
            (1e-6, 1e9), 'Hz', 'quantity',
        ),
    )  # fmt: skip

    def conclude(self, measured: Sequence[RecordingResult]) -> PlanResult:
        """Return the tables of all sensors that were at rest."""
        names = labels(measured)
        if self.reference and self.reference not in names:
            raise RecordingError(
                f'--reference {self.reference}: not among the sensors: {", ".join(names)}'
            )
        tables: list[Table] = []
        figures: list[Figure] = []
        summary: list[str] = []
        for quantity in IMU_QUANTITIES:
            sensors = [
                _Sensor(name, result, axes, typical_of(result).get(quantity.field))
                for name, result in zip(names, measured, strict=True)
                if (axes := result.of(quantity.name))
            ]
            if sensors:
                summary += _summary(quantity, sensors)
                tables += self._tables(quantity, sensors)
                figures += _figures(quantity, sensors)
        findings = tuple(
            Finding(f.severity, f.code, f'{name}: {f.text}', f.effect, f.action)
            for name, result in zip(names, measured, strict=True)
            for f in result.health.findings
            if f.severity != 'info'
        )
        values = {name: result.to_json() for name, result in zip(names, measured, strict=True)}
        return PlanResult(
            self.name, self.title, tuple(summary), tuple(tables), tuple(figures), findings, values
        )

    def _tables(self, quantity: Quantity, sensors: Sequence[_Sensor]) -> Iterator[Table]:
        title = quantity.title
        yield self._stationary(title, quantity, sensors)
        yield self._densities(title, sensors)
        for term, (words, note) in _TERMS.items():
            yield _coefficients(f'{title}: {words}', term, note, sensors)
        yield _correlation(f'{title}: drift of the bias (Shabulinzenze 2020, table 5.7)', sensors)
        words = 'the bias followed by a Kalman filter (Shabulinzenze 2020, table 5.8)'
        yield _tracking(f'{title}: {words}', sensors)

    def _stationary(self, title: str, quantity: Quantity, sensors: Sequence[_Sensor]) -> Table:
        base = self.reference or sensors[0].label
        reference = {
            axis.letter: axis.statistics['std']
            for sensor in sensors
            if sensor.label == base
            for axis in sensor.axes
        }
        axes = [axis for sensor in sensors for axis in sensor.axes]
        unit = unit_of([axis.statistics['std'] for axis in axes], 'level')
        rows: list[tuple[Cell, ...]] = []
        for sensor in sensors:
            for axis in sensor.axes:
                known = axis.statistics
                rows.append(
                    (
                        f'{sensor.label} {axis.letter}',
                        *(known.get(n) for n in ('minimum', 'maximum', 'peak_to_peak', 'std')),
                        known.get('mean'),
                        *_ratios(axis, reference),
                    )
                )
        head = ('minimum', 'maximum', 'peak to peak', 'σ', 'bias')
        columns = (
            Column('sensor, axis'), *(Column(name, unit) for name in head),
            *([Column('ratio of σ')] if reference else []),
        )  # fmt: skip
        note = f'Bias is the mean and holds {_CONSTANTS[quantity.name]}; so do the extremes.'
        if reference:
            seen = ', '.join(reference)
            note += f' Ratio against {base}, which has {seen}.'
        title += ': stationary data (Shabulinzenze 2020, table 5.1)'
        return Table(title, columns, tuple(rows), note)

    def _densities(self, title: str, sensors: Sequence[_Sensor]) -> Table:
        asked = self.settings['bandwidth']
        white = [axis.white_density for sensor in sensors for axis in sensor.axes]
        density = unit_of(white, 'density')
        level = unit_of([a.statistics['std'] for s in sensors for a in s.axes], 'level')
        rows: list[tuple[Cell, ...]] = []
        for sensor in sensors:
            sheet = sensor.sheet
            bandwidth = asked[0] if asked else sheet.bandwidth if sheet else None
            rate = sensor.result.health.rate
            if bandwidth is not None and rate.value is not None:
                bandwidth = min(bandwidth, 0.5 * rate.value)
            for position, axis in enumerate(sensor.axes):
                given = _per_axis(sheet, position)
                simple = bandwidth and density_from_sigma(axis.statistics['std'], bandwidth)
                stated = axis.white_density.unit
                rows.append(
                    (
                        f'{sensor.label} {axis.letter}',
                        None if given is None else convert(given, stated, density),
                        simple or None,
                        axis.white_density,
                        stated_rate(driver_of(sensor.result), rate.value),
                        short(rate, _RATE_DIGITS),
                        bandwidth,
                        _total(given, bandwidth, axis.unit, level),
                    )
                )
        columns = (
            Column('sensor, axis'), Column('datasheet', density), Column('σ/√bandwidth', density),
            Column('white noise', density), Column('datasheet rate', 'Hz'), Column('rate, Hz'),
            Column('bandwidth', 'Hz'), Column('datasheet noise', level),
        )  # fmt: skip
        flat = [
            f'{sensor.label} {axis.letter}'
            for sensor in sensors
            for axis in sensor.axes
            if axis.white_from_spectrum
        ]
        other = f'; of {", ".join(flat)} the plateau of the spectrum' if flat else ''
        note = (
            'σ/√bandwidth is equation 5.1 of the thesis: it counts drift as noise, and is right '
            'only where the bandwidth is the true one. White noise is one-sided, √2 N of the '
            f'fitted Allan deviation{other}. Bandwidth is that of the datasheet, at most half the '
            'rate. Datasheet noise is its density times √bandwidth, datasheet rate the one of its '
            'document that is nearest to the measured.'
        )
        title += ': noise density (Shabulinzenze 2020, table 5.2)'
        return Table(title, columns, tuple(rows), note)


def _ratios(axis: AxisResult, reference: Mapping[str, Estimate]) -> tuple[Cell, ...]:
    """Return the cell of the ratio of σ; none where the reference has nothing to compare."""
    if not reference:
        return ()
    base = reference.get(axis.letter)
    return (None if base is None else ratio(axis.statistics['std'], base),)


def _total(density: float | None, bandwidth: float | None, unit: str, shown: str) -> float | None:
    if density is None or bandwidth is None:
        return None
    return convert(density * math.sqrt(bandwidth), unit, shown)


def _per_axis(sheet: Typical | None, position: int) -> float | None:
    given = None if sheet is None else sheet.noise_density
    return given[position] if isinstance(given, tuple) else given


def _coefficients(title: str, term: str, note: str, sensors: Sequence[_Sensor]) -> Table:
    found = {s.label: {a.letter: a.coefficient(term) for a in s.axes} for s in sensors}
    unit = unit_of([e for axes in found.values() for e in axes.values()], term)
    rows = tuple((label, *(axes.get(letter) for letter in 'xyz')) for label, axes in found.items())
    blind = [s.label for s in sensors if not any(axis.shows_constants for axis in s.axes)]
    if blind:
        note += f' Not defined for {", ".join(blind)}: no constant signal is seen there.'
    return Table(title, (Column('sensor'), *(Column(x, unit) for x in 'xyz')), rows, note)


def _correlation(title: str, sensors: Sequence[_Sensor]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for sensor in sensors:
        for axis in sensor.axes:
            drift = axis.checks.drift
            models = {} if drift is None else drift.models
            shortest = _MEMORY / (sensor.result.health.rate.value or math.inf)
            slow = [n for n, model in models.items() if (model.T_c.value or 0.0) > shortest]
            name = next((n for n in _DRIFTS if n in slow), '')
            cells: tuple[Cell, ...] = (None, None, 'no drift seen')
            if name:
                time = models[name].T_c
                # without an interval it was not measured, and has no five digits
                shown = short(time, 2) if time.low is None else time
                cells = (shown, models[name].sigma, name.replace('_', ' '))
            rows.append((f'{sensor.label} {axis.letter}', *cells))
    sigmas = [row[2] for row in rows if isinstance(row[2], Estimate)]
    unit = unit_of(sigmas, 'level') if sigmas else ''
    columns = (
        Column('sensor, axis'), Column('T_c', 's'), Column('σ', unit), Column('found by', ''),
    )  # fmt: skip
    note = (
        'First-order Gauss-Markov process: the autocorrelation falls to σ²/e after T_c. '
        'A memory of ten samples or less is that of a filter, and left out. Found by bias '
        'instability is a stand-in: the process that touches the floor of B in its middle.'
    )
    return Table(title, columns, tuple(rows), note)


def _tracking(title: str, sensors: Sequence[_Sensor]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for sensor in sensors:
        for axis in sensor.axes:
            drift = axis.checks.drift
            tracked = None if drift is None else drift.tracking
            cells: tuple[Cell, ...] = (None, 'no bias to track')
            if tracked is not None:
                cells = (tracked.rmse, 'white' if tracked.white else 'not white')
            rows.append((f'{sensor.label} {axis.letter}', *cells))
    errors = [row[1] for row in rows if isinstance(row[1], Estimate)]
    columns = (
        Column('sensor, axis'),
        Column('RMSE', unit_of(errors, 'level') if errors else ''),
        Column('innovations'),
    )
    note = (
        'RMSE of the tracked bias against the smoothed measurement. Innovations that are not '
        'white hold something that the model does not.'
    )
    return Table(title, columns, tuple(rows), note)


def _summary(quantity: Quantity, sensors: Sequence[_Sensor]) -> Iterator[str]:
    ranked = sorted(
        (value, sensor.label, axis)
        for sensor in sensors
        for axis in sensor.axes
        if (value := axis.white_density.value) is not None
    )
    if not ranked:
        yield f'{quantity.title}: no axis shows white noise.'
        return
    best, worst = ranked[0], ranked[-1]
    unit = unit_of([best[2].white_density], 'density')
    line = (
        f'{quantity.title}: {best[1]} {best[2].letter} has the least white noise, '
        f'{text(best[2].white_density, unit)}'
    )
    if best is not worst and _apart(best[2].white_density, worst[2].white_density):
        ratio = number(worst[0] / best[0], 3)
        line += f'; {worst[1]} {worst[2].letter} the most, {ratio} times as much'
    elif best is not worst:
        line += '; no axis is told apart from it'
    yield f'{line}.'


def _apart(least: Estimate, most: Estimate) -> bool:
    """Return whether the intervals of two numbers have nothing in common."""
    return least.high is None or most.low is None or least.high < most.low


def _figures(quantity: Quantity, sensors: Sequence[_Sensor]) -> Iterator[Figure]:
    title = quantity.title
    # as in the table of stationary data
    unit = unit_of([axis.statistics['std'] for s in sensors for axis in s.axes], 'level')
    for letter in 'xyz':
        axes = [(s.label, axis) for s in sensors for axis in s.axes if axis.letter == letter]
        if curves := tuple(filter(None, (_allan(*each, unit) for each in axes))):
            yield Figure(
                f'{title} {letter}: Allan deviation (Shabulinzenze 2020, figure 5.2)',
                'averaging time τ in s', f'Allan deviation in {unit}', curves,
                log_x=True, log_y=True,
            )  # fmt: skip
        if decays := tuple(filter(None, (_decay(*each) for each in axes))):
            yield Figure(
                f'{title} {letter}: autocorrelation (Shabulinzenze 2020, figure 5.4)',
                'lag in s', 'share of that at lag 0', decays,
            )  # fmt: skip


def _allan(label: str, axis: AxisResult, unit: str) -> Series | None:
    curve = axis.allan
    if curve is None or not (seen := curve.deviation > 0.0).any():
        return None
    factor = convert(1.0, axis.unit, unit)
    band = (factor * curve.low[seen], factor * curve.high[seen])
    return Series(label, curve.tau[seen], factor * curve.deviation[seen], *band)


def _decay(label: str, axis: AxisResult) -> Series | None:
    """Return the autocorrelation of averages, in which most of the white noise is gone."""
    drift = axis.checks.drift
    found = drift.correlation if drift else None
    return None if found is None else Series(label, found.lag, found.value)
