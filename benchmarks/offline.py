# SPDX-License-Identifier: Apache-2.0
"""
How fast is `imu-bench analyze`, side by side with the script a user would write today?

The script is `benchmarks/_todays_script.py`: a loop over the bag with rosbags into numpy, then
allantools with the same averaging times.  The claims are ratios measured in one run, medians over
several turns, on an otherwise idle machine: ten minutes and 4 GB of disk.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
import json
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile

from benchmarks._bags import write_bag
from benchmarks._frame import Benchmark
from benchmarks._measured import Measured, run

GIB = 1 << 30
RATE_HZ = 1000.0
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


def read(kind: str, path: Path) -> tuple[float, int]:
    """Return seconds and messages of one of the readers; see `benchmarks._reading`."""
    command = [sys.executable, '-m', 'benchmarks._reading', kind, str(path)]
    seconds, count = subprocess.run(command, capture_output=True, check=True).stdout.split()
    return float(seconds), int(count)


def reading(bench: Benchmark, folder: Path, options: Namespace) -> None:
    """Compare the readers on topics whose messages take turns one by one."""
    bench.head(
        'storage', 'rosbags loop', 'ours',
        title='µs per message, bag of interleaved topics at 1 kHz to columns',
    )  # fmt: skip
    sensors, minutes = options.sensors, options.read_minutes
    for storage, compression, target in STORAGES[: options.storages]:
        path = folder / f'read_{storage}_{compression}_{sensors}_{minutes:g}min'
        if not path.exists():
            write_bag(
                path, sensors=sensors, rate_hz=RATE_HZ, duration_s=60.0 * minutes,
                storage=storage, compression=compression,
            )  # fmt: skip
        read('ours', path)  # the file is in memory from now on
        pairs = [(read('script', path), read('ours', path)) for _ in range(options.turns)]
        slow, fast = (
            1e6 * median(seconds / count for seconds, count in side)
            for side in zip(*pairs, strict=True)
        )
        name = f'{storage}, {compression or "not compressed"}'
        bench.row(name, f'{slow:.2f}', f'{fast:.3f}')
        bench.claim(f'{name}: times faster than the rosbags loop', slow / fast, at_least=target)


def simulated(folder: Path, sensors: int, minutes: float) -> Path:
    """Return a bag of sensors at 1 kHz, made by `imu-bench simulate` if it is not there."""
    path = folder / f'simulated_{sensors}_{minutes:g}min'
    if not path.exists():
        for seed in range(1, sensors + 1):
            text = SENSOR_FILE.format(seed=seed, rate=RATE_HZ)
            (folder / f'imu_{seed}.yaml').write_text(text, encoding='utf-8')
        listed = [
            f'  - {{file: imu_{seed}.yaml, name: imu_{seed}}}' for seed in range(1, sensors + 1)
        ]
        bench = folder / 'bench.yaml'
        bench.write_text('\n'.join(['name: many', 'sensors:', *listed, '']), encoding='utf-8')
        command = [*IMU_BENCH, 'simulate', str(bench), '--duration', f'{minutes:g}min']
        run([*command, '--output', str(path)], stdout=subprocess.DEVNULL)
    return path


def analyse(path: Path, folder: Path, *, watched: bool = False) -> Measured:
    """Run `imu-bench analyze` with a JSON document and a report; what it took is in a file."""
    outputs = ['--json', str(folder / 'results.json'), '--html', str(folder / 'report.html')]
    command = [*IMU_BENCH, 'analyze', str(path), '--cache', 'none', '--profile', *outputs]
    with (folder / 'said.txt').open('w') as said:
        return run(command, watched=watched, stdout=said)


def profile(folder: Path) -> dict[str, float]:
    """Return the processor seconds of every stage of the last analysis."""
    _, _, table = (folder / 'said.txt').read_text('utf-8').rpartition('\nstage ')
    rows = [line.split() for line in table.splitlines()[1:]]
    return {name: float(seconds) for name, seconds, *_ in rows}


def stages(bench: Benchmark, runs: Sequence[dict[str, float]], millions: float) -> None:
    """Tell what each stage takes for itself, and more for each million messages."""
    bench.head('stage', 's', 's per million messages', title='processor time, from both lengths')
    bench.stored['stages'] = {}
    for name, short in runs[0].items():
        slope = (runs[1][name] - short) / (9.0 * millions)
        fixed = short - slope * millions
        bench.row(name, f'{fixed:.3f}', f'{slope:.4f}')
        bench.stored['stages'][name] = {'fixed_s': fixed, 's_per_million_messages': slope}


def script(path: Path, folder: Path) -> Measured:
    """Run the script on the averaging times of our last result."""
    results = json.loads((folder / 'results.json').read_text(encoding='utf-8'))
    tau = next(iter(results['recordings'][0]['axes'].values()))['allan']['tau']
    command = [sys.executable, '-m', 'benchmarks._todays_script', str(path)]
    return run([*command, str(folder / 'script.json'), ','.join(map(str, tau))], watched=False)


def whole(bench: Benchmark, folder: Path, options: Namespace) -> None:
    """Compare the whole analysis with the script, and with itself at ten times the length."""
    minutes = options.minutes
    short, long = (simulated(folder, options.sensors, k * minutes) for k in (1.0, 10.0))
    # the files of the program are in memory from now on
    peaks, spent = [], []
    for path in (short, long):
        peaks.append(analyse(path, folder, watched=True).peak)
        spent.append(profile(folder))
    near, far, theirs = [], [], []
    for _ in range(options.turns):
        near.append(analyse(short, folder).seconds)
        theirs.append(script(short, folder).seconds)
        far.append(analyse(long, folder).seconds)
        near.append(analyse(short, folder).seconds)
    ours = median(near)
    bench.head(
        f'{options.sensors} sensors at 1 kHz, report included', 's', 'memory of all processes, MiB'
    )
    bench.row(f'rosbags loop, allantools, no report, {minutes:g} min', f'{median(theirs):.1f}', '')
    bench.row(f'imu-bench analyze, {minutes:g} min', f'{ours:.2f}', f'{peaks[0] >> 20}')
    bench.row(
        f'imu-bench analyze, {10 * minutes:g} min', f'{median(far):.2f}', f'{peaks[1] >> 20}'
    )
    stages(bench, spent, options.sensors * minutes * 60.0 * RATE_HZ / 1e6)
    ratio = median(theirs) / ours
    bench.claim('whole analysis: times faster than the script', ratio, at_least=15.0)
    bench.claim('ten times the length: times the time', median(far) / ours, at_most=10.0)
    bench.claim('peak memory', peaks[0] / GIB, at_most=1.0, unit='GiB')
    name = 'peak memory at ten times the length'
    bench.claim(name, peaks[1] / GIB, at_most=1.0, unit='GiB')


def start_up(bench: Benchmark, turns: int) -> None:
    """Time the help text."""
    command = [*IMU_BENCH, '--help']
    seconds = [
        run(command, watched=False, stdout=subprocess.DEVNULL).seconds
        for _ in range(2 * turns + 1)
    ]
    bench.claim('imu-bench --help', median(seconds), at_most=0.3, unit='s')


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--sensors', 6, quick=1, help='in every recording')
    bench.add_size(
        '--minutes', 10.0, quick=0.05, help='of the recording; another ten times longer'
    )
    bench.add_size('--read-minutes', 2.0, quick=0.05, help='of the recordings to columns')
    bench.add_size('--storages', len(STORAGES), quick=1, help='formats to columns')
    bench.add_size('--turns', 3, quick=1, help='of everything')
    bench.add_argument('--folder', type=Path, help='keep the bags there for the next time')
    options = bench.start()
    with tempfile.TemporaryDirectory(prefix='imu_bench_') as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        start_up(bench, options.turns)
        reading(bench, folder, options)
        whole(bench, folder, options)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
