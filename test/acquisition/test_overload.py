# SPDX-License-Identifier: Apache-2.0
"""A host that is late again and again: what it missed is counted as what the chip made."""

from imu_bench import drivers
from imu_bench.acquisition import Acquisition
from imu_bench.bench import emulated_buses, load_sensor
from imu_bench.config.location import config_file
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

SECOND = 1_000_000_000
RATES_HZ = {'lsm9ds1': 952.0 * 0.988, 'lsm303dlhc': 1344.0 * 1.02, 'bno055': 100.0 * 1.001}
"""What the emulated chips make, with the error of their oscillators in `config/sensors`."""


class LateClock(SimulatedClock):
    """While it is busy, some waits end late: between two readings, or in the midst of one."""

    def __init__(self, chance, mean_s):
        super().__init__()
        self._rng = np.random.default_rng(1)
        self._chance, self._mean_ns = chance, mean_s * 1e9
        self.busy = False

    def sleep_until(self, deadline_ns):
        super().sleep_until(deadline_ns)
        if self.busy and self._rng.random() < self._chance:
            late_ns = round(self._rng.exponential(self._mean_ns))
            super().sleep_until(self.now_ns() + late_ns)


@pytest.mark.slow
@pytest.mark.parametrize('name', RATES_HZ)
@pytest.mark.parametrize(('chance', 'mean_s'), [(0.05, 0.03), (0.2, 0.01)])
def test_what_was_lost_under_overload_is_counted(name, chance, mean_s):
    sensor = load_sensor(config_file(f'sensors/{name}.yaml'))
    clock = LateClock(chance, mean_s)
    driver = drivers.load(name)
    buses = emulated_buses(sensor, clock)
    clock.sleep(driver.start_up_s)
    acquisition = Acquisition(driver(buses, clock, sensor.settings), clock)

    def run(seconds):
        taken, end_ns = 0, clock.now_ns() + round(seconds * SECOND)
        while clock.now_ns() < end_ns:
            acquisition.advance(clock.now_ns() + SECOND // 2)
            taken += sum(len(r) for r in acquisition.drain() if r.acceleration is not None)
        return taken

    run(10.0)
    assert acquisition.stats.lost == 0
    began_ns = clock.now_ns()
    clock.busy = True
    taken = run(15.0)
    clock.busy = False
    taken += run(5.0)
    made = (clock.now_ns() - began_ns) * 1e-9 * RATES_HZ[name]
    # a burst more or less lies between two looks; a chip that overwrites its samples is read
    # too seldom for certainty
    near = 0.02 if driver.name == 'bno055' else 0.004
    assert acquisition.stats.lost == pytest.approx(made - taken, rel=near, abs=12)
    assert made - taken > 0.01 * made
    # nothing is counted any more once the host has time again
    before = acquisition.stats.lost
    run(5.0)
    assert acquisition.stats.lost == before
