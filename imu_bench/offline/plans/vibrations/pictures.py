# SPDX-License-Identifier: Apache-2.0
"""Signals thinned to what a figure can show."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.offline.plans.result import Image
import numpy as np
import numpy.typing as npt
from scipy import signal

Floats = npt.NDArray[np.float64]

POINTS = 1200
COLUMNS, ROWS = 300, 200
_DECADES = 6.0


@dataclass(frozen=True, eq=False)
class Picture:
    """Mean, lowest and highest value of successive pieces, with their time in s."""

    time: Floats
    middle: Floats
    low: Floats
    high: Floats


def thinned(values: Floats, rate_hz: float) -> Picture:
    """
    Return a signal in at most `POINTS` pieces.

    Examples
    --------
    >>> picture = thinned(np.sin(np.arange(12_000.0)), 100.0)
    >>> picture.time.size, round(float(picture.high.max()), 2)
    (1200, 1.0)
    """
    size = max(1, -(-values.size // POINTS))
    count = values.size // size
    pieces = values[: count * size].reshape(count, size)
    time = np.asarray((np.arange(count) + 0.5) * (size / rate_hz), np.float64)
    return Picture(time, pieces.mean(axis=1), pieces.min(axis=1), pieces.max(axis=1))


def spectrogram(values: Floats, rate_hz: float, resolution_hz: float, highest_hz: float) -> Image:
    """
    Return the spectrogram of a signal up to a frequency: density in dB above 1 (m/s²)²/Hz.

    Examples
    --------
    >>> image = spectrogram(np.sin(np.arange(20_000.0)), 1000.0, 2.0, 200.0)
    >>> image.values.shape[0] <= ROWS, round(image.y[1])
    (True, 202)
    """
    length = min(values.size // 4, max(32, round(rate_hz / resolution_hz)))
    step = max(1, length // 2, (values.size - length) // COLUMNS)
    frequency, time, density = signal.spectrogram(
        values, rate_hz, window='hann', nperseg=length, noverlap=max(0, length - step)
    )
    shown = frequency <= highest_hz
    frequency, density = frequency[shown], density[shown]
    group = max(1, -(-frequency.size // ROWS))
    rows = frequency.size // group
    density = density[: rows * group].reshape(rows, group, -1).mean(axis=1)
    top = float(density.max())
    decibel = 10.0 * np.log10(np.maximum(density, max(top * 10.0**-_DECADES, 1e-300)))
    half = 0.5 * step / rate_hz
    return Image(
        np.asarray(decibel, np.float64),
        (float(time[0]) - half, float(time[-1]) + half),
        (0.0, rows * group * rate_hz / length),
        'density in dB above 1 (m/s²)²/Hz',
    )
