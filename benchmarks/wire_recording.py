# SPDX-License-Identifier: Apache-2.0
"""
What does it cost to record the wire of a sensor?

Every driver on every bus, against its emulated chip, a minute of simulated time with and without
`wire_recording`.  What the thread that reads spends more is given per sample and as a part of a
core at the rate of the sensor; compressing and writing are done by another thread.
"""

from __future__ import annotations

from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time

from imu_bench import bench
from imu_bench.config import sensor_from_parameters
from imu_bench.drivers import load, names
from imu_bench.simulation.clock import SimulatedClock

from benchmarks._frame import Benchmark

STEP_NS = 100_000_000

# what docs/wire_recordings.md tells users
CORE_PERCENT = 0.5
MB_PER_HOUR = 75.0


def spent(driver: str, kind: str, path: str, seconds: int) -> tuple[float, float, int]:
    """Return seconds of this thread, of all threads, and samples."""
    given: dict[str, object] = {
        'driver': driver,
        'backend': 'emulated',
        'bus': kind,
        'wire_recording': path,
    }
    if driver == 'mtn1100':
        given |= {'converter': 'by bus', 'rate_hz': 0.0}
    clock = SimulatedClock()
    sensor = sensor_from_parameters('mine', given, settings_of=bench.settings_of)
    acquisition = bench.build(sensor, clock)
    here, everywhere = time.thread_time(), time.process_time()
    for _ in range(seconds * 10):
        acquisition.advance(clock.now_ns() + STEP_NS)
        acquisition.drain()
    here = time.thread_time() - here
    acquisition.finish()
    everywhere = time.process_time() - everywhere
    acquisition.close()
    return here, everywhere, acquisition.stats.samples


def main() -> int:
    run = Benchmark(__doc__)
    run.add_size('--seconds', 60, quick=1, help='of each sensor')
    run.add_size('--repetitions', 3, quick=1, help='of each measurement; the least counts')
    options = run.start()
    columns = 'µs per sample', '% of a core', 'µs of all threads', 'MB per hour'
    run.head('sensor', 'bus', 'rate Hz', *columns)
    most_core = most_mb = 0.0
    with TemporaryDirectory() as folder:
        for driver in names():
            for kind in load(driver).bus_kinds:
                path = Path(folder) / f'{driver}_{kind}.wire'
                plain, taped = (
                    [spent(driver, kind, to, options.seconds) for _ in range(options.repetitions)]
                    for to in ('', str(path))
                )
                samples = taped[0][2]
                here, everywhere = (
                    (min(one[k] for one in taped) - min(one[k] for one in plain)) / samples
                    for k in range(2)
                )
                rate_hz = samples / options.seconds
                core = 100 * here * rate_hz
                mb = path.stat().st_size * 3600 / options.seconds / 1e6
                most_core, most_mb = max(most_core, core), max(most_mb, mb)
                cells = f'{rate_hz:.0f}', f'{here * 1e6:.2f}', f'{core:.2f}'
                run.row(driver, kind, *cells, f'{everywhere * 1e6:.2f}', f'{mb:.0f}')
    run.claim('most that a sensor costs', most_core, at_most=CORE_PERCENT, unit='% of a core')
    run.claim('largest file', most_mb, at_most=MB_PER_HOUR, unit='MB per hour')
    return run.done()


if __name__ == '__main__':
    sys.exit(main())
