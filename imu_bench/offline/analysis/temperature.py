# SPDX-License-Identifier: Apache-2.0
"""Whether the temperature of a sensor is why its bias moved."""

from __future__ import annotations

from collections.abc import Iterable

from imu_bench.counting import listed
from imu_bench.errors import DataError
from imu_bench.metrology.stamps.timing import Grid
from imu_bench.metrology.trials import thermal
from imu_bench.metrology.trials.drifting import regress
from imu_bench.offline.analysis.axes import Axis
from imu_bench.offline.notation import text
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_SURE = 0.999
"""Level at which a coefficient must not be zero: of six axes one errs in 170 recordings."""

_NAMED = 3


def said(axes: Iterable[Axis], grid: Grid, celsius: Floats, confidence: float) -> str:
    """
    Return what the temperature has to do with axes whose bias moved; empty if nobody can tell.

    Parameters
    ----------
    axes : iterable of Axis
        Those whose bias moved.
    grid : Grid
        Where their samples are.
    celsius : ndarray, shape (n,)
        The temperature at each sample.
    confidence : float
        Level of the intervals.
    """
    there = grid.keep & np.isfinite(celsius)
    when, warm = grid.index[there] * grid.period_s, celsius[there]
    if when.size < 2 or not np.ptp(warm):
        return ''
    follow = []
    for axis in axes:
        try:
            held = thermal.averages(when, axis.values[there], warm)
            off = held.temperature - held.temperature.mean()
            model = regress(held.index, np.column_stack([np.ones_like(off), off]), held.bias)
        except DataError:
            # too short, or the averages of the temperature are all equal
            return ''
        sure = model.coefficient(1, f'{axis.unit}/K', _SURE)
        if sure.low is not None and sure.high is not None and not sure.low <= 0.0 <= sure.high:
            slope = model.coefficient(1, f'{axis.unit}/K', confidence)
            follow.append(f'{axis.name} by {text(slope)}')
    span = f'the temperature, {warm.min():.1f} to {warm.max():.1f} °C'
    if not follow:
        return f'It does not follow {span}.'
    return f'It follows {span}: {listed(follow, _NAMED, "; ")}.'
