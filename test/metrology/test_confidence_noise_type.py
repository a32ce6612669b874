# SPDX-License-Identifier: Apache-2.0
"""Is the noise at each averaging time named rightly, and where it cannot be, safely?"""

from imu_bench.metrology.deviations import noise_type
from imu_bench.metrology.stretches import stretches
import numpy as np
import pytest

TAUS = np.array([1, 2, 3, 5, 10, 30, 100, 300, 1000])


def power_law(alpha, n, seed):
    """Return n samples of noise, the first n of twice as many left out."""
    k = np.arange(1, 2 * n)
    response = np.concatenate(([1.0], np.cumprod((k - 1 - alpha / 2) / k)))
    white = np.random.default_rng(seed).normal(size=2 * n)
    size = 4 * n
    return np.fft.irfft(np.fft.rfft(white, size) * np.fft.rfft(response, size), size)[n : 2 * n]


def phase_of(rate):
    return np.concatenate(([0.0], np.cumsum(rate - rate.mean())))


@pytest.mark.parametrize('alpha', [2, 1, 0, -1, -2])
def test_pure_noise(alpha):
    """A million samples: right at every tau with a thousand averages."""
    phase = phase_of(power_law(alpha, 1_000_000, 1))
    assert noise_type.identify(phase, TAUS).tolist() == [alpha] * TAUS.size


@pytest.mark.parametrize('alpha', [0, -1, -2, -3, -4])
def test_pure_noise_with_third_differences(alpha):
    phase = phase_of(power_law(alpha, 300_000, 2))
    found = noise_type.identify(phase, TAUS, differences=3)
    assert found.tolist() == [alpha] * TAUS.size


