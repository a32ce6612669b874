# SPDX-License-Identifier: Apache-2.0
"""The slope-tangent method: what it reads, against the steps of the MATLAB example."""

from dataclasses import replace

from imu_bench.metrology import allan, coefficients
from imu_bench.metrology.fitting.noise_model import variance_of
import numpy as np
import pytest


def curve_of(values, tau):
    """Return a curve of given coefficients without scatter, over an overlapped one as a frame."""
    curve = allan.deviation(np.random.default_rng(1).standard_normal(50_000), 100.0, tau=tau)
    return replace(curve, deviation=np.sqrt(variance_of(values, curve.tau)))


@pytest.mark.parametrize('term', 'NBK')
def test_a_pure_term_is_read_exactly(term):
    model = coefficients.tangent_fit(curve_of({term: 3e-3}, 'log'))
    assert model.coefficients[term].value == pytest.approx(3e-3, rel=1e-9)


def test_the_steps_of_the_example():
    """Local slopes by finite differences, first point of the nearest, intercept, reading."""
    curve = curve_of({'N': 2e-2, 'B': 1e-3, 'K': 5e-3}, 'octave')
    x, y = np.log10(curve.tau), np.log10(curve.deviation)
    local = np.diff(y) / np.diff(x)
    model = coefficients.tangent_fit(curve)
    n = np.argmin(np.abs(local + 0.5))
    assert model.N.value == pytest.approx(10 ** (y[n] + 0.5 * x[n]))
    b = np.argmin(np.abs(local))
    assert model.B.value == pytest.approx(10 ** y[b] / np.sqrt(2 * np.log(2) / np.pi))
    k = np.argmin(np.abs(local - 0.5))
    assert model.K.value == pytest.approx(10 ** (y[k] - 0.5 * x[k] + 0.5 * np.log10(3.0)))
    assert model.method == 'slope tangent'


def test_it_invents_what_is_not_there():
    """The reason why it is not the default: white noise alone has no B and no K."""
    x = np.random.default_rng(2).standard_normal(2**16)
    curve = allan.deviation(x, 100.0)
    assert set(coefficients.tangent_fit(curve).terms) == set('NBK')
    assert coefficients.fit(curve).terms == 'N'


def test_it_gives_no_interval_and_does_not_look_for_q_and_r():
    model = coefficients.tangent_fit(curve_of({'N': 1.0}, 'octave'))
    assert model.N.low is None and model.N.high is None
    for term in 'QR':
        assert 'does not look for it' in model.coefficients[term].reason


@pytest.mark.parametrize('count', [0, 1])
def test_one_point_has_no_slope(count):
    curve = curve_of({'N': 1.0}, 'octave')
    deviation = np.zeros(len(curve))
    deviation[:count] = 1.0
    model = coefficients.tangent_fit(replace(curve, deviation=deviation))
    assert model.terms == ''
    assert 'needs two averaging times' in model.N.reason
