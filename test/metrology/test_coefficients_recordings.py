# SPDX-License-Identifier: Apache-2.0
"""Coefficients of a real sensor against what its owner published from another recording."""

import math

from imu_bench.metrology import allan, coefficients, whittle
from imu_bench.units import convert
import numpy as np
import pytest

RATE_HZ = 100.0


@pytest.fixture(scope='module')
def mpu6050(shared_data):
    """Return 449 s at rest by axis in SI: ±2 g and ±250 °/s, 16384 LSB/g and 131 LSB/(°/s)."""
    folder = shared_data / 'mpu6050_static'
    raw = np.loadtxt(
        folder / 'calibration data' / 'example_data_tinit_calc.csv', delimiter=',', skiprows=5
    )
    scale = [convert(1.0 / 16384.0, 'g', 'm/s²')] * 3 + [convert(1.0 / 131.0, '°/s', 'rad/s')] * 3
    published = {}
    for axis in ('ax', 'ay', 'az', 'gx', 'gy', 'gz'):
        path = folder / 'characterization result data' / f'R_q_{axis}.csv'
        published[axis] = math.sqrt(float(path.read_text().split()[0]) / RATE_HZ)
    return dict(zip(published, (raw * scale).T, strict=True)), published


@pytest.mark.data
@pytest.mark.parametrize(
    ('axis', 'within'), [('ax', 0.05), ('ay', 0.05), ('az', 0.05), ('gx', 0.3)]
)
def test_white_noise_of_an_mpu6050(mpu6050, axis, within):
    """The published N are of 6 h on another day; the gyroscope differs by a quarter."""
    signals, published = mpu6050
    unit = 'm/s²' if axis[0] == 'a' else 'rad/s'
    curve = allan.deviation(signals[axis], RATE_HZ, unit=unit)
    model = coefficients.fit(curve)
    assert model.N.value == pytest.approx(published[axis], rel=within)
    assert model.N.high / model.N.low < 1.05
    # the curve itself at 1 s, which is N
    at = int(np.argmin(np.abs(curve.tau - 1.0)))
    assert model.deviation(curve.tau)[at] == pytest.approx(curve.deviation[at], rel=0.05)


@pytest.mark.data
def test_seven_minutes_show_no_bias_instability_and_both_methods_agree(mpu6050):
    signals, _ = mpu6050
    for axis, x in signals.items():
        model = coefficients.fit(allan.deviation(x, RATE_HZ))
        assert not model.B.observable, axis
        assert 'record about' in model.B.reason
        spectral = whittle.fit(x, RATE_HZ, shortest_tau=model.tau_low)
        assert whittle.disagreements(model, spectral) == (), axis
