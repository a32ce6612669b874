# SPDX-License-Identifier: Apache-2.0
"""What a script of faults costs: the counts told live are what the stamps say afterwards."""

from imu_bench import bench
from imu_bench.acquisition import FaultWatch
from imu_bench.config import sensor_from_parameters
from imu_bench.metrology.stamps import timing
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

IN_FLIGHT = 1
STEP_NS = 20_000_000


def test_what_goes_out_at_once_after_a_recovery_is_at_most_a_little_over_a_second():
    """Publishers keep three times that: `imu_bench.nodes.sensor_topics.HISTORY_S`."""
    parameters = {
        'driver': 'mtn1100', 'backend': 'emulated', 'simulation.faults': ['unplugged 2 0.5']
    }  # fmt: skip
    config = sensor_from_parameters('mtn1100', parameters, settings_of=bench.settings_of)
    clock = SimulatedClock()
    begin_ns = clock.now_ns()
    acquisition = bench.build(config, clock, switched_on_ns=begin_ns)
    largest = 0
    while (now_ns := clock.now_ns()) < begin_ns + 6_000_000_000:
        acquisition.advance(now_ns + STEP_NS)
        largest = max(largest, sum(len(run) for run in acquisition.drain()))
    rate_hz = acquisition.stats.nominal_hz
    # more than a second: with a history of one the first of them never reached a recorder
    assert rate_hz < largest < 1.5 * rate_hz


@pytest.mark.slow
def test_losses_by_fault_add_up_to_the_counter_and_to_what_the_stamps_miss():
    faults = ['half_frame 3', 'garbage 7 0.5', 'wrong_identity 12 1']
    parameters = {'driver': 'mti300', 'backend': 'emulated', 'simulation.faults': faults}
    config = sensor_from_parameters('mti300', parameters, settings_of=bench.settings_of)
    clock = SimulatedClock()
    begin_ns = clock.now_ns()
    acquisition = bench.build(config, clock, switched_on_ns=begin_ns)
    watch = FaultWatch(bench.faults_of(config), begin_ns)
    stamps = [np.empty(0, np.int64)]
    while (now_ns := clock.now_ns()) < begin_ns + 18_000_000_000:
        acquisition.advance(now_ns + STEP_NS)
        stamps += [run.stamps for run in acquisition.drain() if run.acceleration is not None]
        watch.look(
            clock.now_ns(), acquisition.stats, int(stamps[-1][-1]) if len(stamps) > 1 else 0
        )
    told = acquisition.stats.lost
    acquisition.finish()
    stamps += [run.stamps for run in acquisition.drain() if run.acceleration is not None]

    assert [aftermath.state for aftermath in watch.aftermaths] == ['recovered'] * 3
    assert sum(aftermath.lost for aftermath in watch.aftermaths) == told
    assert told > 600
    assert abs(told - timing.analyse(np.concatenate(stamps)).missing) <= IN_FLIGHT
