# SPDX-License-Identifier: Apache-2.0
"""The sampling core: the chip's own pace, each sample once, however it is asked."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.samples import Samples
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.scenario import Sine, Still, Sum
from imu_bench.simulation.sensor_model import ErrorModel, Errors
import numpy as np
import pytest

SECOND = 1_000_000_000


def source(rate_hz=100.0, rate_error=0.0, start_ns=0, motion=None, **errors):
    model = ErrorModel({'acceleration': Errors(**errors), 'temperature': Errors()}, seed=1)
    return SensorSource(
        motion or Still(), model, rate_hz, rate_error=rate_error, start_ns=start_ns
    )


def test_samples_come_at_the_true_rate_and_not_the_nominal_one():
    made = source(1000.0, rate_error=0.03).samples_until(10 * SECOND)
    assert len(made) == 10_300
    np.testing.assert_allclose(np.diff(made.stamps), 1e9 / 1030, atol=1)


def test_a_rate_error_of_ppm_does_not_drift_from_rounding():
    start = 1_700_000_000 * SECOND
    chip = source(1344.0, rate_error=17e-6, start_ns=start)
    last = None
    for second in range(1, 200):
        last = chip.samples_until(start + second * SECOND).stamps[-1]
    count = int(199 * 1344.0 * (1 + 17e-6))
    assert last - start == pytest.approx(count * 1e9 / (1344.0 * (1 + 17e-6)), abs=1)


@given(asks=st.lists(st.integers(0, 700_000_000), min_size=1, max_size=10))
@settings(max_examples=40, deadline=None)
def test_every_sample_comes_once_however_it_is_asked(asks):
    chip = source(200.0, noise_density=1.0, bias_instability=0.1)
    parts = [chip.samples_until(t) for t in sorted(asks)]
    whole = source(200.0, noise_density=1.0, bias_instability=0.1).samples_until(max(asks))
    together = Samples.concatenate(parts)
    np.testing.assert_array_equal(together.stamps, whole.stamps)
    np.testing.assert_array_equal(together.acceleration, whole.acceleration)


def test_asking_for_the_past_gives_nothing():
    chip = source()
    chip.samples_until(SECOND)
    assert len(chip.samples_until(SECOND // 2)) == 0


def test_a_restart_skips_the_time_asleep_and_may_change_the_rate():
    chip = source(100.0)
    chip.samples_until(SECOND // 2)
    chip.restart(3 * SECOND, 50.0)
    made = chip.samples_until(4 * SECOND)
    assert (len(made), made.stamps[0], chip.rate_hz) == (50, 3 * SECOND + 20_000_000, 50.0)


def test_motion_is_sampled_where_the_chip_samples():
    moving = Sum((Still(temperature_c=31.0), Sine(1.0, 2.0)))
    made = source(100.0, rate_error=0.01, motion=moving).samples_until(SECOND)
    expected = moving.specific_force(made.stamps * 1e-9)
    np.testing.assert_allclose(made.acceleration, expected, rtol=1e-12)
    assert made.temperature[0] == 31.0


def test_a_rate_that_is_no_rate_is_refused():
    with pytest.raises(ConfigError, match='0 Hz'):
        source(0.0)
