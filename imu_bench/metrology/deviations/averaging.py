# SPDX-License-Identifier: Apache-2.0
"""Which averaging times a deviation is computed at, and on which points of a long phase."""

from __future__ import annotations

from collections.abc import Sequence
import math

from imu_bench.errors import DataError
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Taus = str | Sequence[float] | Floats

PER_DECADE = 9
"""Averaging times per decade of the grid 'log'."""

BASE = 3
"""
Decimation goes by powers of this.  It is odd so that a tone locked to the sample clock, with
a period of 2, 4 or 8 samples, is not met at the same phase every time.
"""

LEAST_OVERLAP = 12
"""
Starting points per averaging time that decimation leaves at least.  The variance of the
overlapped Allan variance of white noise is then 0.87 % above its limit (0.03 % for flicker
noise), by equation (10) of Greenhall and Riley (2003).
"""

_NEAR = 395.0
"""
Starting points per averaging time, over sqrt(m/n), that keep the decimated deviation within
0.2 % (standard deviation) of full overlap.  The two differ by 0.65 sqrt(m/n) / overlap for
white noise in a long record, less for every redder one, by the same equation; 0.79 is allowed
for, because ends cost more where m is not small against n (0.76 simulated at m = n/14).
"""

_REACH = {
    'adev': 3, 'oadev': 3, 'mdev': 4, 'tdev': 4, 'hdev': 4, 'ohdev': 4, 'totdev': 2,
}  # fmt: skip
"""The named grids end at n / reach."""


def averaging_factors(
    n: int,
    tau: Taus = 'log',
    rate_hz: float = 1.0,
    kind: str = 'oadev',
    per_decade: int = PER_DECADE,
) -> Integers:
    """
    Return averaging factors for n samples of the rate.

    Parameters
    ----------
    n : int
        Samples.
    tau : str or sequence of float
        'log' (evenly spaced logarithms), 'octave' (1, 2, 4, 8, ...), 'decade' (1, 2, 4, 10,
        20, 40, ...) or 'all', each up to n/3 (n/4 for three windows, n/2 for 'totdev');
        or averaging times in s, taken to the nearest multiple of the sample period.
    rate_hz : float
        Sample rate; matters for averaging times in s only.
    kind : str
        Member of the family.
    per_decade : int
        Density of 'log'.  From m = 36 on that grid takes multiples of powers of three, at
        most 4 % away, so that `overlap='decimated'` can go with them.
    """
    if not isinstance(tau, str):
        return _from_seconds(tau, rate_hz)
    top = n // _REACH.get(kind, 3)
    if tau == 'log':
        if per_decade < 1:
            raise DataError(f'per_decade must be at least 1, got {per_decade}')
        steps = np.arange(math.ceil(per_decade * math.log10(max(top, 1))) + 1)
        factors = _smooth(10.0 ** (steps / per_decade))
    elif tau == 'octave':
        factors = 2 ** np.arange(max(top, 1).bit_length())
    elif tau == 'decade':
        factors = np.outer(10 ** np.arange(len(str(top))), [1, 2, 4]).ravel()
    elif tau == 'all':
        factors = np.arange(1, top + 1)
    else:
        raise DataError(
            f"unknown tau {tau!r}; use 'log', 'octave', 'decade', 'all' or a list of seconds"
        )
    return np.asarray(factors[factors <= top], np.int64)


def decimation(m: Integers, n: int | Integers) -> Integers:
    """
    Return the stride between starting points that costs next to nothing, for each factor.

    It is a power of three that divides m, so that all points of a difference are kept.
    """
    overlap = np.maximum(LEAST_OVERLAP, _NEAR * np.sqrt(m / n))
    stride = np.ones(m.size, np.int64)
    while True:
        finer = stride * BASE
        can = (m % finer == 0) & (m >= finer * overlap)
        if not can.any():
            return stride
        stride = np.where(can, finer, stride)


def _smooth(wanted: Floats) -> Integers:
    """Return each number to the nearest multiple of a power of three up to a 12th of it."""
    power = np.floor(np.log(np.maximum(wanted / LEAST_OVERLAP, 1.0)) / math.log(BASE) + 1e-9)
    unit = BASE**power
    return np.unique((np.rint(wanted / unit) * unit).astype(np.int64))


def _from_seconds(tau: Sequence[float] | Floats, rate_hz: float) -> Integers:
    wanted = np.atleast_1d(np.asarray(tau, np.float64))
    if wanted.size == 0:
        raise DataError('the list of averaging times is empty')
    if not np.all(np.isfinite(wanted)):
        raise DataError('averaging times must be finite')
    lowest = float(wanted.min())
    # a tenth of a percent is for periods that decimal fractions cannot hold
    if lowest * rate_hz < 0.999:
        raise DataError(f'tau {lowest:g} s is below the sample period of {1.0 / rate_hz:g} s')
    return np.unique(np.rint(wanted * rate_hz).astype(np.int64))
