# SPDX-License-Identifier: Apache-2.0
"""One simulated sensor with all its streams, and what is true about it."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from imu_bench.config import SensorConfig, SIMULATION_SETTINGS
from imu_bench.metrology.fitting.noise_model import coefficient_unit
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.expected import expected_coefficients
from imu_bench.simulation.motion import Band
from imu_bench.simulation.sensor_errors import Errors
from msg_conversions.quantities import BY_FIELD, IMU_QUANTITIES
import numpy as np

_PREFIX = 'simulation.'


@dataclass(frozen=True, eq=False)
class SimulatedSensor:
    """A sensor of a simulated bench."""

    config: SensorConfig
    sources: tuple[SensorSource, ...]  # one for each output data rate, the main one first
    # resolution of the angles that an inclinometer computes itself, rad; None for others
    angle_step: float | None = None

    @property
    def name(self) -> str:
        """Short name of the sensor."""
        return self.config.name

    @property
    def rate_hz(self) -> float:
        """True rate of the main stream."""
        return self.sources[0].rate_hz

    def truth(self) -> dict[str, Any]:
        """Return every parameter that went in, per axis, in SI with its unit, ready for JSON."""
        axes: dict[str, Any] = {}
        for source in self.sources:
            for quantity in source.quantities:
                axes.update(_axes(source, quantity))
        return {
            'name': self.name,
            'driver': self.config.driver,
            'frame_id': self.config.frame_id,
            'settings': dict(self.config.settings),
            'axes': axes,
        }

    def remarks(self) -> list[str]:
        """Return what a user should know: frequencies above half the rate of a stream."""
        found = []
        for source in self.sources:
            half = source.rate_hz / 2.0
            if not {quantity.field for quantity in IMU_QUANTITIES} & set(source.quantities):
                continue
            found += [
                f'{self.name}: {_above(band, half)}; {_what_happens(source)}'
                for band in source.motion.bands
                if band.high_hz > half
            ]
        return found


def _above(band: Band, half_hz: float) -> str:
    span = (
        f'{band.high_hz:g} Hz'
        if band.low_hz == band.high_hz
        else f'{band.low_hz:g} to {band.high_hz:g} Hz'
    )
    return f'{band.name} at {span} goes above half its rate ({half_hz:g} Hz)'


def _what_happens(source: SensorSource) -> str:
    if source.model.corner_hz:
        return 'what its low-pass leaves of that folds back, as in the real sensor'
    return 'it has no low-pass, so all of that folds back'


def _axes(source: SensorSource, quantity: str) -> dict[str, Any]:
    """Return the truth about each axis of a quantity."""
    errors, shown_unit = source.model.errors[quantity], BY_FIELD[quantity].unit
    unit = 'K' if shown_unit == '°C' else shown_unit
    start = source.at_start()[quantity]
    made = {}
    for axis, name in enumerate(BY_FIELD[quantity].columns):
        if not errors.has(axis):
            continue
        shown = 0.0 if errors.high_pass[axis] else float(start[axis])
        coefficients = expected_coefficients(errors, axis, source.rate_hz, shown)
        made[name] = {
            'unit': shown_unit,
            'rate': _value(source.rate_hz, 'Hz'),
            'nominal_rate': _value(source.nominal_hz, 'Hz'),
            'parameters': {
                **_parameters(errors, quantity, axis),
                'turned_on_with': _value(source.model.turn_on[quantity][axis], unit),
            },
            # what an analysis has to find
            'at_start': _value(shown, shown_unit),
            'coefficients': {
                term: _value(value, coefficient_unit(unit, term))
                for term, value in coefficients.items()
            },
        }
    return made


def _parameters(errors: Errors, quantity: str, axis: int) -> dict[str, Any]:
    """Return every error that a sensor's file can set, with the unit it has there."""
    stated: dict[str, Any] = {}
    for setting in SIMULATION_SETTINGS:
        of, _, name = setting.name.removeprefix(_PREFIX).partition('.')
        name = name.partition('.')[0]
        if of != quantity or name == 'axes':
            continue
        value = getattr(errors, name)
        stated[name] = _value(value[axis], setting.unit) if np.ndim(value) else value
    return stated


def _value(number: Any, unit: str) -> dict[str, Any]:
    """Return a number, or the row of a matrix, with its unit; None for what has no limit."""
    if np.ndim(number):
        return {'value': [float(one) for one in number], 'unit': unit}
    return {'value': float(number) if math.isfinite(number) else None, 'unit': unit}
