# SPDX-License-Identifier: Apache-2.0
"""Random vibration: the density that was asked for, in its band, the same for everybody."""

from imu_bench.errors import ConfigError
from imu_bench.simulation.random_vibration import RandomVibration
import numpy as np
import pytest
from scipy import stats
from scipy.signal import welch

G2 = 9.80665**2


def test_the_density_of_table_iii_from_200_to_2000_hz_and_nothing_outside():
    shaken = RandomVibration((0.0, 0.01 * G2, 0.0), 200.0, 2000.0, seed=3)
    rate = 10_000.0
    force = shaken.specific_force(np.arange(400_000) / rate)
    assert not force[:, [0, 2]].any()
    frequency, density = welch(force[:, 1], rate, nperseg=2048)
    inside = (frequency > 220) & (frequency < 1600)
    np.testing.assert_allclose(density[inside], 0.01 * G2, rtol=0.35)
    assert density[inside].mean() == pytest.approx(0.01 * G2, rel=0.02)
    outside = (frequency > 20) & ((frequency < 170) | (frequency > 2050))
    assert density[outside].max() < 1e-4 * 0.01 * G2
    # 4.24 g rms: sqrt(0.01 · 1800)
    assert force[:, 1].std() == pytest.approx(np.sqrt(18.0 * G2), rel=0.02)


def test_it_is_gaussian_and_as_strong_at_all_times():
    shaken = RandomVibration((1.0, 0.0, 0.0), 5.0, 100.0, seed=1)
    points = np.arange(0.0, 2000.0, 0.037)
    force = shaken.specific_force(points)[:, 0]
    assert stats.kstest(force[::20] / np.sqrt(95.0), 'norm').pvalue > 1e-3
    # folded to the period in which blocks overlap
    half_block = (1 << 14) / 800.0
    phase = (points % half_block) / half_block
    strengths = [force[(phase >= k / 8) & (phase < (k + 1) / 8)].std() for k in range(8)]
    np.testing.assert_allclose(strengths, np.sqrt(95.0), rtol=0.06)


def test_axes_and_seeds_are_independent_and_each_is_repeated():
    t = np.arange(20_000) / 1000.0
    force = RandomVibration((1.0, 1.0, 1.0), 5.0, 200.0, seed=1).specific_force(t)
    correlation = np.corrcoef(force.T)
    assert np.abs(correlation[np.triu_indices(3, 1)]).max() < 0.1
    again = RandomVibration((1.0, 1.0, 1.0), 5.0, 200.0, seed=1).specific_force(t)
    np.testing.assert_array_equal(force, again)
    other = RandomVibration((1.0, 1.0, 1.0), 5.0, 200.0, seed=(1, 2)).specific_force(t)
    assert abs(np.corrcoef(force[:, 0], other[:, 0])[0, 1]) < 0.1


def test_sensors_of_different_rates_feel_the_same_at_the_same_time():
    shaken = RandomVibration((0.0, 0.0, 1.0), 5.0, 200.0, seed=1)
    slow = np.arange(1, 3000) / 119.0
    forwards = shaken.specific_force(slow)
    anew = RandomVibration((0.0, 0.0, 1.0), 5.0, 200.0, seed=1)
    parts = [anew.specific_force(part) for part in np.array_split(slow[::-1], 7)]
    np.testing.assert_allclose(np.concatenate(parts)[::-1], forwards, atol=1e-9)


def test_memory_stays_bounded_however_long_it_lasts():
    shaken = RandomVibration((1.0, 0.0, 0.0), 200.0, 2000.0)
    for start in np.arange(0.0, 1000.0, 5.0):
        shaken.specific_force(np.array([start]))
    assert len(shaken._pieces) <= 64
    assert len(shaken._blocks) <= 64


@pytest.mark.parametrize('band', [(0.0, 10.0), (10.0, 10.0), (20.0, 10.0)])
def test_a_band_that_is_none_is_refused(band):
    with pytest.raises(ConfigError, match='no band'):
        RandomVibration((1.0, 1.0, 1.0), *band)


def test_what_does_not_shake_has_no_band_to_warn_of():
    assert RandomVibration((0.0, 1.0, 0.0), 200.0, 2000.0).bands
    assert not RandomVibration((0.0, 0.0, 0.0), 200.0, 2000.0).bands
