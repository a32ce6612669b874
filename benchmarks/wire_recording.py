# SPDX-License-Identifier: Apache-2.0
"""
What does it cost to record the wire of a sensor?

Every driver on every bus, against its emulated chip, a minute of simulated time with and without
`wire_recording`.  What the thread that reads spends more is given per sample and as a part of a
core at the rate of the sensor; compressing and writing are done by another thread.

Run as ``python -m benchmarks.wire_recording``.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
import time

from imu_bench import bench
from imu_bench.config import sensor_from_parameters
from imu_bench.drivers import load, names
from imu_bench.simulation.clock import SimulatedClock

SECONDS = 60
STEP_NS = 100_000_000
REPETITIONS = 3


def spent(driver: str, kind: str, path: str) -> tuple[float, float, int]:
    """Return seconds of this thread, of all threads, and samples."""
    given = {'driver': driver, 'backend': 'emulated', 'bus': kind, 'wire_recording': path}
    if driver == 'mtn1100':
        given |= {'converter': 'by bus', 'rate_hz': 0.0}
    clock = SimulatedClock()
    sensor = sensor_from_parameters('mine', given, settings_of=bench.settings_of)
    acquisition = bench.build(sensor, clock)
    here, everywhere = time.thread_time(), time.process_time()
    for _ in range(SECONDS * 10):
        acquisition.advance(clock.now_ns() + STEP_NS)
        acquisition.drain()
    here = time.thread_time() - here
    acquisition.finish()
    everywhere = time.process_time() - everywhere
    acquisition.close()
    return here, everywhere, acquisition.stats.samples


def main() -> None:
    print(f'{"":19}{"Hz":>6}{"thread":>16}{"of a core":>11}{"all threads":>16}{"file":>11}')
    with TemporaryDirectory() as folder:
        for driver in names():
            for kind in load(driver).bus_kinds:
                path = Path(folder) / f'{driver}_{kind}.wire'
                plain = [spent(driver, kind, '') for _ in range(REPETITIONS)]
                taped = [spent(driver, kind, str(path)) for _ in range(REPETITIONS)]
                samples = taped[0][2]
                here, everywhere = (
                    (min(one[k] for one in taped) - min(one[k] for one in plain)) / samples
                    for k in range(2)
                )
                rate_hz = samples / SECONDS
                print(
                    f'{driver:11}{kind:8}{rate_hz:6.0f}{here * 1e6:9.2f} µs each'
                    f'{100 * here * rate_hz:9.2f} %{everywhere * 1e6:9.2f} µs each'
                    f'{path.stat().st_size * 3600 / SECONDS / 1e6:6.0f} MB/h'
                )


if __name__ == '__main__':
    main()
