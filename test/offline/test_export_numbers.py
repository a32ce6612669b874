# SPDX-License-Identifier: Apache-2.0
"""Which number of an analysis an export takes where the plain one is missing."""

from dataclasses import replace
import math

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.exports.numbers import Numbers
from msg_conversions.quantities import ANGULAR_VELOCITY, LINEAR_ACCELERATION
import pytest


@pytest.fixture(scope='module')
def result(recording_of, noise):
    """Return a still sensor with white noise."""
    return analyse(recording_of(noise(n=6000)))


def test_an_axis_that_was_not_recorded_takes_the_largest(result):
    axes = {name: axis for name, axis in result.axes.items() if name != 'angular_velocity.y'}
    numbers = Numbers(replace(result, axes=axes))
    x, y, z = numbers.per_axis(ANGULAR_VELOCITY, 'N')
    assert y.value == max(x.value, z.value)
    assert 'not recorded' in y.note


def test_a_sensor_that_blocks_slow_signals_has_the_density_of_its_plateau(result):
    bound = Estimate.not_observable('m/s²/√Hz', 'no white noise', high=1e-6)
    plateau = Estimate(3e-3, 2.9e-3, 3.1e-3, 'm/s²/√Hz')
    axes = {
        name: replace(
            axis,
            noise_density=bound.scaled(math.sqrt(2.0), bound.unit),
            noise_density_methods={'plateau': plateau},
            model=replace(axis.model, N=bound),
        )
        for name, axis in result.axes.items()
        if axis.quantity == 'linear_acceleration'
    }
    numbers = Numbers(replace(result, axes=axes))
    white = numbers.white_noise(LINEAR_ACCELERATION)
    assert white.value == pytest.approx(3e-3 / math.sqrt(2.0))
    assert 'plateau of the spectrum' in white.note
