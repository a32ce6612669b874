# SPDX-License-Identifier: Apache-2.0
"""What an analysis of a simulated axis has to find: the noise that went in, and the rounding."""

from __future__ import annotations

import math

from imu_bench.simulation.low_pass import NOISE_FILTERS
from imu_bench.simulation.noise import white_sigma
from imu_bench.simulation.sensor_errors import Errors
import numpy as np
from scipy.signal import sosfilt
from scipy.special import ndtr

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
