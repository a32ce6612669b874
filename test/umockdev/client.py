# SPDX-License-Identifier: Apache-2.0
"""
A program that reads a sensor through unmodified smbus2 or python-periphery.

    client.py DRIVER DEVICE ADDRESS SAMPLES; prints what it found as JSON, or the error.
"""

import json
import sys

from imu_bench.acquisition import Acquisition
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.opening import open_bus
from imu_bench.drivers import load
from imu_bench.errors import BenchError
import numpy as np

PATIENCE_S = 300.0


def main(name, device, address, samples):
    """Read until there are so many samples."""
    driver = load(name)
    clock = SystemClock()
    buses = open_bus(device, driver.wiring, driver.bus_kinds, address=int(address, 16) or None)
    acquisition = Acquisition(driver(buses, clock, {}), clock, name=name)
    part = acquisition.prepare()
    acquisition.start()
    runs = []
    deadline = clock.now_ns() + round(PATIENCE_S * 1e9)
    while sum(map(len, runs)) < int(samples) and clock.now_ns() < deadline:
        clock.sleep(0.02)
        runs += [run for run in acquisition.drain() if run.acceleration is not None]
    stats = acquisition.stats
    acquisition.close()
    acceleration = np.concatenate([run.acceleration for run in runs] or [np.zeros((0, 3))])
    stamps = np.concatenate([run.stamps for run in runs] or [np.zeros(0)])
    return {
        'part': part,
        'libraries': sorted({'smbus2', 'periphery', 'serial'} & set(sys.modules)),
        'samples': len(stamps),
        'rising': bool((np.diff(stamps) > 0).all()),
        'acceleration': np.nanmean(acceleration[:, 2]),
        'error': stats.error,
        'bus_errors': stats.bus_errors,
        'failures': stats.failures,
        'counters': stats.counters,
    }


if __name__ == '__main__':
    try:
        print(json.dumps(main(*sys.argv[1:])))
    except BenchError as error:
        print(json.dumps({'kind': type(error).__name__, 'text': str(error)}))
