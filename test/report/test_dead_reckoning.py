# SPDX-License-Identifier: Apache-2.0
"""The error after a time is what integration of the samples themselves gives."""

from dataclasses import replace
import math

from imu_bench.metrology.allan import deviation
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.health.finding import Finding
from imu_bench.offline.presentation.sensor_tables import errors
from imu_bench.offline.presentation.uses import error_after
from imu_bench.samples import Samples
import numpy as np
import pytest

RATE_HZ = 100.0


@pytest.fixture(scope='module')
def result(recorded):
    rng, n = np.random.default_rng(5), 6000
    stamps = 1_700_000_000_000_000_000 + np.arange(n) * int(1e9 / RATE_HZ)
    samples = Samples(
        stamps, rng.normal([0.0, 0.0, 9.8], 0.02, (n, 3)), rng.normal(0.0, 1e-3, (n, 3))
    )
    return analyse(recorded(samples))


@pytest.mark.parametrize('walk', [0.0, 2e-5])
@pytest.mark.parametrize('seconds', [1.0, 10.0, 60.0])
def test_it_is_what_integration_gives(walk, seconds):
    """Each piece is integrated with the mean of the piece before as its bias."""
    rng = np.random.default_rng(3)
    n = 1_000_000
    rate = rng.normal(0.0, 1e-3, n) + np.cumsum(rng.normal(0.0, walk, n))
    length = round(seconds * RATE_HZ)
    means = rate[: n - n % length].reshape(-1, length).mean(axis=1)
    errors = np.diff(means) * seconds
    found = error_after(deviation(rate, RATE_HZ, unit='rad/s'), seconds, 'rad')
    assert found.unit == 'rad'
    assert math.sqrt(np.mean(errors**2)) == pytest.approx(found.value, rel=0.2)


def test_between_averaging_times():
    white = np.random.default_rng(1).normal(0.0, 1e-3, 100_000)
    curve = deviation(white, RATE_HZ, unit='rad/s')
    for seconds in (1.3, 2.9, 7.7):
        exact = math.sqrt(2.0 * seconds) * 1e-3 / math.sqrt(RATE_HZ)
        assert error_after(curve, seconds, 'rad').value == pytest.approx(exact, rel=0.05)
    assert error_after(curve, 1e-3, 'rad') is None
    assert error_after(curve, 1e4, 'rad') is None


def test_sensors_are_ranked_and_the_worst_axis_counts(result, monkeypatch):
    loud = replace(result, axes={name: _louder(axis) for name, axis in result.axes.items()})
    angle, speed = errors([loud, result], ['loud', 'quiet'])
    assert (angle.title.split()[0], {c.unit for c in angle.columns[1:]}) == ('Angle', {'°'})
    assert (speed.title.split()[0], {c.unit for c in speed.columns[1:]}) == ('Speed', {'mm/s'})
    assert [row[0] for row in angle.rows] == ['quiet', 'loud']
    assert [c.title for c in angle.columns[1:]] == ['1 s', '10 s']
    monkeypatch.setattr(AxisResult, 'shows_constants', False)
    assert errors([result], ['piezo']) == []


def test_a_sensor_that_moved_has_no_error_at_rest(result):
    finding = Finding('severe', 'motion', 'it moved', '', '')
    moved = replace(result, health=replace(result.health, findings=(finding,)))
    assert errors([moved], ['moved']) == []
    assert [row[0] for row in errors([moved, result], ['moved', 'still'])[0].rows] == ['still']


def _louder(axis):
    curve = axis.allan
    parts = {name: 3.0 * getattr(curve, name) for name in ('deviation', 'low', 'high')}
    return replace(axis, allan=replace(curve, **parts))
