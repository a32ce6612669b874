# SPDX-License-Identifier: Apache-2.0
"""Simulated time."""

from imu_bench.errors import ConfigError
from imu_bench.simulation.clock import SimulatedClock
import pytest


def test_who_waits_moves_the_time():
    clock = SimulatedClock(100)
    clock.sleep_until(500)
    clock.sleep(1e-6)
    assert clock.now_ns() == 1500


def test_it_never_steps_backwards():
    clock = SimulatedClock(1000)
    clock.sleep_until(10)
    assert clock.now_ns() == 1000
    with pytest.raises(ConfigError, match='-1'):
        clock.sleep(-1)
