# SPDX-License-Identifier: Apache-2.0
"""The same deviation by other ways: decimated, by threads, in blocks, from sums, in a window."""

import tracemalloc

from imu_bench.errors import DataError
from imu_bench.metrology import allan, blockwise
from imu_bench.metrology.deviations import allan_kernels, integral
from imu_bench.metrology.stretches import stretches
import numpy as np
import pytest

KINDS = ('adev', 'oadev', 'mdev', 'tdev', 'hdev', 'ohdev', 'totdev')


# --- decimation, threads -----------------------------------------------------------------


def test_up_to_a_million_samples_auto_is_full_overlap(noise):
    data = noise(21, 20_000)
    auto = allan.deviation(data, 10.0)
    full = allan.deviation(data, 10.0, overlap='full')
    np.testing.assert_array_equal(auto.deviation, full.deviation)
    assert auto.terms.tolist() == (20_001 - 2 * auto.m).tolist()


@pytest.mark.slow
@pytest.mark.parametrize('alpha', [0, -1, -2])
def test_decimated_is_within_a_percent_of_full_overlap(noise, alpha):
    for seed in range(10):
        data = noise(seed, 100_000, alpha)
        full = allan.deviation(data, 10.0, overlap='full')
        thin = allan.deviation(data, 10.0, overlap='decimated')
        np.testing.assert_array_equal(thin.m, full.m)
        np.testing.assert_array_equal(thin.edf, full.edf)
        assert thin.terms.sum() < 0.6 * full.terms.sum()
        below = full.m < 10_000
        np.testing.assert_allclose(thin.deviation[below], full.deviation[below], rtol=0.01)


def test_decimated_gives_phase_noise_in_full(noise):
    """Its differences are uncorrelated, so fewer of them would cost efficiency."""
    data = np.diff(noise(22, 50_001))
    full = allan.deviation(data, 10.0, overlap='full')
    thin = allan.deviation(data, 10.0, overlap='decimated')
    assert set(full.alpha.tolist()) == {2}
    np.testing.assert_array_equal(thin.deviation, full.deviation)


def test_decimated_is_not_misled_by_a_tone_locked_to_the_clock(noise):
    """Periods of 2, 4 and 8 samples, strong enough to carry a part of the deviation."""
    data = noise(23, 100_000)
    for period, amplitude in ((2, 20.0), (4, 10.0), (8, 5.0)):
        data += amplitude * np.sin(2.0 * np.pi * np.arange(data.size) / period + 0.3)
    full = allan.deviation(data, 10.0, overlap='full')
    thin = allan.deviation(data, 10.0, overlap='decimated')
    below = full.m < 10_000
    np.testing.assert_allclose(thin.deviation[below], full.deviation[below], rtol=0.01)


def test_decimated_with_gaps(noise):
    data = noise(24, 60_000, -2)
    valid = np.ones(data.size, bool)
    valid[[10_001, 10_002, 31_333]] = False
    full = allan.deviation(data, 10.0, valid=valid, overlap='full')
    thin = allan.deviation(data, 10.0, valid=valid, overlap='decimated')
    np.testing.assert_allclose(thin.deviation, full.deviation, rtol=0.01)
    np.testing.assert_array_equal(thin.m, full.m)


@pytest.mark.slow
def test_threads_change_nothing(noise, monkeypatch):
    monkeypatch.setattr(blockwise, 'BLOCK', 1 << 12)
    monkeypatch.setattr(blockwise, '_WORTH_THREADS', 0)
    data = noise(25, 100_000) + 9.81
    for overlap in ('full', 'decimated'):
        one = allan.deviation(data, 10.0, overlap=overlap, threads=1)
        four = allan.deviation(data, 10.0, overlap=overlap, threads=4)
        for name in ('deviation', 'low', 'high', 'terms', 'alpha'):
            np.testing.assert_array_equal(getattr(four, name), getattr(one, name))


@pytest.mark.parametrize('kind', KINDS)
def test_blocks_change_nothing_but_rounding(noise, kind, monkeypatch):
    data = noise(26, 5000)
    whole = allan.deviation(data, 10.0, kind=kind)
    monkeypatch.setattr(blockwise, 'BLOCK', 1 << 9)
    pieces = allan.deviation(data, 10.0, kind=kind)
    np.testing.assert_allclose(pieces.deviation, whole.deviation, rtol=1e-12)


@pytest.mark.slow
def test_memory_is_at_most_two_copies_of_an_axis(noise):
    data = noise(36, 3_000_000)
    for overlap in ('full', 'auto'):
        tracemalloc.start()
        allan.deviation(data, 10.0, overlap=overlap, threads=1)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak <= 2 * data.nbytes


# --- from sums, moving window ------------------------------------------------------------


def test_curve_from_sums_is_the_batch_curve(noise):
    data = 9.81 + noise(27, 4000)
    valid = np.ones(4000, bool)
    valid[1200:1210] = False
    rate = 100.0
    batch = allan.deviation(data, rate, valid=valid, overlap='full', unit='m/s²')
    phase = integral.cumulate(data - 3.0, valid) / rate + 77.0
    runs = stretches(valid) + np.array([0, 1])
    sums, terms = allan_kernels.second_difference_sums(phase, batch.m, runs)
    curve = allan.curve_from_sums(
        batch.m, sums, terms, 1.0 / rate, 3990, 4000, 'm/s²', 0.95, batch.alpha, runs,
        batch.omitted,
    )  # fmt: skip
    for name in ('deviation', 'low', 'high', 'edf', 'tau'):
        np.testing.assert_allclose(getattr(curve, name), getattr(batch, name), rtol=1e-9)
    assert (curve.samples, curve.span, curve.unit) == (batch.samples, batch.span, batch.unit)


def test_moving_window_is_the_deviation_of_each_window(noise):
    data = noise(28, 3000)
    valid = np.ones(3000, bool)
    valid[1000:2000] = False
    moving = allan.dynamic_deviation(data, 10.0, 50.0, 25.0, valid=valid, tau=[1.0, 10.0])
    assert moving.start.tolist() == [0.0, 25.0, 50.0, 75.0, 100.0, 125.0, 150.0, 175.0, 200.0,
                                     225.0, 250.0]  # fmt: skip
    assert moving.curves[1].tau.tolist() == [1.0, 10.0]
    alone = allan.deviation(data[250:750], 10.0, tau=[1.0, 10.0])
    np.testing.assert_array_equal(moving.curves[1].deviation, alone.deviation)
    assert moving.curves[4] is None
    # samples 750 to 999 of the window from 75 s are there
    assert moving.curves[3].terms.tolist() == [250 - 20 + 1, 250 - 200 + 1]


def test_moving_window_that_does_not_fit(noise):
    with pytest.raises(DataError, match='a window of 60 s does not fit a record of 50 s'):
        allan.dynamic_deviation(noise(29, 500), 10.0, 60.0, 1.0)
    with pytest.raises(DataError, match='at least one sample'):
        allan.dynamic_deviation(noise(29, 500), 10.0, 10.0, 0.01)
