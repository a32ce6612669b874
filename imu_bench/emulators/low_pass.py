# SPDX-License-Identifier: Apache-2.0
"""The digital low-pass of a chip, at its output data rate."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi


class LowPass:
    """
    Butterworth, -3 dB at the bandwidth the document prints, settled on the first sample.

    Noise density in the pass band is kept.  A bandwidth at or above half the rate filters
    nothing; what a real chip folds back into the band then is not reproduced.

    Parameters
    ----------
    bandwidth_hz, rate_hz : float
    order : int

    Examples
    --------
    >>> LowPass(100.0, 1000.0).filter(np.ones((3, 3))).tolist()[2]
    [1.0, 1.0, 1.0]
    """

    def __init__(self, bandwidth_hz: float, rate_hz: float, order: int = 1) -> None:
        passes_all = bandwidth_hz >= rate_hz / 2
        self._taps = None if passes_all else butter(order, bandwidth_hz, fs=rate_hz)
        self._state: np.ndarray | None = None

    def filter(self, values: np.ndarray) -> np.ndarray:
        """Return filtered values, shape (n, axes); the state goes on to the next block."""
        if self._taps is None or not len(values):
            return values
        b, a = self._taps
        if self._state is None:
            self._state = lfilter_zi(b, a)[:, np.newaxis] * values[0]
        out, self._state = lfilter(b, a, values, axis=0, zi=self._state)
        return np.asarray(out)