@pytest.mark.parametrize('alpha', [0, -1, -2])
@pytest.mark.parametrize('averages', [256, 127, 60, 30, 16, 10])
def test_few_averages(alpha, averages):
    """Right in at least nine of ten records, and never whiter than the many averages say."""
    n = 8000
    m = np.array([n // averages])
    found = [
        int(noise_type.identify(phase_of(power_law(alpha, n, seed)), m)[0]) for seed in range(150)
    ]
    assert np.mean(np.array(found) == alpha) >= 0.9
    assert max(found) == alpha


@pytest.mark.parametrize('alpha', [0, -1, -2])
def test_short_records(alpha):
    """Sixty samples, no averaging: the ratio B1 is right in seven of ten."""
    found = [
        int(noise_type.identify(phase_of(power_law(alpha, 60, seed)), np.array([1]))[0])
        for seed in range(200)
    ]
    assert np.mean(np.array(found) == alpha) >= 0.7


def test_white_then_walk():
    """White noise below the crossing at 1000 samples, random walk above it."""
    rng = np.random.default_rng(3)
    n = 3_000_000
    rate = rng.normal(size=n) + np.sqrt(3.0) / 1000.0 * np.cumsum(rng.normal(size=n))
    m = np.array([1, 10, 100, 10_000, 20_000, 100_000, 300_000])
    assert noise_type.identify(phase_of(rate), m).tolist() == [0, 0, 0, -2, -2, -2, -2]


def test_angle_read_with_an_error():
    """An uncorrelated error of the angle is white phase noise until the walk outgrows it."""
    rng = np.random.default_rng(4)
    angle = rng.normal(size=500_000) + np.cumsum(0.02 * rng.normal(size=500_000))
    found = noise_type.identify(angle, np.array([1, 2, 5, 100, 30_000]))
    assert found.tolist() == [2, 2, 2, 2, 0]


def test_ramp_looks_like_its_slope():
    rate = np.random.default_rng(5).normal(size=200_000) + 1e-4 * np.arange(200_000)
    assert noise_type.identify(phase_of(rate), np.array([1, 10_000])).tolist() == [0, -3]


def test_origin_and_mean_of_the_phase_do_not_matter():
    phase = phase_of(power_law(-1, 50_000, 6))
    moved = phase + 1e3 + 0.25 * np.arange(phase.size)
    np.testing.assert_array_equal(
        noise_type.identify(phase, TAUS), noise_type.identify(moved, TAUS)
    )


def test_does_not_depend_on_what_else_is_asked():
    phase = phase_of(power_law(-1, 20_000, 7))
    m = np.array([1, 2, 7, 50, 200, 700, 1999, 5000, 9000])
    together = noise_type.identify(phase, m)
    alone = [int(noise_type.identify(phase, m[i : i + 1])[0]) for i in range(m.size)]
    assert together.tolist() == alone


@pytest.mark.parametrize('alpha', [0, -1, -2])
def test_across_gaps(alpha):
    """Half a record in pieces of a minute to an hour is as good as a whole one half as long."""
    rate = power_law(alpha, 400_000, 8)
    valid = np.ones(rate.size, bool)
    for start in np.random.default_rng(9).integers(0, rate.size, size=60):
        valid[start : start + 3000] = False
    rate[~valid] = 1e6
    phase = np.concatenate(([0.0], np.cumsum(np.where(valid, rate, 0.0))))
    runs = stretches(valid) + np.array([0, 1])
    assert noise_type.identify(phase, TAUS[:-1], runs).tolist() == [alpha] * (TAUS.size - 1)


def test_nothing_to_see_is_called_white():
    phase = np.zeros(10_000)
    assert not noise_type.identify(phase, TAUS).any()
    assert not noise_type.identify(phase[:5], np.array([1, 2])).any()


def test_the_paper_s_conversion_is_kept_without_averaging():
    """r1 of noise at its own rate is delta / (1 - delta); averages of flicker are elsewhere."""
    sampled, averaged = noise_type._autocorrelations(2)
    np.testing.assert_allclose(sampled, [-5 / 9, -3 / 7, -1 / 5, 1 / 3])
    np.testing.assert_allclose(averaged, [-0.5946, -0.3766, -0.0118, 0.5818], atol=1e-4)
    # flicker itself, by the limit of the same covariance: between its boundaries by far
    flicker = (9 * np.log(3) - 16 * np.log(2)) / (8 * np.log(2))
    assert averaged[1] + 0.1 < flicker < averaged[2] - 0.1
    # the paper's formula puts it at alpha = -1.45, next to the boundary to random walk
    delta = flicker / (1 + flicker)
    assert -2.0 * (delta + 1) == pytest.approx(-1.446, abs=1e-3)


@pytest.mark.parametrize('place', [0, 50_000, 99_999])
def test_one_bad_sample_does_not_turn_white_noise_into_a_walk(place):
    rate = np.random.default_rng(11).normal(size=100_000)
    rate[place] = 1e4
    found = noise_type.identify(phase_of(rate), 2 ** np.arange(9))
    assert found.tolist() == [0] * 9


def test_where_the_deviation_has_flattened_it_is_no_longer_phase_noise():
    """White phase noise over a walk of the phase, as of a clock seen through a satellite."""
    late = []
    for seed in range(20):
        rng = np.random.default_rng([12, seed])
        phase = 10.0 * rng.normal(size=20_000) + np.cumsum(rng.normal(size=20_000))
        m = np.array([4, 16, 2000, 4000])  # the two are equal at m = 300
        found = noise_type.identify(phase, m)
        assert found[0] > 0 and found[1] > 0
        late.append(found[2:] > 0)
    # ten averages leave it to chance now and then
    assert np.mean(late) <= 0.2


def test_one_bad_sample_does_not_decide():
    """Differences that no cut touches, and those that one does, show the same type."""
    rate = np.random.default_rng(4).normal(size=20_000)
    phase, m = np.concatenate([[0.0], np.cumsum(rate)]), np.array([4, 20, 100])
    plain = noise_type.identify(phase, m)
    phase[9000:] += 1e3 * np.median(np.abs(rate))
    assert noise_type.identify(phase, m).tolist() == plain.tolist() == [0, 0, 0]
