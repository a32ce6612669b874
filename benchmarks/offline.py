# SPDX-License-Identifier: Apache-2.0
"""
How fast is `imu-bench analyze`, side by side with the script a user would write today?

Prints ratios measured in one run; they, not the seconds, are the claim.  The script is
`benchmarks/_todays_script.py`: a rosbags loop into numpy, then allantools with the same
averaging times.  Run as ``python -m benchmarks.offline [--minutes M] [--folder DIR]`` on an
otherwise idle machine; it needs 4 GB of disk and some minutes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

# as `imu-bench` does it: the processes are the threads; read when numpy is imported
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.recordings.cache import columns

from benchmarks import _todays_script
from benchmarks._bags import write_bag
from benchmarks._measured import Measured, run

GIB = 1 << 30
SHORT_MINUTES = 2.0
REPEATS = 3
IMU_BENCH = [sys.executable, '-m', 'imu_bench.cli.main']


def best(work: Callable[[], float], repeats: int = REPEATS) -> float:
    """Return the shortest of some durations in s: what others on the machine disturb least."""
    return min(work() for _ in range(repeats))


def timed(work: Callable[[], object]) -> float:
    """Return how long a piece of work takes, in s."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def bag(folder: Path, minutes: float, storage: str = 'mcap', compression: str = 'zstd') -> Path:
    """Return a bag of six sensors at 1 kHz, made if it is not there."""
    path = folder / f'{storage}_{compression}_{minutes:g}min'
    if not path.exists():
        write_bag(path, duration_s=60.0 * minutes, storage=storage, compression=compression)
    return path


def read_columns(path: Path) -> int:
    """Return the number of samples that our reader brings into columns."""
    with columns(path, ReadOptions()) as read:
        return sum(map(len, read.recordings))


def reading(folder: Path) -> list[tuple[str, float, float]]:
    """Return name, ratio and what is asked for each storage format."""
    rows = []
    print(f'## bag to columns, {SHORT_MINUTES:g} min of six interleaved topics at 1 kHz\n')
    print('| storage | rosbags loop, µs per message | ours | times faster | asked |')
    print('|---|---|---|---|---|')
    for storage, compression, asked in (
        ('mcap', 'zstd', 40.0), ('mcap', '', 40.0), ('sqlite3', '', 9.0),
    ):  # fmt: skip
        path = bag(folder, SHORT_MINUTES, storage, compression)
        count = read_columns(path)
        ours = best(lambda p=path: timed(lambda: read_columns(p)), 5)
        theirs = timed(lambda p=path: _todays_script.read(p))
        name = f'{storage}, {compression or "not compressed"}'
        ratio = theirs / ours
        print(
            f'| {name} | {1e6 * theirs / count:.2f} | {1e6 * ours / count:.3f} | {ratio:.0f} '
            f'| {asked:.0f} |'
        )
        rows.append((f'{name}: times faster than the rosbags loop', ratio, asked))
    return rows


def analyse(path: Path, folder: Path) -> Measured:
    """Run `imu-bench analyze` with a JSON document and a report, and measure it."""
    command = [
        *IMU_BENCH, 'analyze', str(path), '--cache', 'none',
        '--json', str(folder / 'results.json'), '--html', str(folder / 'report.html'),
    ]  # fmt: skip
    return run(command, stdout=subprocess.DEVNULL)


def script(path: Path, folder: Path) -> Measured:
    """Run the script on the averaging times of our result."""
    results = json.loads((folder / 'results.json').read_text(encoding='utf-8'))
    tau = next(iter(results['recordings'][0]['axes'].values()))['allan']['tau']
    command = [sys.executable, '-m', 'benchmarks._todays_script', str(path)]
    return run([*command, str(folder / 'script.json'), ','.join(map(str, tau))])


def main(minutes: float, folder: Path) -> int:
    """Print the tables; return 1 if a claim does not hold."""
    cores = len(os.sched_getaffinity(0))
    print(f'cores: {cores}, load before: {os.getloadavg()[0]:.1f}\n')
    at_least = reading(folder)

    short, long = bag(folder, minutes), bag(folder, 10.0 * minutes)
    ours = [analyse(short, folder) for _ in range(REPEATS)]
    shortest = min(measured.seconds for measured in ours)
    theirs = script(short, folder)
    far = analyse(long, folder)
    start_up = best(lambda: timed(lambda: run([*IMU_BENCH, '--help'], stdout=subprocess.DEVNULL)))
    print(f'\n## whole analysis with report, six sensors at 1 kHz, {minutes:g} min\n')
    print('| | s | memory, MiB |')
    print('|---|---|---|')
    rows = (
        ('script: rosbags loop and allantools, no report', theirs),
        ('imu-bench analyze', Measured(shortest, max(m.peak for m in ours))),
        (f'imu-bench analyze, {10 * minutes:g} min', far),
    )
    for name, measured in rows:
        print(f'| {name} | {measured.seconds:.2f} | {measured.peak / 2**20:.0f} |')
    at_least.append(('whole analysis: times faster', theirs.seconds / shortest, 15.0))
    at_most = (
        ('time for ten times the length', far.seconds / shortest, 10.0),
        ('peak memory of all processes in GiB', max(m.peak for m in ours) / GIB, 1.0),
        ('the same for ten times the length', far.peak / GIB, 1.0),
        ('imu-bench --help in s', start_up, 0.3),
    )
    print('\n| claim | measured | asked |\n|---|---|---|')
    good = True
    for name, value, asked in at_least:
        good &= value >= asked
        print(f'| {name} | {value:.1f} | ≥ {asked:g} |')
    for name, value, asked in at_most:
        good &= value <= asked
        print(f'| {name} | {value:.2g} | ≤ {asked:g} |')
    return 0 if good else 1


if __name__ == '__main__':
    parser = argparse.ArgumentParser()
    parser.add_argument('--minutes', type=float, default=10.0)
    parser.add_argument('--folder', type=Path, help='keep the bags there for the next time')
    arguments = parser.parse_args()
    if arguments.folder is not None:
        arguments.folder.mkdir(parents=True, exist_ok=True)
        sys.exit(main(arguments.minutes, arguments.folder))
    with tempfile.TemporaryDirectory(prefix='imu_bench_') as temporary:
        sys.exit(main(arguments.minutes, Path(temporary)))
