# SPDX-License-Identifier: Apache-2.0
"""The signal-to-noise ratio is the one MATLAB's documentation defines."""

from imu_bench.errors import DataError
from imu_bench.metrology.spectra.snr import snr
import numpy as np
import pytest


def sine(rng, n, rate, frequency, noise, harmonics=()):
    t = np.arange(n) / rate
    x = np.cos(2 * np.pi * frequency * t)
    for order, amplitude in harmonics:
        x += amplitude * np.sin(2 * np.pi * order * frequency * t)
    return x + noise * rng.normal(size=n)


def test_the_published_example_with_a_harmonic():
    """
    MATLAB reference page of snr: 1 kHz at 48 kHz, 2nd harmonic of 2/5, noise variance 0.1².

    It prints 17.0178 dB for its own noise and 16.9897 dB as the definition.
    """
    rng = np.random.default_rng(1)
    found = [
        snr(sine(rng, 48_000, 48e3, 1e3, 0.1, [(2, 0.4)]), 48e3).ratio.value for _ in range(25)
    ]
    assert np.mean(found) == pytest.approx(16.9897, abs=0.05)
    assert np.std(found) < 0.1
    assert abs(17.0178 - np.mean(found)) < 3 * np.std(found)


def test_the_published_example_at_80_db():
    """User guide, distortion measurements: 2048 samples of 2.5 kHz at 50 kHz, 80 dB; 79.86."""
    rng = np.random.default_rng(2)
    noise = np.sqrt(0.5) / 10**4.0
    found = [snr(sine(rng, 2048, 5e4, 2500.0, noise), 5e4).ratio for _ in range(200)]
    values = np.array([one.value for one in found])
    assert values.mean() == pytest.approx(80.0, abs=0.1)
    assert abs(79.86 - values.mean()) < 3 * values.std()


@pytest.mark.parametrize('ratio', [0.0, 6.5, 20.0, 40.0, 60.0])
@pytest.mark.parametrize('frequency', [5.0, 13.337])
def test_a_known_ratio_within_a_tenth_of_a_decibel(ratio, frequency):
    rng = np.random.default_rng(3)
    noise = np.sqrt(0.5) / 10 ** (ratio / 20)
    found = [snr(sine(rng, 71_400, 119.0, frequency, noise), 119.0).ratio.value for _ in range(4)]
    assert np.mean(found) == pytest.approx(ratio, abs=0.1)


def test_the_interval_covers():
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(300):
        found = snr(sine(rng, 6000, 119.0, 10.0, 0.3), 119.0).ratio
        inside += found.low <= 10 * np.log10(0.5 / 0.09) <= found.high
    assert 0.91 <= inside / 300 <= 0.99


def test_a_constant_and_the_harmonics_do_not_count():
    rng = np.random.default_rng(5)
    plain = sine(rng, 30_000, 119.0, 5.0, 0.1)
    t = np.arange(plain.size) / 119.0
    distorted = plain + 9.81 + 0.2 * np.sin(2 * np.pi * 15.0 * t)
    first, second = snr(plain, 119.0), snr(distorted, 119.0)
    assert second.ratio.value == pytest.approx(first.ratio.value, abs=0.02)
    assert second.frequency == pytest.approx(5.0, abs=1e-3)
    assert second.harmonics[1] == pytest.approx(0.02, rel=0.02)
    assert second.signal == pytest.approx(0.5, rel=0.01)
    # a harmonic beyond those asked for is noise
    assert snr(distorted, 119.0, harmonics=2).ratio.value == pytest.approx(
        10 * np.log10(0.5 / 0.03), abs=0.1
    )


@pytest.mark.parametrize(
    ('data', 'text'),
    [
        (np.zeros(10), '64 samples'),
        (np.ones(1000), 'constant'),
        (np.full(1000, np.nan), 'not finite'),
    ],
)
def test_what_has_no_ratio_is_said(data, text):
    with pytest.raises(DataError, match=text):
        snr(data, 100.0)
