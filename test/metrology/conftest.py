# SPDX-License-Identifier: Apache-2.0
"""Noise of a power law, for tests of deviations."""

import numpy as np
import pytest


def power_law_noise(seed, n, alpha=0):
    white = np.random.default_rng(seed).normal(size=n)
    if alpha == 0:
        return white
    return np.cumsum(white) if alpha == -2 else flicker(white)


def flicker(white):
    """Return flicker noise of a white one twice as long, its beginning left out."""
    n = white.size
    k = np.arange(1, 2 * n)
    response = np.concatenate(([1.0], np.cumprod((k - 0.5) / k)))
    more = np.concatenate((np.random.default_rng(n).normal(size=n), white))
    size = 4 * n
    return np.fft.irfft(np.fft.rfft(more, size) * np.fft.rfft(response, size), size)[n : 2 * n]


@pytest.fixture(scope='session')
def noise():
    """Return a function that makes white noise (alpha 0), flicker (-1) or a walk (-2)."""
    return power_law_noise
