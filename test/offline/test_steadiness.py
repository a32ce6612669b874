# SPDX-License-Identifier: Apache-2.0
"""A change of the noise is found, its size is right, and steady noise raises no alarm."""

from imu_bench.offline.analysis import steadiness
from imu_bench.offline.analysis.steadiness import Steadiness
import numpy as np
import pytest

RATE_HZ = 100.0


def noise(seed, n=60_000):
    return np.random.default_rng(seed).normal(9.8, 0.02, n)


def examine(x, **options):
    return steadiness.examine(x, RATE_HZ, 'm/s²', **options)


@pytest.mark.slow
def test_steady_noise_raises_no_alarm():
    for seed in range(30):
        rng = np.random.default_rng([1, seed])
        x = rng.normal(size=30_000) + np.cumsum(rng.normal(0.0, 0.01, 30_000))
        assert examine(x).verdict == 'steady'


@pytest.mark.parametrize('factor', [1.25, 2.0, 5.0])
def test_a_change_is_found_with_its_size(factor):
    x = noise(2)
    x[40_000:] = 9.8 + factor * (x[40_000:] - 9.8)
    found = examine(x)
    assert found.verdict == 'changes'
    assert found.ratio.low < factor < found.ratio.high
    assert found.ratio.value == pytest.approx(factor, rel=0.1)
    assert found.deviation.argmax() >= 8
    assert found.start[1] == pytest.approx(found.window_s) == 50.0


def test_a_small_change_is_no_change():
    x = noise(3, 600_000)
    x[300_000:] = 9.8 + 1.05 * (x[300_000:] - 9.8)
    assert examine(x).verdict == 'steady'


def test_slow_noise_that_grows_is_found_at_a_long_averaging_time():
    rng = np.random.default_rng(4)
    slow = np.repeat(rng.normal(size=600), 100)
    slow[:30_000] *= 0.1
    found = examine(rng.normal(0.0, 1.0, 60_000) + 0.3 * slow)
    assert found.verdict == 'changes'
    assert found.tau >= 0.5


def test_windows_in_a_gap_are_left_out():
    x = noise(5)
    valid = np.ones(x.size, bool)
    valid[10_000:20_000] = False
    found = examine(np.where(valid, x, 0.0), valid=valid, start_s=7.0)
    assert found.verdict == 'steady'
    assert found.start.size < steadiness.WINDOWS
    assert found.start[0] == 7.0


def test_too_short_says_so():
    found = examine(noise(6, 1000))
    assert found.verdict == 'too short'
    assert not found.ratio.observable
    assert '200 samples' in found.text


def test_gaps_everywhere_say_so():
    found = examine(noise(7), valid=np.zeros(60_000, bool))
    assert found.verdict == 'too short'
    assert 'gaps' in found.text


@pytest.mark.parametrize('n', [1000, 30_000])
def test_json_gives_it_back(n):
    document = examine(noise(8, n)).to_json()
    assert Steadiness.from_json(document).to_json() == document
