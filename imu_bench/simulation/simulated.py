# SPDX-License-Identifier: Apache-2.0
"""One simulated sensor with all its streams, what is true about it, and what has to be found."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from imu_bench.config import SensorConfig, SIMULATION_SETTINGS
from imu_bench.metrology.fitting.noise_model import coefficient_unit
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.low_pass import NOISE_FILTERS
from imu_bench.simulation.motion import Band
from imu_bench.simulation.noise import white_sigma
from imu_bench.simulation.sensor_errors import Errors
from msg_conversions.quantities import BY_FIELD, IMU_QUANTITIES
import numpy as np
from scipy.signal import sosfilt
from scipy.special import ndtr

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


HIDDEN = 0.45
"""
Sigma in steps below which the resolution hides the noise.  The mean after rounding follows the
mean before it with the slope 1 ± 2 e^(−2π²σ²) (σ in steps; the Fourier series of the rounding
error, smoothed by the noise): slow noise is scaled by up to 3.7 % here, by 34 % at 0.3 steps.
"""

_SIGMAS = 9.0
_RESPONSE = 1 << 14


def expected_coefficients(
    errors: Errors, axis: int, rate_hz: float, value: float
) -> dict[str, float]:
    """
    Return the noise coefficients of one axis as its output shows them.

    Rounding to the sensor's resolution adds white noise, as long as the noise before it
    moves the output by more than a fraction of a step; then N comes out larger than it went in.
    """
    density = float(errors.white_density[axis])
    n = density / math.sqrt(2.0)
    step = float(errors.resolution[axis])
    if step:
        sigma = white_sigma(density, 1.0 / rate_hz) * _noise_gain(errors, axis, rate_hz)
        added = rounded_variance(value, sigma, step) - sigma**2
        n = math.sqrt(max(n**2 + added / rate_hz, 0.0))
    return {
        'Q': float(errors.quantisation[axis]),
        'N': n,
        'B': float(errors.bias_instability[axis]),
        'K': float(errors.random_walk[axis]),
    }


def rounding_shows_noise(errors: Errors, axis: int, rate_hz: float) -> bool:
    """
    Return whether the noise of an axis moves its output from step to step.

    Below 0.45 steps of sigma, what comes out depends on where between two steps the axis
    stands: slow noise is magnified or vanishes (see `HIDDEN`).
    """
    step = float(errors.resolution[axis])
    density = float(errors.white_density[axis])
    sigma = white_sigma(density, 1.0 / rate_hz) * _noise_gain(errors, axis, rate_hz)
    return not step or sigma > HIDDEN * step


def rounded_variance(mean: float, sigma: float, step: float) -> float:
    """
    Return the variance of normal values after rounding to multiples of a step.

    For a sigma above half a step it is sigma² + step²/12 within 2.4 % (B. Widrow, I. Kollár 2008,
    "Quantization Noise", Cambridge University Press); this is the exact sum.
    """
    if sigma == 0.0:
        return 0.0
    reach = math.ceil(_SIGMAS * sigma / step) + 1
    codes = round(mean / step) + np.arange(-reach, reach + 1)
    shares = np.diff(ndtr((np.append(codes - 0.5, codes[-1] + 0.5) * step - mean) / sigma))
    off = codes * step - mean
    middle = float(shares @ off)
    return float(shares @ (off - middle) ** 2)


def _noise_gain(errors: Errors, axis: int, rate_hz: float) -> float:
    """Return by how much the sensor's low-pass reduces the sigma of white noise."""
    corner = float(errors.low_pass[axis])
    if math.isinf(corner):
        return 1.0
    sections = NOISE_FILTERS[errors.low_pass_kind](corner, errors.low_pass_order, rate_hz)
    impulse = np.zeros(_RESPONSE)
    impulse[0] = 1.0
    response = sosfilt(sections, impulse)
    return math.sqrt(float(response @ response))
