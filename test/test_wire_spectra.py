# SPDX-License-Identifier: Apache-2.0
"""A chip on an emulated wire has the spectrum that the simulation of its sensor has."""

from imu_bench import bench, drivers
from imu_bench.config.location import named_file
from imu_bench.simulation.clock import SimulatedClock, START_NS
from imu_bench.simulation.scenario import load_scenario
import numpy as np
import pytest
from scipy import signal

SECONDS = 25.0
SETTLED_S = 1.0
BANDS = ((0.05, 0.3), (0.3, 0.6), (0.6, 0.85), (0.9, 0.99))
"""In half sample rates."""


def on_the_wire(sensor):
    """Return what its driver reads from an emulated chip."""
    clock = SimulatedClock()
    made_by = drivers.load(sensor.driver)
    buses = bench.emulated_buses(sensor, clock)
    clock.sleep(made_by.start_up_s)
    driver = made_by(buses, clock, sensor.settings)
    driver.configure()
    driver.start()
    due, runs = clock.now_ns(), []
    end = due + round((SECONDS + SETTLED_S) * 1e9)
    while due < end:
        due += round(driver.poll_period_s * 1e9)
        clock.sleep_until(due)
        runs += [run for run in driver.read() if run.acceleration is not None]
    return runs


def levels(values, rate_hz):
    """Return the noise density of the axes together in each band."""
    frequency, density = signal.welch(values, rate_hz, nperseg=256, axis=0)
    share = frequency / (rate_hz / 2.0)
    return np.array(
        [np.sqrt(density[(share > low) & (share < high)].mean()) for low, high in BANDS]
    )


@pytest.mark.parametrize(
    'name', ['lsm9ds1', 'mpu9250', 'bno055', 'iim42652', 'adxl355', 'scl3300', 'mti300']
)
def test_the_spectrum_on_the_wire_is_the_simulated_one_up_to_half_the_rate(name):
    sensor = bench.load_sensor(named_file('sensors', name))
    source = bench.simulate(sensor, load_scenario('still')).sources[0]
    simulated = source.samples_until(START_NS + round(SECONDS * 1e9))
    runs = on_the_wire(sensor)
    for quantity in ('acceleration', 'angular_velocity'):
        expected = getattr(simulated, quantity)
        if expected is None:
            continue
        read = np.concatenate([getattr(run, quantity) for run in runs])
        read = read[round(SETTLED_S * source.rate_hz) :]
        ratio = levels(read, source.rate_hz) / levels(expected, source.rate_hz)
        np.testing.assert_allclose(ratio, 1.0, atol=0.12, err_msg=quantity)
