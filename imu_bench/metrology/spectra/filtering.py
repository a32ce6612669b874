# SPDX-License-Identifier: Apache-2.0
"""Filters that do not delay: moving average and Butterworth, forwards and backwards."""

from __future__ import annotations

import math

from imu_bench.errors import DataError
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

ORDER = 2
"""Of the Butterworth filter in each direction; the pass there and back has twice as many."""

_SHORTEST = 32
"""Samples by which the ends are extended at least; there must be as many."""


def moving_average(data: npt.ArrayLike, steps: int) -> Floats:
    """
    Return the centred moving average, as long as the data; the ends repeat the end values.

    Shabulinzenze 2020, Tampere University MSc thesis, section 5.2, takes 10 steps.  An even
    number of steps is centred between two samples.

    Raises
    ------
    DataError
        If `steps` is not between 1 and the number of samples.

    Examples
    --------
    >>> moving_average([0.0, 3.0, 0.0, 3.0, 0.0], 3).tolist()
    [1.0, 1.0, 2.0, 1.0, 1.0]
    """
    values = np.asarray(data, dtype=np.float64)
    if not 1 <= steps <= values.size:
        raise DataError(f'a moving average of {steps} steps over {values.size} samples')
    if steps == 1:
        return values
    return np.asarray(scipy.ndimage.uniform_filter1d(values, steps, mode='nearest'), np.float64)


def zero_phase(
    data: npt.ArrayLike,
    rate_hz: float,
    *,
    high_pass: float | None = None,
    low_pass: float | None = None,
) -> Floats:
    """
    Return the data filtered forwards and backwards by Butterworth filters of second order.

    Parameters
    ----------
    rate_hz : float
        Sample rate.
    high_pass, low_pass : float, optional
        Frequencies in Hz at which the result, after both passes, is 3 dB down.

    Raises
    ------
    DataError
        If a frequency is not between 0 and half the sample rate, or there are too few
        samples.

    Notes
    -----
    Two passes would be 6 dB down at the cut-off of one, which is therefore moved (D. A. Winter
    2009, Biomechanics and Motor Control of Human Movement, 4th ed.).  Derived here: the gain of
    both is 1/(1 + x^2n) with order n and the ratio x of warped frequency and cut-off, which is
    1/√2 at x = (√2 − 1)^(1/2n).

    Examples
    --------
    >>> t = np.arange(20_000) / 1000.0
    >>> x = np.sin(2 * np.pi * 50 * t)
    >>> round(float(np.std(zero_phase(x, 1000.0, low_pass=50.0)[2000:-2000]) / np.std(x)), 3)
    0.707
    """
    values = np.asarray(data, dtype=np.float64)
    if values.ndim != 1 or values.size < _SHORTEST:
        raise DataError(f'a filter needs {_SHORTEST} samples or more, got {values.shape}')
    for frequency, kind in ((high_pass, 'highpass'), (low_pass, 'lowpass')):
        if frequency is None:
            continue
        if not 0.0 < frequency < 0.5 * rate_hz:
            raise DataError(
                f'a {kind[:-4]}-pass at {frequency:g} Hz needs a sample rate above '
                f'{2.0 * frequency:g} Hz, not {rate_hz:g} Hz'
            )
        sections = scipy.signal.butter(ORDER, _moved(frequency, rate_hz, kind), kind, output='sos')
        # three periods of the cut-off settle the beginning
        pad = min(values.size - 1, max(_SHORTEST, math.ceil(3.0 * rate_hz / frequency)))
        values = scipy.signal.sosfiltfilt(sections, values, padlen=pad)
    return np.asarray(values, np.float64)


def _moved(frequency: float, rate_hz: float, kind: str) -> float:
    """Return the cut-off of one pass relative to half the sample rate."""
    factor = (math.sqrt(2.0) - 1.0) ** (1.0 / (2.0 * ORDER))
    warped = math.tan(math.pi * frequency / rate_hz)
    warped = warped * factor if kind == 'highpass' else warped / factor
    return 2.0 * math.atan(warped) / math.pi
