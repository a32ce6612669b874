# SPDX-License-Identifier: Apache-2.0
"""The sampling core: the chip's own pace, each sample once, however it is asked."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import ConfigError
from imu_bench.samples import Samples
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.motion import Still, Sum
from imu_bench.simulation.random_vibration import RandomVibration
from imu_bench.simulation.sensor_errors import Errors
from imu_bench.simulation.sensor_model import ErrorModel
from imu_bench.simulation.tones import Sine
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
    np.testing.assert_allclose(made.acceleration, expected, atol=1e-7)
    assert made.temperature[0] == 31.0


def test_a_rate_that_is_no_rate_is_refused():
    with pytest.raises(ConfigError, match='0 Hz'):
        source(0.0)


def test_random_vibration_far_above_nyquist_folds_back_with_the_power_the_filter_leaves():
    shaken = RandomVibration((0.01, 0.0, 0.0), 200.0, 2000.0, seed=1)
    made = source(119.0, motion=shaken, low_pass=50.0).samples_until(200 * SECOND)
    # S fc (atan(f2/fc) - atan(f1/fc)): the power behind a first-order low-pass
    power = 0.01 * 50.0 * (math.atan(40.0) - math.atan(4.0))
    assert made.acceleration[100:, 0].var() == pytest.approx(power, rel=0.05)
    unfiltered = source(119.0, motion=shaken).samples_until(100 * SECOND)
    assert unfiltered.acceleration[:, 0].var() == pytest.approx(18.0, rel=0.05)


def test_a_tone_passes_the_low_pass_as_the_analogue_one_and_late():
    tone = Sine(1.0, 20.0, 'x')
    made = source(200.0, motion=tone, low_pass=20.0).samples_until(20 * SECOND)
    t = made.stamps * 1e-9
    response = 2j * np.mean((made.acceleration[:, 0] * np.exp(-2j * np.pi * 20.0 * t))[400:])
    assert abs(response) == pytest.approx(math.sqrt(0.5), rel=0.03)
    # 45 degrees behind at the corner
    assert np.angle(response) == pytest.approx(-math.pi / 4, abs=0.02)


def test_hours_are_handed_out_in_one_request_or_in_many():
    whole = source(20.0, noise_density=1.0).samples_until(2000 * SECOND)
    chip = source(20.0, noise_density=1.0)
    parts = Samples.concatenate([chip.samples_until(t * 10 * SECOND) for t in range(1, 201)])
    assert len(whole) == 40_000
    np.testing.assert_array_equal(whole.stamps, parts.stamps)
    np.testing.assert_array_equal(whole.acceleration, parts.acceleration)
