# SPDX-License-Identifier: Apache-2.0
"""The sensor's own filter: the analogue one where the rate allows, and what folds else."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.simulation.low_pass import LowPass, motion_sections, noise_sections
import numpy as np
import pytest
from scipy.signal import sosfreqz

CASES = [(50.0, 1, 10e3), (50.0, 2, 10e3), (10.0, 1, 100.0), (460.0, 1, 1000.0), (92.3, 2, 200.0)]


@pytest.mark.parametrize(('corner', 'order', 'rate'), CASES)
def test_white_noise_has_the_folded_spectrum_of_the_analogue_filter(corner, order, rate):
    frequency = np.linspace(0.0, 0.499 * rate, 40)
    _, response = sosfreqz(noise_sections(corner, order, rate), frequency, fs=rate)
    images = np.arange(-20_000, 20_001)[:, None] * rate

    def folded(f):
        return (1.0 / (1.0 + ((f + images) / corner) ** (2 * order))).sum(axis=0)

    expected = folded(frequency) / folded(np.zeros(1))
    np.testing.assert_allclose(np.abs(response) ** 2, expected, rtol=2e-3)


@pytest.mark.parametrize('order', [1, 2])
def test_half_the_power_passes_at_the_corner_of_a_fast_enough_filter(order):
    for sections in (motion_sections, noise_sections):
        _, response = sosfreqz(sections(20.0, order, 20e3), [20.0], fs=20e3)
        assert abs(response[0]) ** 2 == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize('order', [1, 2])
def test_motion_is_delayed_as_by_the_analogue_filter(order):
    frequency = np.array([5.0, 20.0, 40.0])
    _, response = sosfreqz(motion_sections(20.0, order, 400.0), frequency, fs=400.0)
    s = 1j * frequency / 20.0
    analogue = 1 / (1 + s) if order == 1 else 1 / (1 + np.sqrt(2.0) * s + s * s)
    np.testing.assert_allclose(response, analogue, atol=0.02)


def test_a_corner_that_the_rate_cannot_show_lets_motion_pass():
    values = np.arange(5.0)
    np.testing.assert_array_equal(LowPass(300.0, 2, motion_sections).apply(values, 100.0), values)


def test_a_constant_passes_unchanged_and_at_once():
    filtered = LowPass(5.0, 2, noise_sections).apply(np.full((50, 3), 9.8), 100.0)
    np.testing.assert_allclose(filtered, 9.8, rtol=1e-12)


@given(cuts=st.lists(st.integers(0, 20), min_size=1, max_size=6), order=st.sampled_from([1, 2]))
@settings(max_examples=30, deadline=None)
def test_blocks_do_not_change_what_comes_out(cuts, order):
    values = np.random.default_rng(1).standard_normal(sum(cuts))
    whole = LowPass(7.0, order, noise_sections).apply(values, 100.0)
    low_pass = LowPass(7.0, order, noise_sections)
    ends = np.cumsum(cuts)
    parts = [low_pass.apply(values[e - c : e], 100.0) for c, e in zip(cuts, ends, strict=True)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
