# SPDX-License-Identifier: Apache-2.0
"""Rate and jitter of what was published."""

from imu_bench.acquisition.stats import error_of, IntervalMeter
from imu_bench.metrology.estimate import Estimate
import numpy as np
import pytest


def test_jitter_is_the_deviation_of_the_intervals():
    rng = np.random.default_rng(1)
    intervals = 1_000_000 + rng.normal(0, 5_000, 4000)
    stamps = 1_700_000_000_000_000_000 + np.cumsum(intervals).astype(np.int64)
    meter = IntervalMeter(1000.0)
    for block in np.array_split(stamps, 37):
        meter.add(block)
    jitter = meter.jitter()
    assert jitter.value == pytest.approx(np.diff(stamps).std(ddof=1) * 1e-9, rel=1e-6)
    assert jitter.low < 5e-6 < jitter.high


def test_a_gap_lowers_the_rate_and_is_no_jitter():
    stamps = np.arange(2000) * 1_000_000
    stamps[1000:] += 500_000_000
    meter = IntervalMeter(1000.0)
    meter.add(stamps)
    assert meter.delivered().value == pytest.approx(1999 / 2.499)
    assert meter.jitter().value == 0.0


def test_only_the_latest_seconds_count_and_memory_is_bounded():
    meter = IntervalMeter(100.0)
    for second in range(100):
        rate = 100 if second < 50 else 80
        meter.add(second * 1_000_000_000 + np.arange(rate) * (1_000_000_000 // rate))
    assert meter.delivered().value == pytest.approx(80.0, rel=0.01)
    assert len(meter._blocks) < 15


def test_before_there_are_data_nothing_is_claimed():
    meter = IntervalMeter(100.0)
    meter.add(np.array([], dtype=np.int64))
    meter.add(np.array([5]))
    assert not meter.delivered().observable
    assert not meter.jitter().observable
    rate = Estimate.not_observable('Hz', 'wait')
    assert not error_of(rate, 100.0).observable
