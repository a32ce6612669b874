# SPDX-License-Identifier: Apache-2.0
"""
How much faster than time is the simulated bench?

One hour of the six sensors of Shabulinzenze 2020, some 17 million messages, into a bag and into
columns; then the cost of a sample of noise at the beginning of a recording and after five times
as many, beside that of a common way to make flicker noise for a whole recording at once.
"""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import sys
import tempfile
import time

import allantools
from imu_bench.bench import load_bench, simulate
from imu_bench.config.location import named_file
from imu_bench.simulation.noise import Flicker, White
from imu_bench.simulation.recording import write_bag, write_columns
from imu_bench.simulation.scenario import load_scenario
import numpy as np

from benchmarks._frame import Benchmark
from benchmarks._measured import gigabytes

TIMES_REAL_TIME = {'columns': 500.0, 'mcap': 60.0, 'sqlite3': 0.0}
"""Asked of each format; none of sqlite3, which is as fast as its library."""

GROWTH = 1.5
"""Times as dear a later sample may be; a cost that grows with what was made would be far above."""

BLOCK = 1 << 13
PERIOD_S = 1e-3


def write(bench: Benchmark, kind: str, duration_s: float, folder: Path) -> None:
    """Write one recording."""
    scenario = load_scenario('still')
    config = load_bench(named_file('benches', 'machine_vibration'))
    sensors = [simulate(sensor, scenario) for sensor in config.sensors]
    path = folder / kind
    begun, used = time.perf_counter(), time.process_time()
    if kind == 'columns':
        counts = write_columns(path, sensors, scenario, duration_s)
    else:
        counts = write_bag(path, sensors, scenario, duration_s, storage=kind)
    took, used = time.perf_counter() - begun, time.process_time() - used
    messages, ratio = f'{sum(counts.values()) / 1e6:.2f} M', duration_s / took
    cells = f'{gigabytes(path):.2f} GB', f'{took:.1f} s', f'{used / took:.1f}', f'{ratio:.0f}'
    bench.row(kind, messages, *cells)
    if wanted := TIMES_REAL_TIME[kind]:
        bench.claim(f'{kind}: times real time', ratio, at_least=wanted)
    shutil.rmtree(path)


def cost(process: White | Flicker, samples: int) -> float:
    """Return ns per sample for the next samples of a process."""
    begun = time.process_time()
    for _ in range(0, samples, BLOCK):
        process.sample(BLOCK, PERIOD_S)
    return (time.process_time() - begun) / samples * 1e9


def growth(bench: Benchmark, count: int) -> None:
    """Show what a sample costs at the beginning and later, and all at once."""
    bench.head('noise', 'first', 'later', 'all at once (allantools, FFT)', title='ns per sample')
    for process, whole in ((White, allantools.noise.white), (Flicker, allantools.noise.pink)):
        made = process(1.0, np.random.default_rng(1))
        cost(made, BLOCK)
        first = cost(made, count)
        cost(made, 4 * count)
        later = cost(made, count)
        begun = time.process_time()
        whole(count)
        at_once = (time.process_time() - begun) / count * 1e9
        name = process.__name__.lower()
        bench.row(name, f'{first:.1f}', f'{later:.1f}', f'{at_once:.1f} (x{at_once / first:.2f})')
        bench.claim(f'{name} noise: later sample over first', later / first, at_most=GROWTH)


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--seconds', 3600.0, quick=10.0, help='simulated time')
    bench.add_size('--noise', 1 << 22, quick=1 << 18, help='samples of noise that are timed')
    options = bench.start()
    bench.head('written as', 'messages', 'size', 'time', 'cores used', 'times real time')
    with tempfile.TemporaryDirectory(dir=os.environ.get('TMPDIR', '.')) as folder:
        for kind in TIMES_REAL_TIME:
            write(bench, kind, options.seconds, Path(folder))
    growth(bench, options.noise)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
