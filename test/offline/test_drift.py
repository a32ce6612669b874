# SPDX-License-Identifier: Apache-2.0
"""Gauss-Markov models are found where they are, and a filter with the right one is content."""

from dataclasses import replace

from imu_bench.metrology import allan
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import gauss_markov_variance, GaussMarkov
from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.metrology.noise_fit import fitted
from imu_bench.offline.analysis import drift
from imu_bench.offline.analysis.blocks import averages
from imu_bench.offline.analysis.drift import Drift, DriftModel
import numpy as np
import pytest

RATE_HZ = 50.0
TRUTH = Process(1e-3, 20.0)


def measure(x, *, valid=None, size=4):
    curve = allan.deviation(x, RATE_HZ, unit='m/s²', valid=valid)
    return drift.measure(fitted(curve, 0.95), curve, averages(x, RATE_HZ, size, valid), 0.95)


def wandering(seed, n=360_000):
    rng = np.random.default_rng(seed)
    return 9.8 + rng.normal(0.0, 1e-2, n) + TRUTH.simulate(n, RATE_HZ, rng)


@pytest.fixture(scope='module')
def found():
    return measure(wandering(2))


@pytest.mark.parametrize('method', ['autocorrelation', 'allan_fit', 'allan_peak'])
def test_every_method_finds_the_process(found, method):
    model = found.models[method]
    assert model.T_c.low < TRUTH.correlation_time < model.T_c.high
    assert model.T_c.value == pytest.approx(TRUTH.correlation_time, rel=0.3)
    assert model.sigma.low < TRUTH.sigma < model.sigma.high
    assert model.q_c.low < TRUTH.q_c < model.q_c.high
    assert (model.T_c.unit, model.sigma.unit, model.q_c.unit) == ('s', 'm/s²', 'm/s³/√Hz')


def test_the_filter_is_content_with_it(found):
    tracking = found.tracking
    assert tracking.source == 'allan_fit'
    assert tracking.white
    assert tracking.variance == pytest.approx(1.0, abs=0.1)
    assert 0.0 < tracking.rmse.low < tracking.rmse.value < tracking.rmse.high
    assert tracking.deviation.value < TRUTH.sigma
    trace = tracking.trace
    assert trace.time.size == trace.bias.size <= 500
    assert np.nanmean(np.abs(trace.measured - trace.bias)) < TRUTH.sigma


def test_white_noise_has_no_drift():
    for seed in range(10):
        x = np.random.default_rng([2, seed]).normal(0.0, 1e-2, 100_000)
        found = measure(x)
        assert not any(model.process for model in found.models.values())
        assert found.tracking is None
        assert found.models['autocorrelation'].q_c.reason


def test_a_random_walk_is_not_called_a_process():
    rng = np.random.default_rng(3)
    x = rng.normal(0.0, 1e-2, 200_000) + np.cumsum(rng.normal(0.0, 3e-5, 200_000))
    found = measure(x)
    assert found.models['autocorrelation'].process is None
    assert 'random walk' in found.models['autocorrelation'].T_c.reason


def test_a_tone_is_not_called_a_process():
    time = np.arange(200_000) / RATE_HZ
    x = np.random.default_rng(4).normal(0.0, 1e-2, time.size) + 0.1 * np.sin(time)
    found = measure(x)
    assert found.models['allan_peak'].process is None
    assert found.tracking is None or not found.tracking.white


def test_gaps_are_predicted_across():
    x = wandering(5)
    valid = np.ones(x.size, bool)
    valid[50_000:60_000] = valid[200_000:200_500] = False
    found = measure(np.where(valid, x, 0.0), valid=valid)
    assert found.models['allan_fit'].T_c.value == pytest.approx(20.0, rel=0.4)
    assert found.tracking.white
    assert np.isnan(found.tracking.trace.measured).any()


def test_bias_instability_becomes_the_process_that_touches_its_floor():
    B = Estimate(1e-3, 0.9e-3, 1.1e-3, 'rad/s')
    model = DriftModel.of_bias_instability(B, 189.0)
    process = model.process
    assert process.correlation_time == pytest.approx(100.0)
    deviation = process.q_c * np.sqrt(gauss_markov_variance([189.0], 100.0)[0])
    assert deviation == pytest.approx(0.664e-3, rel=2e-3)
    assert model.q_c.value == pytest.approx(process.q_c)
    assert model.sigma.low == pytest.approx(0.9 * model.sigma.value)


def test_the_filter_of_the_sensor_is_not_what_is_tracked():
    """A fit that took its one process for a low-pass leaves the bias to the autocorrelation."""
    x = wandering(2)
    curve = allan.deviation(x, RATE_HZ, unit='m/s²')
    fast = GaussMarkov(Estimate(0.2, 0.19, 0.21, 'm/s³/√Hz'), Estimate(0.003, 0.002, 0.004, 's'))
    model = replace(fitted(curve, 0.95), gauss_markov=fast)
    found = drift.measure(model, curve, averages(x, RATE_HZ, 4), 0.95)
    assert found.models['allan_fit'].T_c.value == 0.003
    assert found.tracking.source == 'autocorrelation'


def test_json_gives_it_back(found):
    document = found.to_json()
    assert set(document) == {'gauss_markov', 'bias_tracking'}
    assert Drift.from_json(document).to_json() == document
    assert Drift.from_json({}) is None
