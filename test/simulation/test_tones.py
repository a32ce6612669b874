# SPDX-License-Identifier: Apache-2.0
"""Sine, sweep, engine and hum: the frequencies and amplitudes that were asked for."""

import math

from imu_bench.errors import ConfigError
from imu_bench.simulation.tones import engine, mains_hum, Sine, Sweep
import numpy as np
import pytest


def amplitude(values, frequency, rate):
    t = np.arange(values.size) / rate
    return 2.0 * abs(np.mean(values * np.exp(-2j * np.pi * frequency * t)))


def test_what_lies_above_nyquist_aliases():
    t = np.arange(100) / 100.0
    fast, slow = Sine(1.0, 90.0), Sine(1.0, 10.0)
    np.testing.assert_allclose(fast.specific_force(t), -slow.specific_force(t), atol=1e-9)


def test_an_unknown_axis_is_refused():
    with pytest.raises(ConfigError, match=r"'w'.*x, y, z"):
        Sine(1.0, 1.0, 'w')


@pytest.mark.parametrize('returns', [True, False])
def test_the_phase_of_a_sweep_is_the_integral_of_its_frequency(returns):
    sweep = Sweep(1.0, 5.0, 20.0, 1 / 6, returns=returns)
    t = np.linspace(0.0, 60.0, 600_001)
    frequency = sweep.frequency(t)
    cycles = np.concatenate([[0.0], np.cumsum((frequency[1:] + frequency[:-1]) / 2) * (t[1])])
    jumps = np.abs(np.diff(frequency)) > 1.0
    np.testing.assert_allclose(
        sweep.specific_force(t)[:, 2], np.sin(2 * np.pi * cycles), atol=0.02 if returns else 2.1
    )
    assert jumps.any() != returns
    assert (frequency.min(), frequency.max()) == pytest.approx((5.0, 20.0), rel=1e-4)


def test_service_condition_4_goes_up_and_down_two_octaves_in_four_minutes():
    sweep = Sweep(9.8, 5.0, 20.0, 1 / 60)
    np.testing.assert_allclose(
        sweep.frequency(np.array([0, 60, 120, 180, 240, 300.0])), [5, 10, 20, 10, 5, 10], rtol=1e-9
    )
    assert np.abs(sweep.specific_force(np.linspace(0, 600, 400_000))).max() == pytest.approx(9.8)


@pytest.mark.parametrize('bad', [(20.0, 5.0, 1.0), (0.0, 5.0, 1.0), (5.0, 20.0, 0.0)])
def test_a_sweep_that_is_none_is_refused(bad):
    with pytest.raises(ConfigError, match='sweep'):
        Sweep(1.0, *bad)


def test_a_four_cylinder_engine_at_800_rpm_has_the_lines_of_the_thesis():
    idle = engine(800 / 60, 4, (0.4, 0.6, 1.2), (0.2, 0.3, 0.6), unbalance=0.1, harmonics=4)
    rate, n = 3000.0, 90_000
    force = idle.specific_force(np.arange(n) / rate)
    for frequency, expected in ((13.333, 0.12), (26.667, 1.2), (53.333, 0.6), (80.0, 0.3)):
        found = amplitude(force[:, 2], round(frequency * 30) / 30, rate)
        assert found == pytest.approx(expected, rel=1e-6)
    assert not idle.angular_velocity(np.zeros(3)).any()
    assert [event['frequency']['value'] for event in idle.events][1] == pytest.approx(80 / 3)


def test_an_engine_that_does_not_hold_its_speed_spreads_its_lines():
    steady = engine(800 / 60, 4, (0, 0, 1.0), (0, 0, 0.0), harmonics=2)
    wandering = engine(
        800 / 60, 4, (0, 0, 1.0), (0, 0, 0.0), harmonics=2, wander=0.02, rocking=0.1
    )
    t = np.arange(60_000) / 1000.0
    line = 80 / 3
    assert amplitude(steady.specific_force(t)[:, 2], line, 1000.0) == pytest.approx(1.0, rel=1e-3)
    assert amplitude(wandering.specific_force(t)[:, 2], line, 1000.0) < 0.7
    assert wandering.specific_force(t)[:, 2].std() == pytest.approx(math.sqrt(0.5), rel=1e-2)
    assert np.abs(wandering.angular_velocity(t)).max(axis=0) == pytest.approx(
        [0.1, 0, 0], rel=1e-3
    )


def test_the_mains_hums_at_50_hz_and_its_third_harmonic():
    hum = mains_hum(50.0, (0.1, 0.0, 0.2), 0.5)
    t = np.arange(10_000) / 1000.0
    force = hum.specific_force(t)
    assert amplitude(force[:, 2], 50.0, 1000.0) == pytest.approx(0.2)
    assert amplitude(force[:, 2], 150.0, 1000.0) == pytest.approx(0.1)
    assert not force[:, 1].any()
