# SPDX-License-Identifier: Apache-2.0
"""
How much faster than time is the simulated bench?

One hour of the six sensors of Shabulinzenze 2020, some 17 million messages, into a bag and into
columns; then the cost of a sample of noise at the beginning of a recording and after many
hours, beside that of a common way to make flicker noise for a whole recording at once.
Prints ratios; timings decide nothing.  Run as ``python -m benchmarks.simulate [seconds]``.
"""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import sys
import tempfile
import time

import allantools
from imu_bench import bench
from imu_bench.config.location import named_file
from imu_bench.simulation.noise import Flicker, White
from imu_bench.simulation.recording import write_bag, write_columns
from imu_bench.simulation.scenario import load_scenario
import numpy as np

HOUR = 3600.0
WANTED = {'columns': 500.0, 'mcap': 60.0, 'sqlite3': None}
BLOCK = 1 << 13
PERIOD_S = 1e-3


def size(folder: Path) -> float:
    """Return GB in a folder."""
    return sum(file.stat().st_size for file in folder.rglob('*') if file.is_file()) / 1e9


def write(kind: str, duration_s: float, folder: Path) -> None:
    """Print one line of the table of formats."""
    scenario = load_scenario('still')
    config = bench.load_bench(named_file('benches', 'machine_vibration'))
    sensors = [bench.simulate(sensor, scenario) for sensor in config.sensors]
    path = folder / kind
    begun, used = time.perf_counter(), time.process_time()
    if kind == 'columns':
        counts = write_columns(path, sensors, scenario, duration_s)
    else:
        counts = write_bag(path, sensors, scenario, duration_s, storage=kind)
    took, used = time.perf_counter() - begun, time.process_time() - used
    wanted = WANTED[kind]
    print(
        f'| {kind} | {sum(counts.values()) / 1e6:.2f} M | {size(path):.2f} GB | {took:.1f} s '
        f'| {used / took:.1f} | {duration_s / took:.0f} | {wanted or "-"} |'
    )
    shutil.rmtree(path)


def cost(process: White | Flicker, samples: int) -> float:
    """Return ns per sample for the next samples of a process."""
    begun = time.perf_counter()
    for _ in range(0, samples, BLOCK):
        process.sample(BLOCK, PERIOD_S)
    return (time.perf_counter() - begun) / samples * 1e9


def growth() -> None:
    """Print what a sample costs at the beginning and later, and all at once."""
    count = 1 << 22
    print('\n| noise | first hour | sixth hour | whole hour at once (allantools, FFT) |')
    print('|---|---|---|---|')
    for name, process in (('white', White), ('flicker', Flicker)):
        made = process(1.0, np.random.default_rng(1))
        cost(made, BLOCK)
        first = cost(made, count)
        cost(made, 4 * count)
        later = cost(made, count)
        begun = time.perf_counter()
        (allantools.noise.white if name == 'white' else allantools.noise.pink)(count)
        whole = (time.perf_counter() - begun) / count * 1e9
        print(
            f'| {name} | {first:.1f} ns | {later:.1f} ns (x{later / first:.2f}) '
            f'| {whole:.1f} ns (x{whole / first:.1f}) |'
        )


def main(duration_s: float = HOUR) -> int:
    """Print the tables."""
    print(f'{duration_s:g} s of six sensors on {os.cpu_count()} cores\n')
    print('| written as | messages | size | time | cores used | times real time | wanted |')
    print('|---|---|---|---|---|---|---|')
    with tempfile.TemporaryDirectory(dir=os.environ.get('TMPDIR', '.')) as folder:
        for kind in WANTED:
            write(kind, duration_s, Path(folder))
    growth()
    return 0


if __name__ == '__main__':
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else HOUR))
