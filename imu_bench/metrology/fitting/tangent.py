# SPDX-License-Identifier: Apache-2.0
"""The slope-tangent method: N, B and K read off three straight lines through a deviation curve."""

from __future__ import annotations

import math

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import (
    coefficient_unit,
    FLICKER_FLOOR,
    NoiseModel,
    TERMS,
)
import numpy as np

_SLOPES = {'N': (-0.5, 1.0, 1.0), 'B': (0.0, 1.0, FLICKER_FLOOR), 'K': (0.5, 3.0, 1.0)}
"""Slope of the line, averaging time in s where it is read, deviation there over coefficient."""


def tangent_fit(curve: DeviationCurve) -> NoiseModel:
    """
    Return N, B and K by the slope-tangent method, without uncertainty.

    For each slope (−1/2, 0, +1/2) the line through the point whose local slope comes nearest
    is read at τ = 1 s (N), anywhere over 0.664 (B) and at τ = 3 s (K): MATLAB example "Inertial
    Sensor Noise Analysis Using Allan Variance", and appendix 10 of the thesis that compares
    SCL3300 and IIM-42652.  It always returns three numbers, whether the noise is there or not.

    Parameters
    ----------
    curve : DeviationCurve
        At least two points with a deviation above zero.

    Returns
    -------
    NoiseModel
        Q and R are not observable: the method does not look for them.
    """
    good = curve.deviation > 0.0
    log_tau, log_deviation = np.log10(curve.tau[good]), np.log10(curve.deviation[good])
    found: dict[str, Estimate] = {}
    for term in TERMS:
        unit = coefficient_unit(curve.unit, term)
        if term not in _SLOPES or log_tau.size < 2:
            reason = (
                'the slope-tangent method does not look for it'
                if term not in _SLOPES
                else 'a slope needs two averaging times with a deviation above zero'
            )
            found[term] = Estimate.not_observable(unit, reason, method='slope tangent')
            continue
        slope, at, floor = _SLOPES[term]
        local = np.diff(log_deviation) / np.diff(log_tau)
        nearest = int(np.argmin(np.abs(local - slope)))
        intercept = log_deviation[nearest] - slope * log_tau[nearest]
        value = 10.0 ** float(intercept + slope * math.log10(at)) / floor
        found[term] = Estimate(value, None, None, unit, method='slope tangent')
    fitted = {t: e.value for t, e in found.items() if e.value is not None}
    return NoiseModel(
        curve.unit,
        found['Q'],
        found['N'],
        found['B'],
        found['K'],
        found['R'],
        fitted=fitted,
        method='slope tangent',
        tau_low=float(curve.tau[0]) if len(curve) else 0.0,
        tau_high=float(curve.tau[-1]) if len(curve) else math.inf,
    )
