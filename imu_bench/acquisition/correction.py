# SPDX-License-Identifier: Apache-2.0
"""Calibration applied to what a sensor has measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from imu_bench.config.calibration import Affine
from imu_bench.samples import Samples
import numpy as np

Correct = Callable[[Samples], Samples]


def correction(calibration: Mapping[str, Affine]) -> Correct | None:
    """
    Return what corrects a run of samples; None if there is nothing to correct.

    An axis that the sensor does not have stays NaN, and adds nothing to the others.

    Examples
    --------
    >>> twice = Affine((0.1, 0.0, 0.0), ((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    >>> correct = correction({'acceleration': twice})
    >>> correct(Samples(stamps=[0], acceleration=[[1.1, 0.0, 9.8]])).acceleration.tolist()
    [[2.0, 0.0, 9.8]]
    """
    if not calibration:
        return None
    parts = {
        name: (np.array(affine.matrix, np.float64), np.array(affine.bias, np.float64))
        for name, affine in calibration.items()
    }

    def correct(run: Samples) -> Samples:
        changed: dict[str, Any] = {}
        for name, (matrix, bias) in parts.items():
            raw = getattr(run, name)
            if raw is not None:
                absent = np.isnan(raw)
                off = np.where(absent, 0.0, raw - bias)
                changed[name] = np.where(absent, np.nan, off @ matrix.T)
        return replace(run, **changed) if changed else run

    return correct
