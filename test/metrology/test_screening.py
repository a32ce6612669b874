# SPDX-License-Identifier: Apache-2.0
"""A glance rules out what no fit describes, and nothing that one does."""

from imu_bench.metrology import allan, noise_fit
from imu_bench.metrology.coefficients import CurveFits
from imu_bench.metrology.fitting import fit_range
from imu_bench.metrology.fitting.model_choice import fit_subsets
from imu_bench.metrology.fitting.model_fit import prepare
from imu_bench.metrology.fitting.screening import glance
import numpy as np
import pytest
from scipy import signal

RATE_HZ = 100.0
SAMPLES = 30_000


def vibrating(seed: int, frequency_hz: float, amplitude: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * frequency_hz * np.arange(SAMPLES) / RATE_HZ
    return rng.normal(size=SAMPLES) + amplitude * np.sin(phase)


def wandering(seed: int, time_s: float, sigma: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    memory = np.exp(-1.0 / (RATE_HZ * time_s))
    drive = [sigma * np.sqrt(1.0 - memory**2)]
    slow = signal.lfilter(drive, [1.0, -memory], rng.normal(size=SAMPLES))
    return rng.normal(size=SAMPLES) + slow


def problem_of(x: np.ndarray):
    curve = allan.deviation(x, RATE_HZ, unit='rad/s')
    return prepare(curve.m, curve.deviation, curve.period, curve.span, 'QNBKR'), curve.edf


@pytest.mark.parametrize('seed', range(20))
def test_what_a_fit_describes_is_not_hopeless(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=SAMPLES) + np.cumsum(10 ** rng.uniform(-4, -2) * rng.normal(size=SAMPLES))
    problem, degrees = problem_of(x)
    assert fit_range.Range(problem, fit_subsets(problem)).described
    assert not glance(problem, degrees).hopeless


@pytest.mark.parametrize('frequency_hz', [0.3, 5.0, 37.0])
def test_a_strong_vibration_is_hopeless(frequency_hz):
    problem, degrees = problem_of(vibrating(1, frequency_hz, 10.0))
    assert glance(problem, degrees).hopeless
    assert not fit_range.Range(problem, fit_subsets(problem)).described


def test_the_work_on_a_vibration_is_bounded(monkeypatch):
    """A live window is fitted once a second for each axis: few fits must settle it."""
    counted = []

    def counting(problem):
        counted.append(problem)
        return fit_subsets(problem)

    monkeypatch.setattr(fit_range, 'fit_subsets', counting)
    for frequency_hz, amplitude in [(0.3, 1.0), (0.3, 10.0), (5.0, 10.0), (37.0, 3.0)]:
        counted.clear()
        curve = allan.deviation(vibrating(2, frequency_hz, amplitude), RATE_HZ, unit='rad/s')
        model = noise_fit.fitted(curve)
        assert model.gauss_markov is None, frequency_hz
        assert len(counted) <= 12, frequency_hz


def test_a_process_is_still_found():
    curve = allan.deviation(wandering(3, 1.0, 2.0), RATE_HZ, unit='rad/s')
    assert CurveFits(curve).powers.chi2 > noise_fit.DOUBTFUL
    model = noise_fit.fitted(curve)
    assert model.gauss_markov is not None
    assert model.gauss_markov.T_c.low <= 1.0 <= model.gauss_markov.T_c.high
    assert model.N.low <= 0.1 <= model.N.high
