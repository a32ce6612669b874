# SPDX-License-Identifier: Apache-2.0
"""Tables and figures of the thermal plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from imu_bench.metrology.trials.thermal import Thermal
from imu_bench.offline.plans.thermal.measuring import Heated
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Cell, Column, Table
from imu_bench.units import convert
from msg_conversions.quantities import IMU_QUANTITIES, Quantity
import numpy as np

Named = Sequence[tuple[str, Heated]]


class _Units(NamedTuple):
    """Units in which a quantity is shown."""

    title: str
    level: str
    coefficient: str


_SHOWN = {
    'linear_acceleration': _Units('Acceleration', 'mg', 'mg/K'),
    'angular_velocity': _Units('Angular velocity', 'm°/s', 'm°/s/K'),
}

_COEFFICIENT_NOTE = (
    'Slope of the bias over the temperature of the sensor; its interval knows white noise, '
    'flicker noise and a random walk of the bias. Curvature is the sagitta of a parabola over '
    'the whole range. Hysteresis is cooling minus heating at the middle temperature. Of an axis '
    'along gravity the scale factor is in it: per 1 g, 0.001 %/K looks like 0.01 mg/K.'
)
_DRIFT_NOTE = (
    'Mean of the last 2 % of the time less that of the first, the straight line between the end '
    'points of figure 19; “heated” ends before the cooling. Warm-up is the change before heating.'
)


def tables(sensors: Named) -> Iterator[Table]:
    """Yield the tables of all sensors."""
    for quantity in IMU_QUANTITIES:
        found = list(_axes(sensors, quantity))
        if found:
            units = _SHOWN[quantity.name]
            yield _coefficients(found, units)
            yield _drift(found, units)
    yield _temperatures(sensors)


def _axes(sensors: Named, quantity: Quantity) -> Iterator[tuple[str, Heated, str, Thermal]]:
    for name, heated in sensors:
        for axis, found in heated.axes.items():
            if axis.startswith(f'{quantity.name}.'):
                yield f'{name} {axis[-1]}', heated, axis, found


def _coefficients(found: Sequence[tuple[str, Heated, str, Thermal]], units: _Units) -> Table:
    columns = (
        Column('sensor, axis'), Column('coefficient', units.coefficient),
        Column('bias at', '°C'), Column('bias', units.level), Column('curvature', units.level),
        Column('hysteresis', units.level),
    )  # fmt: skip
    rows = tuple(
        (label, own.coefficient, round(own.reference, 1), own.at_reference, own.curvature,
         own.hysteresis)
        for label, _, _, own in found
    )  # fmt: skip
    return Table(f'{units.title}: bias against temperature', columns, rows, _COEFFICIENT_NOTE)


def _drift(found: Sequence[tuple[str, Heated, str, Thermal]], units: _Units) -> Table:
    columns = (
        Column('sensor, axis'), Column('warm-up', units.level),
        Column('start to heated', units.level), Column('per kelvin', units.coefficient),
        Column('start to end', units.level),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (label, own.warm_up, own.change_hot, heated.per_kelvin(axis), own.change)
        for label, heated, axis, own in found
    ]
    title = f'{units.title}: drift between end points (mast thesis, figure 19)'
    return Table(title, columns, tuple(rows), _DRIFT_NOTE)


def _temperatures(sensors: Named) -> Table:
    columns = (
        Column('sensor'), Column('lowest', '°C'), Column('highest', '°C'),
        Column('self-heating', 'K'), Column('its time constant', 's'),
        Column('heating begins', 's'), Column('thermometer'),
    )  # fmt: skip
    rows = tuple(
        (name, round(heated.lowest, 2), round(heated.highest, 2), heated.warm_up.rise,
         heated.warm_up.time_constant, round(heated.phases.heating), heated.thermometer)
        for name, heated in sensors
    )  # fmt: skip
    note = 'Temperatures are those of the sensors themselves, whose own offset may be kelvins.'
    return Table('Temperatures', columns, rows, note)


def figures(sensors: Named) -> Iterator[Figure]:
    """Yield bias over temperature and time, what temperature leaves over, and the temperature."""
    for name, heated in sensors:
        for quantity in IMU_QUANTITIES:
            found = {a[-1]: t for a, t in heated.axes.items() if a.startswith(quantity.name)}
            if found:
                yield _over_temperature(name, heated, found, quantity)
                yield _left_over(name, found, quantity)
    for quantity in IMU_QUANTITIES:
        axes = list(_axes(sensors, quantity))
        if any(own.branches for _, _, _, own in axes):
            yield _hysteresis(axes, quantity)
        if axes:
            yield _over_time(axes, quantity)
    yield Figure(
        'Temperature', 'time in min', 'temperature in °C',
        tuple(Series(name, *_temperature(heated)) for name, heated in sensors),
    )  # fmt: skip


def _temperature(heated: Heated) -> tuple[np.ndarray, np.ndarray]:
    held = next(iter(heated.axes.values())).averages
    return held.time / 60.0, held.temperature


def _changed(found: Thermal, quantity: Quantity) -> np.ndarray:
    """Return the change of a bias from the coldest time, in the unit shown."""
    held = found.averages
    cold = held.bias[held.temperature <= np.quantile(held.temperature, 0.05)].mean()
    factor = convert(1.0, quantity.unit, _SHOWN[quantity.name].level)
    return np.asarray((held.bias - cold) * factor, np.float64)


def _over_temperature(
    name: str, heated: Heated, found: dict[str, Thermal], quantity: Quantity
) -> Figure:
    units, phases = _SHOWN[quantity.name], heated.phases
    series = []
    for letter, own in found.items():
        change, held = _changed(own, quantity), own.averages
        up = held.time <= phases.hot
        series.append(Series(f'{letter} heating', held.temperature[up], change[up]))
        if phases.cooled:
            down = held.time >= phases.cooling
            series.append(
                Series(f'{letter} cooling', held.temperature[down], change[down], dash='dashed')
            )
    return Figure(
        f'{name}: change of {quantity.name.replace("_", " ")} with temperature '
        '(mast thesis, figure 18)',
        'temperature in °C', f'change in {units.level}', tuple(series),
    )  # fmt: skip


def _left_over(name: str, found: dict[str, Thermal], quantity: Quantity) -> Figure:
    units = _SHOWN[quantity.name]
    factor = convert(1.0, quantity.unit, units.level)
    series = []
    for letter, own in found.items():
        held = own.averages
        line = (own.at_reference.value or 0.0) + (own.coefficient.value or 0.0) * (
            held.temperature - own.reference
        )
        series.append(Series(letter, held.time / 60.0, (held.bias - line) * factor))
    return Figure(
        f'{name}: {quantity.name.replace("_", " ")}, what a straight line leaves over',
        'time in min', f'residual in {units.level}', tuple(series),
    )  # fmt: skip


def _over_time(axes: Sequence[tuple[str, Heated, str, Thermal]], quantity: Quantity) -> Figure:
    units = _SHOWN[quantity.name]
    series = tuple(
        Series(label, own.averages.time / 60.0, _changed(own, quantity))
        for label, _, _, own in axes
    )
    return Figure(
        f'{units.title}: change over time (mast thesis, figure 18)', 'time in min',
        f'change in {units.level}', series,
    )  # fmt: skip


def _hysteresis(axes: Sequence[tuple[str, Heated, str, Thermal]], quantity: Quantity) -> Figure:
    units = _SHOWN[quantity.name]
    series = []
    for label, _, _, own in axes:
        if own.branches:
            shown = [apart.to(units.level) for _, apart in own.branches]
            series.append(
                Series(
                    label,
                    np.array([celsius for celsius, _ in own.branches]),
                    np.array([e.value for e in shown], float),
                    np.array([e.low for e in shown], float),
                    np.array([e.high for e in shown], float),
                    kind='points',
                )
            )
    return Figure(
        f'{units.title}: cooling minus heating', 'temperature in °C',
        f'difference in {units.level}', tuple(series),
    )  # fmt: skip


def coefficient_unit(axis: str) -> str:
    """Return the unit in which the coefficient of an axis is read."""
    return _SHOWN[axis.partition('.')[0]].coefficient


def level_unit(axis: str) -> str:
    """Return the unit in which the bias of an axis is read."""
    return _SHOWN[axis.partition('.')[0]].level
