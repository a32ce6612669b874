# SPDX-License-Identifier: Apache-2.0
"""Rolling metrics of one stream, without ROS."""

from imu_bench.metrology import allan
from imu_bench.nodes.live_analysis import LiveAnalysis
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.settings import Settings
from imu_bench.samples import Samples
import numpy as np
import pytest

from benchmarks._analyzed import recording


def block(n, rate_hz=100.0, start_s=0.0, seed=1):
    rng = np.random.default_rng(seed)
    return Samples(
        stamps=np.rint((start_s + np.arange(n) / rate_hz) * 1e9).astype(np.int64),
        acceleration=rng.normal(0.0, 0.02, (n, 3)),
        angular_velocity=rng.normal(0.0, 0.001, (n, 3)),
    )


def parts(whole, size):
    """Cut a run into runs."""
    return [whole[start : start + size] for start in range(0, len(whole), size)]


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
    stuck = block(100).restamped(np.full(100, 5))
    for _ in range(700):
        live.add(stuck)
    assert live.result() is None
    assert 'do not advance' in live.reason


def test_no_axis_with_numbers_is_said():
    live = LiveAnalysis(60.0)
    live.add(Samples(block(300).stamps, acceleration=np.full((300, 3), np.nan)))
    assert live.result() is None
    assert live.reason == 'no axis holds numbers'


def test_a_quantity_that_is_not_reported_has_no_metrics():
    live = LiveAnalysis(60.0)
    run = block(300)
    live.add(Samples(run.stamps, acceleration=run.acceleration))
    assert live.result().quantities == ('linear_acceleration',)


def test_a_quantity_that_is_not_reported_any_more_is_a_gap():
    live = LiveAnalysis(60.0)
    run = block(600)
    live.add(run[:300])
    live.add(Samples(run.stamps[300:400], acceleration=run.acceleration[300:400]))
    live.add(run[400:])
    window = live.result().window
    assert (window.samples, window.missing, window.left_out) == (500, 100, 100)


def test_a_result_is_worth_its_time_when_a_hundredth_of_the_window_is_new():
    live = LiveAnalysis(20.0)
    assert live.refresh_s == 0.0
    whole = block(3000)
    live.add(whole[:1000])
    live.result()
    assert live.refresh_s == pytest.approx(0.1, rel=0.01)
    live.add(whole[1000:])
    live.result()
    assert live.refresh_s == pytest.approx(0.2, rel=0.01)


def test_outliers_of_the_window_are_counted_as_offline():
    """They are in the live metrics, and not in those of `imu-bench analyze`: N differs by 20 %."""
    made = block(6000, seed=4)
    turned = made.angular_velocity.copy()
    rng = np.random.default_rng(5)
    at = np.sort(rng.choice(np.arange(10, 5990, 10), 12, replace=False))
    turned[at, 0] += 20.0 * turned[:, 0].std()
    whole = Samples(made.stamps, made.acceleration, turned)
    live = LiveAnalysis(30.0)
    for part in parts(whole, 130):
        live.add(part)
    result = live.result()
    inside = np.count_nonzero(whole.stamps[at] >= result.window.start_ns)
    assert 0 < inside < 12
    assert result.outliers == inside
    settings = Settings(window_ns=(result.window.start_ns, result.window.end_ns))
    offline = analyse(recording(whole), settings)
    assert offline.health.spikes['angular_velocity.x'].single.size == inside
    found = offline.axes['angular_velocity.x'].noise_density
    with_them = result.metrics['noise_density']['angular_velocity.x']
    assert with_them.value > 1.02 * found.value
    clean = result.metrics['noise_density']['angular_velocity.y']
    again = offline.axes['angular_velocity.y'].noise_density
    assert clean.value == pytest.approx(again.value, rel=1e-9)
