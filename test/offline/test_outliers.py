# SPDX-License-Identifier: Apache-2.0
"""Transfer errors leave the noise figures of a sensor alone, and are counted."""

from dataclasses import replace

from imu_bench.offline.analysis.recording import analyse
from imu_bench.samples import Samples
import numpy as np
import pytest

N = 1e-4
RATE = 100.0


def recorded(recording_of, noise, seed, share, *, size=20.0, walk=0.0, n=60_000):
    """Return the result of one axis with white noise, and outliers of this many σ."""
    samples = noise(seed, n=n)
    rng = np.random.default_rng([5, seed])
    sigma = N * RATE**0.5
    signal = rng.normal(0.0, sigma, n) + walk * np.cumsum(rng.normal(0.0, RATE**-0.5, n))
    hit = rng.random(n) < share
    signal[hit] += size * sigma * rng.choice([-1.0, 1.0], np.count_nonzero(hit))
    rates = np.full((n, 3), np.nan)
    rates[:, 0] = signal
    only = Samples(samples.stamps, angular_velocity=rates)
    return analyse(recording_of(only)), int(np.count_nonzero(hit))


@pytest.mark.slow
def test_n_does_not_notice_one_outlier_in_a_thousand(recording_of, noise):
    held = 0
    for seed in range(8):
        result, hits = recorded(recording_of, noise, seed, 1e-3)
        axis = result.axes['angular_velocity.x']
        held += axis.model.N.low < N < axis.model.N.high
        assert axis.model.N.value == pytest.approx(N, rel=0.02)
        assert axis.noise_density_methods['plateau'].value == pytest.approx(2**0.5 * N, rel=0.03)
        assert axis.noise_density_methods['sigma'].value == pytest.approx(2**0.5 * N, rel=0.03)
        # the table of statistics tells what was recorded
        assert axis.statistics['std'].value > 1.1 * N * RATE**0.5
        assert axis.statistics['maximum'].value > 15 * N * RATE**0.5
        (found,) = (f for f in result.health.findings if f.code == 'outliers')
        assert int(found.text.split()[0]) == pytest.approx(hits, abs=2)
        assert 'without' in found.effect
    assert held >= 7


@pytest.mark.parametrize('signs', [(1, 1), (1, -1), (1, 0, 1), (1, 1, -1, 1), (1, 1, 1, 1)])
def test_outliers_beside_one_another_are_told_and_replaced(recording_of, noise, signs):
    """Twenty bursts in 10 min: N came out 7 to 13 % high, with its truth outside."""
    samples = noise(2, n=60_000)
    signal = np.random.default_rng([6, 1]).normal(0.0, N * RATE**0.5, 60_000)
    for start in range(1000, 60_000, 2950):
        signal[start : start + len(signs)] += 20.0 * N * RATE**0.5 * np.array(signs)
    rates = np.full((signal.size, 3), np.nan)
    rates[:, 0] = signal
    result = analyse(recording_of(Samples(samples.stamps, angular_velocity=rates)))
    axis = result.axes['angular_velocity.x']
    count = 20 * np.count_nonzero(signs)
    assert result.health.spikes['angular_velocity.x'].single.size == count
    (found,) = (f for f in result.health.findings if f.code == 'outliers')
    assert found.text.startswith(f'{count} outliers')
    assert 'without all of them' in found.effect
    assert axis.model.N.low < N < axis.model.N.high
    assert axis.model.N.value == pytest.approx(N, rel=0.012)


def test_slow_noise_keeps_what_it_has(recording_of, noise):
    walk = 3e-5
    clean, _ = recorded(recording_of, noise, 6, 0.0, walk=walk)
    dirty, _ = recorded(recording_of, noise, 6, 1e-3, walk=walk)
    one, other = (r.axes['angular_velocity.x'].model.K for r in (clean, dirty))
    assert one.value == pytest.approx(walk, rel=0.4)
    assert other.value == pytest.approx(one.value, rel=0.02)


@pytest.mark.slow
def test_a_shock_that_rings_is_not_taken_away(recording_of, noise):
    samples = noise(1)
    rates = samples.angular_velocity.copy()
    ring = np.exp(-np.arange(12) / 3.0) * np.cos(2.4 * np.arange(12))
    for start in range(5000, 55_000, 5000):
        rates[start : start + 12] += 60.0 * N * RATE**0.5 * ring[:, None]
    plain = analyse(recording_of(replace(samples, angular_velocity=rates)))
    finding = next(f for f in plain.health.findings if f.code == 'outliers')
    assert 'N, B and K hold them' in finding.effect


def test_many_are_no_outliers(recording_of, noise):
    result, _ = recorded(recording_of, noise, 2, 0.03, n=20_000)
    finding = next(f for f in result.health.findings if f.code == 'outliers')
    assert 'more than 1 %' in finding.effect
