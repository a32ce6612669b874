# SPDX-License-Identifier: Apache-2.0
"""Rolling metrics of one stream, without ROS."""

from imu_bench.metrology import allan
from imu_bench.nodes.live_analysis import LiveAnalysis
from msg_conversions.cdr import ImuBlock
import numpy as np
import pytest


def block(n, rate_hz=100.0, start_s=0.0, seed=1):
    rng = np.random.default_rng(seed)
    return ImuBlock(
        stamps=np.rint((start_s + np.arange(n) / rate_hz) * 1e9).astype(np.int64),
        acceleration=rng.normal(0.0, 0.02, (n, 3)),
        angular_velocity=rng.normal(0.0, 0.001, (n, 3)),
        acceleration_covariance=np.zeros(n),
        angular_velocity_covariance=np.zeros(n),
        frame_ids=('imu',),
    )


def parts(whole, size):
    """Cut a block into blocks."""
    for start in range(0, len(whole), size):
        cut = slice(start, start + size)
        columns = {k: v[cut] for k, v in vars(whole).items() if isinstance(v, np.ndarray)}
        yield ImuBlock(**columns, frame_ids=whole.frame_ids)


def test_nothing_is_given_before_the_rate_is_known():
    live = LiveAnalysis(60.0)
    assert live.result() is None
    assert live.reason == 'no samples yet'
    live.add(block(150))
    assert live.result() is None
    live.add(block(100, start_s=1.5))
    result = live.result()
    assert live.rate_hz == pytest.approx(100.0)
    assert result.window.samples == 250
    # the averaging times of the batch for so many samples, not those of a full window
    expected = allan.averaging_factors(250)
    assert result.curves['angular_velocity.z'].m.tolist() == expected.tolist()
    assert list(result.curves) == [
        f'{q}.{a}' for q in ('linear_acceleration', 'angular_velocity') for a in 'xyz'
    ]


def test_the_size_of_blocks_does_not_matter():
    whole = block(2000)
    results = []
    for size in (7, 130, 2000):
        live = LiveAnalysis(10.0)
        for part in parts(whole, size):
            live.add(part)
        results.append(live.result())
    for other in results[1:]:
        assert other.window.samples == results[0].window.samples
        for name, curve in results[0].curves.items():
            np.testing.assert_allclose(other.curves[name].deviation, curve.deviation, rtol=1e-9)


def test_a_sensor_at_another_rate_begins_anew():
    live = LiveAnalysis(60.0)
    for part in parts(block(1000), 10):
        live.add(part)
    for part in parts(block(4000, rate_hz=400.0, start_s=10.0), 40):
        live.add(part)
    assert live.restarts == 1
    assert live.rate_hz == pytest.approx(400.0, rel=1e-3)
    assert live.result().curves['linear_acceleration.x'].period == pytest.approx(1 / 400, rel=1e-3)


def test_stamps_that_stand_still_are_said():
    live = LiveAnalysis(60.0)
    stuck = block(100)
    stuck.stamps[:] = 5
    for _ in range(700):
        live.add(stuck)
    assert live.result() is None
    assert 'do not advance' in live.reason


def test_no_axis_with_numbers_is_said():
    live = LiveAnalysis(60.0)
    empty = block(300)
    empty.acceleration[:] = np.nan
    empty.angular_velocity_covariance[:] = -1.0
    live.add(empty)
    assert live.result() is None
    assert live.reason == 'no axis holds numbers'


def test_a_quantity_is_reported_as_the_covariance_says():
    live = LiveAnalysis(60.0)
    no_gyroscope = block(300)
    no_gyroscope.angular_velocity_covariance[:] = -1.0
    live.add(no_gyroscope)
    assert live.result().quantities == ('linear_acceleration',)
