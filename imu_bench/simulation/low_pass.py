# SPDX-License-Identifier: Apache-2.0
"""The low-pass in front of a sensor's output, at whatever rate it is computed."""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ORDERS = (1, 2)

SETTLED = 3.0
"""Periods of the corner frequency after which a start is forgotten: e^(-3√2π) = 2e-6 is left."""


def motion_sections(corner_hz: float, order: int, rate_hz: float) -> Array:
    """
    Return a Butterworth low-pass for signals well below half the rate, true in gain and phase.

    A corner near half the rate or above it filters nothing that such a signal has.

    Parameters and result as `noise_sections`.
    """
    if corner_hz > 0.45 * rate_hz:
        return np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    return _butterworth(corner_hz, order, rate_hz)


def noise_sections(corner_hz: float, order: int, rate_hz: float) -> Array:
    """
    Return a Butterworth low-pass for white noise, as sections for `scipy.signal.sosfilt`.

    To white noise it gives the spectrum that samples of analogue noise behind the analogue
    filter have, folding included, with a gain of one at zero frequency.  So it is the
    analogue filter well below the Nyquist frequency, and no corner frequency is too high.

    Parameters
    ----------
    corner_hz : float
        -3 dB.
    order : int
        1 or 2.
    rate_hz : float
        Rate of the samples.

    Notes
    -----
    The poles are those of the analogue filter, z = exp(sT).  Behind the second order the
    samples of white noise are an ARMA(2, 1) process of autocovariance
    e^(-aτ) (cos aτ + sin aτ), a = 2πf/√2, which fixes the zero: taken through the poles alone,
    the samples have an autocovariance at lags 0 and 1 only, that of a moving average.

    Examples
    --------
    >>> noise_sections(50.0, 1, 10e3).round(4).tolist()
    [[0.0309, 0.0, 0.0, 1.0, -0.9691, 0.0]]
    """
    step = 2.0 * math.pi * corner_hz / rate_hz
    if order == 1:
        pole = math.exp(-step)
        return np.array([[-math.expm1(-step), 0.0, 0.0, 1.0, -pole, 0.0]])
    a = step / math.sqrt(2.0)
    poles = np.array([1.0, -2.0 * math.exp(-a) * math.cos(a), math.exp(-2.0 * a)])
    lags = a * np.arange(4)
    covariance = np.exp(-lags) * (np.cos(lags) + np.sin(lags))
    products = np.outer(poles, poles)
    index = np.arange(3)
    difference = index[:, None] - index
    # of what is left when the poles are taken out: a moving average of one step
    zeroth = float(np.sum(products * covariance[np.abs(difference)]))
    first = float(np.sum(products * covariance[np.abs(1 + difference)]))
    half = zeroth / (2.0 * first)
    zero = half - math.copysign(math.sqrt(half * half - 1.0), half)
    gain = poles.sum() / (1.0 + zero)
    return np.array([[gain, gain * zero, 0.0, *poles]])


def sample_sections(corner_hz: float, order: int, rate_hz: float) -> Array:
    """
    Return a Butterworth low-pass of the output samples, which lets nothing of half the rate pass.

    A corner of half the rate or more filters nothing.  Parameters and result as `noise_sections`.
    """
    if corner_hz >= 0.5 * rate_hz:
        return np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    return _butterworth(corner_hz, order, rate_hz)


NOISE_FILTERS = {'analogue': noise_sections, 'digital': sample_sections}
"""What `low_pass_kind` may be: a filter before the sampling, or one of the output samples."""


def _butterworth(corner_hz: float, order: int, rate_hz: float) -> Array:
    from scipy.signal import butter  # as below: half a second that who only records need not wait

    return np.asarray(butter(order, corner_hz, fs=rate_hz, output='sos'))


class LowPass:
    """
    A low-pass of one or more columns that goes on from block to block.

    Parameters
    ----------
    sections : callable
        `motion_sections`, `noise_sections` or `sample_sections`.

    Examples
    --------
    >>> LowPass(10.0, 1, noise_sections).apply(np.full((4, 2), 3.0), 100.0)[-1]
    array([3., 3.])
    """

    def __init__(
        self, corner_hz: float, order: int, sections: Callable[[float, int, float], Array]
    ) -> None:
        self._corner_hz = corner_hz
        self._made_by = sections
        self._order = order
        self._rate_hz = 0.0
        self._sections = np.empty((0, 6))
        self._state: Array | None = None

    @property
    def state(self) -> tuple[float, Array, Array | None]:
        """What is left of the values so far; put back, they follow it again."""
        return self._rate_hz, self._sections, self._state

    @state.setter
    def state(self, state: tuple[float, Array, Array | None]) -> None:
        self._rate_hz, self._sections, self._state = state

    def settling(self, rate_hz: float) -> int:
        """Return after how many samples a start is forgotten."""
        return int(np.ceil(SETTLED * rate_hz / self._corner_hz))

    def apply(self, values: Array, rate_hz: float) -> Array:
        """Return filtered values, shape (n,) or (n, k); settled on the first value of all."""
        if rate_hz != self._rate_hz:
            self._rate_hz = rate_hz
            self._sections = self._made_by(self._corner_hz, self._order, rate_hz)
            self._state = None
        if not len(values):
            return values
        from scipy.signal import sosfilt, sosfilt_zi

        if self._state is None:
            self._state = np.multiply.outer(sosfilt_zi(self._sections), values[0])
        filtered, self._state = sosfilt(self._sections, values, axis=0, zi=self._state)
        return np.asarray(filtered)
