# SPDX-License-Identifier: Apache-2.0
"""Bias against temperature: what goes in comes out, with intervals that hold."""

from imu_bench.errors import DataError
from imu_bench.metrology.trials import thermal
from imu_bench.metrology.trials.warm_up import warm_up
import numpy as np
import pytest

TIME = np.arange(0.0, 3500.0, 0.5)
OVEN = np.interp(TIME, [600.0, 1450.0, 2650.0, 3500.0], [23.0, 80.0, 80.0, 23.0])
COEFFICIENT = 1.5e-3


def drifting(seed, *, white=0.01, walk=2e-5):
    rng = np.random.default_rng(seed)
    wander = np.cumsum(rng.normal(0.0, walk, TIME.size))
    return rng.normal(0.0, white, TIME.size) + wander


def test_phases_of_an_oven():
    found = thermal.phases(TIME, OVEN)
    assert found.heating == pytest.approx(600.0, abs=10.0)
    assert (found.hot, found.cooling) == pytest.approx((1450.0, 2650.0), abs=60.0)
    assert found.cooled


@pytest.mark.slow
def test_coefficient_and_hysteresis_lie_in_their_intervals_as_often_as_stated():
    inside = closed = 0
    for seed in range(100):
        data = 0.3 + COEFFICIENT * (OVEN - 25.0) + drifting(seed)
        found = thermal.analyse(TIME, data, OVEN, 'm/s²')
        inside += found.coefficient.low < COEFFICIENT < found.coefficient.high
        closed += found.hysteresis.low < 0.0 < found.hysteresis.high
    # 95 of 100 with a binomial scatter of 2.2
    assert 88 <= inside <= 100
    assert 88 <= closed <= 100


def test_ordinary_least_squares_would_promise_too_much():
    """The interval under a random walk is several times that for independent residuals."""
    data = COEFFICIENT * OVEN + drifting(1, white=1e-3, walk=5e-5)
    found = thermal.analyse(TIME, data, OVEN, 'm/s²').coefficient
    held = thermal.averages(TIME, data, OVEN)
    off = held.temperature - held.temperature.mean()
    left = held.bias - held.bias.mean() - found.value * off
    naive = 1.96 * left.std() / np.sqrt(off @ off)
    assert found.high - found.value > 2.0 * naive


def test_a_loop_comes_out_as_hysteresis():
    cooling = TIME > 2600.0
    loop = 0.02 * (1.0 - ((OVEN - 51.5) / 28.5) ** 2) * cooling
    found = thermal.analyse(TIME, COEFFICIENT * OVEN + loop + drifting(3), OVEN, 'm/s²')
    assert found.hysteresis.low < 0.02 < found.hysteresis.high
    assert found.hysteresis.low > 0.015
    widest = max(found.branches, key=lambda branch: branch[1].value)
    assert 40.0 < widest[0] < 63.0
    assert len(found.branches) == thermal.BINS


def test_a_parabola_comes_out_as_curvature():
    share = (OVEN - 51.5) / 28.5
    found = thermal.analyse(TIME, 0.05 * share**2 + drifting(4), OVEN, 'm/s²')
    assert found.curvature.low < 0.05 < found.curvature.high


def test_end_points():
    data = COEFFICIENT * OVEN + 1e-5 * TIME + drifting(5, walk=0.0)
    found = thermal.analyse(TIME, data, OVEN, 'm/s²')
    at_the_end = COEFFICIENT * float(OVEN[-140:].mean() - 23.0)
    assert found.change.value == pytest.approx(0.0343 + at_the_end, abs=2e-3)
    assert found.change_hot.value == pytest.approx(57.0 * COEFFICIENT, rel=0.35)
    assert found.warm_up.low < 0.0054 < found.warm_up.high


def test_what_cannot_be_seen_is_said():
    half = OVEN[TIME < 2000.0]
    data = COEFFICIENT * half
    found = thermal.analyse(TIME[: half.size], data, half, 'm/s²')
    assert 'does not come back' in found.hysteresis.reason
    assert found.branches == ()
    late = TIME > 580.0
    found = thermal.analyse(TIME[late], OVEN[late], OVEN[late], 'm/s²')
    assert 'wait 10 min' in found.warm_up.reason
    with pytest.raises(DataError, match='changes by 2 K only'):
        thermal.analyse(TIME, OVEN, 20.0 + 2.0 * (OVEN - 23.0) / 57.0, 'm/s²')
    with pytest.raises(DataError, match='too short'):
        thermal.analyse(TIME[:20], OVEN[:20], OVEN[:20], 'm/s²')


def test_gravity_costs_no_digits():
    data = COEFFICIENT * (OVEN - 25.0)
    level = thermal.analyse(TIME, data, OVEN, 'm/s²').coefficient.value
    raised = thermal.analyse(TIME, 9.80665 + data, OVEN, 'm/s²').coefficient.value
    assert raised == pytest.approx(level, rel=1e-9)


def test_gaps_cost_no_more_than_what_is_missing():
    """A hole of a quarter of the time, and single averages that nobody recorded."""
    data = COEFFICIENT * OVEN + drifting(6)
    there = ((TIME < 900.0) | (TIME > 1750.0)) & (TIME % 500.0 > 20.0)
    found = thermal.analyse(TIME[there], data[there], OVEN[there], 'm/s²')
    whole = thermal.analyse(TIME, data, OVEN, 'm/s²')
    assert found.coefficient.low < COEFFICIENT < found.coefficient.high
    wider = np.ptp([found.coefficient.low, found.coefficient.high])
    assert wider < 1.6 * np.ptp([whole.coefficient.low, whole.coefficient.high])
    mostly = TIME % 500.0 < 30.0
    with pytest.raises(DataError, match='most of the recording is missing'):
        thermal.analyse(TIME[mostly], data[mostly], OVEN[mostly], 'm/s²')


def test_warm_up_is_not_seen_where_there_is_none():
    found = warm_up(TIME, np.full(TIME.size, 23.0), 600.0)
    assert 'changes by 0 K only' in found.rise.reason
    assert 'before it is heated' in warm_up(TIME, OVEN, 30.0).time_constant.reason
