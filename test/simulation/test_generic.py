# SPDX-License-Identifier: Apache-2.0
"""The sensor without a chip."""

from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.clock import SimulatedClock
from imu_bench.simulation.generic import GenericSensor
from imu_bench.simulation.motion import Still
from imu_bench.simulation.sensor_errors import Errors
from imu_bench.simulation.sensor_model import ErrorModel


def sensor():
    clock = SimulatedClock(0)
    model = ErrorModel({'acceleration': Errors()})
    made = GenericSensor(
        SensorSource(Still(), model, 100.0, start_ns=0), clock, {'title': 'Mine', 'rate_hz': 100.0}
    )
    return made, clock


def test_it_hands_over_what_came_since_it_was_asked_last():
    made, clock = sensor()
    assert made.identify() == 'Mine'
    made.configure()
    made.start()
    clock.sleep(0.1)
    (first,) = made.read()
    clock.sleep(0.025)
    (second,) = made.read()
    assert (len(first), len(second)) == (10, 2)
    assert second.stamps.tolist() == [115_000_000, 125_000_000]
    made.stop()
    made.close()


def test_a_consumer_that_sleeps_through_a_second_loses_samples_and_is_told():
    made, clock = sensor()
    made.start()
    before = made.continuity
    clock.sleep(1.5)
    (run,) = made.read()
    assert len(run) == 100
    assert made.continuity == before + 1
    assert made.counters['fifo_overflows'] == 1
