# SPDX-License-Identifier: Apache-2.0
"""
How fast is `imu-bench analyze`, side by side with the script a user would write today?

The script is `benchmarks/_todays_script.py`: a loop over the bag with rosbags into numpy, then
allantools with the same averaging times.  Prints ratios measured in one run, medians over several
turns; they, not the seconds, are the claim.  Run as
``python -m benchmarks.offline [--quick] [--folder DIR]`` on an otherwise idle machine: ten
minutes and 4 GB of disk, or with --quick two minutes (1 minute of recording against 10 instead
of 10 against 100).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import json
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile
from typing import NamedTuple

from benchmarks._bags import write_bag
from benchmarks._measured import Measured, run

GIB = 1 << 30
READ_MINUTES, MINUTES, QUICK_MINUTES = 2.0, 10.0, 1.0
SENSORS, RATE_HZ = 6, 1000.0
TURNS = 3
IMU_BENCH = [sys.executable, '-m', 'imu_bench.cli.main']
STORAGES = (('mcap', 'zstd', 40.0), ('mcap', '', 40.0), ('sqlite3', '', 9.0))

SENSOR_FILE = """\
/**:
  ros__parameters:
    driver: generic
    backend: emulated
    rate_hz: {rate}
    simulation:
      seed: {seed}
      acceleration: {{noise_density: "{seed}0 µg/√Hz", bias_instability: "40 µg",
        resolution: "61 µg"}}
      angular_velocity: {{noise_density: "0.0{seed} °/s/√Hz", bias_instability: "10 °/h",
        random_walk: "2 °/h/√h", resolution: "0.0076 °/s"}}
"""


class Claim(NamedTuple):
    """What was measured, and what is asked of it."""

    name: str
    measured: float
    target: float
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Whether it holds."""
        if self.at_least:
            return self.measured >= self.target
        return self.measured <= self.target


def read(kind: str, path: Path) -> tuple[float, int]:
    """Return seconds and messages of one of the readers; see `benchmarks._reading`."""
    command = [sys.executable, '-m', 'benchmarks._reading', kind, str(path)]
    seconds, count = subprocess.run(command, capture_output=True, check=True).stdout.split()
    return float(seconds), int(count)


def reading(folder: Path) -> Iterator[Claim]:
    """Compare the readers on topics whose messages take turns one by one."""
    print(f'## bag to columns, {READ_MINUTES:g} min of six interleaved topics at 1 kHz\n')
    print('| storage | rosbags loop, µs per message | ours, µs per message |')
    print('|---|---|---|')
    for storage, compression, target in STORAGES:
        path = folder / f'read_{storage}_{compression}'
        if not path.exists():
            write_bag(
                path, sensors=SENSORS, rate_hz=RATE_HZ, duration_s=60.0 * READ_MINUTES,
                storage=storage, compression=compression,
            )  # fmt: skip
        read('ours', path)  # the file is in memory from now on
        turns = [(read('script', path), read('ours', path)) for _ in range(TURNS)]
        slow, fast = (
            1e6 * median(seconds / count for seconds, count in side)
            for side in zip(*turns, strict=True)
        )
        name = f'{storage}, {compression or "not compressed"}'
        print(f'| {name} | {slow:.2f} | {fast:.3f} |')
        yield Claim(
            f'{name}: times faster than the rosbags loop', slow / fast, target, at_least=True
        )


def simulated(folder: Path, minutes: float) -> Path:
    """Return a bag of six sensors at 1 kHz, made by `imu-bench simulate` if it is not there."""
    path = folder / f'six_{minutes:g}min'
    if not path.exists():
        for seed in range(1, SENSORS + 1):
            text = SENSOR_FILE.format(seed=seed, rate=RATE_HZ)
            (folder / f'imu_{seed}.yaml').write_text(text, encoding='utf-8')
        listed = [
            f'  - {{file: imu_{seed}.yaml, name: imu_{seed}}}' for seed in range(1, SENSORS + 1)
        ]
        bench = folder / 'six.yaml'
        bench.write_text('\n'.join(['name: six', 'sensors:', *listed, '']), encoding='utf-8')
        command = [*IMU_BENCH, 'simulate', str(bench), '--duration', f'{minutes:g}min']
        run([*command, '--output', str(path)], stdout=subprocess.DEVNULL)
    return path


def analyse(path: Path, folder: Path, *, watched: bool = False) -> Measured:
    """Run `imu-bench analyze` with a JSON document and a report."""
    outputs = ['--json', str(folder / 'results.json'), '--html', str(folder / 'report.html')]
    command = [*IMU_BENCH, 'analyze', str(path), '--cache', 'none', *outputs]
    return run(command, watched=watched, stdout=subprocess.DEVNULL)


def script(path: Path, folder: Path) -> Measured:
    """Run the script on the averaging times of our last result."""
    results = json.loads((folder / 'results.json').read_text(encoding='utf-8'))
    tau = next(iter(results['recordings'][0]['axes'].values()))['allan']['tau']
    command = [sys.executable, '-m', 'benchmarks._todays_script', str(path)]
    return run([*command, str(folder / 'script.json'), ','.join(map(str, tau))], watched=False)


def whole(folder: Path, minutes: float, *, with_script: bool) -> Iterator[Claim]:
    """Compare the whole analysis with the script, and with itself at ten times the length."""
    short, long = simulated(folder, minutes), simulated(folder, 10.0 * minutes)
    # the files of the program are in memory from now on
    peaks = [analyse(path, folder, watched=True).peak for path in (short, long, short)]
    near, far, theirs = [], [], []
    for _ in range(TURNS):
        near.append(analyse(short, folder).seconds)
        if with_script:
            theirs.append(script(short, folder).seconds)
        far.append(analyse(long, folder).seconds)
        near.append(analyse(short, folder).seconds)
    print('\n## whole analysis of six sensors at 1 kHz, report included\n')
    print('| | s | memory of all processes, MiB |\n|---|---|---|')
    if with_script:
        print(
            f'| rosbags loop and allantools, no report, {minutes:g} min | {median(theirs):.1f} | |'
        )
    for length, seconds, peak in ((minutes, near, peaks[0]), (10 * minutes, far, peaks[1])):
        name = f'imu-bench analyze, {length:g} min'
        print(f'| {name} | {median(seconds):.2f} | {peak / 2**20:.0f} |')
    ours = median(near)
    if with_script:
        ratio = median(theirs) / ours
        yield Claim('whole analysis: times faster than the script', ratio, 15.0, at_least=True)
    yield Claim('ten times the length: times the time', median(far) / ours, 10.0)
    yield Claim('peak memory in GiB', max(peaks[0], peaks[2]) / GIB, 1.0)
    yield Claim('peak memory in GiB at ten times the length', peaks[1] / GIB, 1.0)


def start_up() -> Iterator[Claim]:
    """Time the help text."""
    command = [*IMU_BENCH, '--help']
    turns = [run(command, watched=False, stdout=subprocess.DEVNULL) for _ in range(2 * TURNS + 1)]
    yield Claim('imu-bench --help in s', median(turn.seconds for turn in turns), 0.3)


def main(folder: Path, *, quick: bool) -> int:
    """Print the tables; return 1 if a claim does not hold."""
    print(f'cores: {len(os.sched_getaffinity(0))}, load before: {os.getloadavg()[0]:.1f}\n')
    minutes = QUICK_MINUTES if quick else MINUTES
    claims = [
        *start_up(),
        *reading(folder),
        # a minute is mostly the start of the program: the ratio is claimed for ten
        *whole(folder, minutes, with_script=not quick),
    ]
    print('\n| claim | measured | target | |\n|---|---|---|---|')
    for claim in claims:
        sign, verdict = '≥' if claim.at_least else '≤', 'met' if claim.met else 'NOT MET'
        print(f'| {claim.name} | {claim.measured:.3g} | {sign} {claim.target:g} | {verdict} |')
    print(f'\nload after: {os.getloadavg()[0]:.1f}')
    return 0 if all(claim.met for claim in claims) else 1


if __name__ == '__main__':
    parser = argparse.ArgumentParser()
    parser.add_argument('--quick', action='store_true', help='shorter recordings')
    parser.add_argument('--folder', type=Path, help='keep the bags there for the next time')
    arguments = parser.parse_args()
    if arguments.folder is not None:
        arguments.folder.mkdir(parents=True, exist_ok=True)
        sys.exit(main(arguments.folder, quick=arguments.quick))
    with tempfile.TemporaryDirectory(prefix='imu_bench_') as temporary:
        sys.exit(main(Path(temporary), quick=arguments.quick))
