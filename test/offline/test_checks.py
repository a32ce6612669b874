# SPDX-License-Identifier: Apache-2.0
"""Whatever a signal looks like, the checks end with a verdict and never with a warning."""

import json

from imu_bench.metrology import allan
from imu_bench.metrology.noise_fit import fitted
from imu_bench.offline.analysis.checks import Checks, examine, hear, Signal, slow_part
import numpy as np
import pytest

RATE_HZ = 100.0


def check(x, valid=None):
    curve = allan.deviation(x, RATE_HZ, unit='rad/s', valid=valid)
    signal = Signal(x, valid, RATE_HZ, 'rad/s', 0.0)
    model, blocks = fitted(curve, 0.95), slow_part(signal)
    heard = hear(model, signal, blocks, 0.95)
    found = examine(signal, blocks, curve, model, heard, model, 0.95)
    document = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert Checks.from_json(document).to_json() == found.to_json()
    return found


def white(n, seed=1):
    return np.random.default_rng(seed).normal(0.0, 1e-3, n)


SIGNALS = {
    'short': white(12),
    'two levels': np.where(white(5000) > 0.0, 1.0, 0.0),
    'one spike': np.eye(1, 5000, 100)[0],
    'one step': np.repeat([0.0, 1.0], 2500),
    'ramp': np.arange(5000.0),
    'sine': np.sin(np.arange(20_000) / 7.0),
    'slow sine': np.sin(np.arange(20_000) / 3000.0) + white(20_000),
    'mostly stuck': np.where(np.arange(20_000) < 19_000, 0.5, white(20_000)),
    'alternating': np.tile([1.0, -1.0], 5000),
    'huge': 1e12 * white(5000),
    'tiny': 1e-12 * white(5000),
    'on a large bias': 1e6 + white(20_000),
    'random walk': np.cumsum(white(20_000)),
    'twice integrated': np.cumsum(np.cumsum(white(20_000))),
}


@pytest.mark.parametrize('name', SIGNALS)
def test_any_signal(name):
    check(SIGNALS[name])


@pytest.mark.parametrize('share', [0.001, 0.1, 0.5])
def test_any_loss(share):
    rng = np.random.default_rng(2)
    valid = rng.random(50_000) > share
    found = check(np.where(valid, white(50_000), 0.0), valid)
    assert found.steadiness.verdict in ('steady', 'too short')
    assert found.second.disagreements == ()


def test_half_of_the_recording_is_one_gap():
    valid = np.ones(60_000, bool)
    valid[20_000:50_000] = False
    found = check(np.where(valid, white(60_000), 0.0), valid)
    assert found.steadiness.verdict == 'steady'
    assert found.normality.verdict == 'normal'


def test_a_long_recording_is_looked_at_in_averages():
    x = white(600_000)
    found = check(x)
    assert found.second.coefficients['whittle']['N'].value == pytest.approx(1e-4, rel=0.01)
    assert found.drift.tracking is None
    assert found.normality.verdict == 'normal'
