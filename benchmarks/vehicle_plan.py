# SPDX-License-Identifier: Apache-2.0
"""
The whole campaign of Capriglione et al. 2021, simulated and analysed in one command.

Four service conditions, three axes and five repetitions on three sensors: 180 runs in 60
recordings of 16 min, and nine recordings of the sine alone as reference of the SNR.  ``--zone 40
--repetitions 2`` takes some ten minutes.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

from benchmarks import _measured
from benchmarks._frame import Benchmark

CONDITIONS = ('sc1', 'sc2', 'sc3', 'sc4')
AXES = ('x', 'y', 'z')
SENSORS = 3
GIB = 1 << 30
AT_ONCE = 2
"""Recordings that are simulated side by side, each on three threads."""


class Recording(NamedTuple):
    """A recording to make: its name, scenario, seed, and settings of the scenario."""

    name: str
    scenario: str
    seed: int
    settings: tuple[str, ...]


def plan(conditions: int, axes: int, repetitions: int, zone_s: float) -> list[Recording]:
    """Return every recording of the campaign; 3 min of rest go with 10 min of vibration."""
    zones = tuple(
        f'zones.{name}={part * zone_s:g} s'
        for name, part in (('before', 0.3), ('test', 1.0), ('after', 0.3))
    )
    made = []
    for condition in CONDITIONS[:conditions]:
        for axis in AXES[:axes]:
            scenario, common = f'sine_on_random_{condition}', (f'axis={axis}', *zones)
            for repetition in range(1, repetitions + 1):
                name = f'{condition}_{axis}_{repetition}'
                made.append(Recording(name, scenario, repetition, common))
            if condition != 'sc4':  # a swept sine has no SNR
                alone = (*common, 'random.density=0 g²/Hz')
                made.append(Recording(f'{condition}_{axis}_sine', scenario, 9, alone))
    return made


def simulate(recording: Recording, folder: Path) -> None:
    """Write one recording."""
    settings = [word for text in recording.settings for word in ('--set', text)]
    command = [
        'imu-bench', 'simulate', 'vehicle_vibration', '--scenario', recording.scenario,
        '--seed', str(recording.seed), *settings, '-o', str(folder / recording.name),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f'{recording.name}: {done.stderr.strip()}')


def run(bench: Benchmark, folder: Path, recordings: list[Recording]) -> None:
    """Simulate and analyse."""
    begun = time.perf_counter()
    with ThreadPoolExecutor(AT_ONCE) as pool:
        list(pool.map(lambda one: simulate(one, folder), recordings))
    simulated = time.perf_counter() - begun
    stored = _measured.gigabytes(folder)
    found = _measured.run(
        ['imu-bench', 'analyze', '--plan', 'sine-on-random', '--cache', 'none',
         *(str(folder / one.name) for one in recordings),
         '--json', str(folder / 'plan.json'), '--html', str(folder / 'plan.html')],
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    document = json.loads((folder / 'plan.json').read_text(encoding='utf-8'))
    runs = len(document['values']['runs'])
    bench.head('step', 'time', title=f'{len(recordings)} recordings, {stored:.2f} GB')
    bench.row('simulate', f'{simulated:.0f} s')
    bench.row('analyse, with report', f'{found.seconds:.0f} s')
    print('', *document['summary'], sep='\n')
    wanted = SENSORS * len(recordings)
    bench.claim('runs found', runs, at_least=wanted, at_most=wanted)
    bench.claim('peak memory of the analysis', found.peak / GIB, at_most=1.0, unit='GiB')


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--conditions', len(CONDITIONS), quick=1, help='service conditions')
    bench.add_size('--axes', len(AXES), quick=1, help='axes')
    bench.add_size('--repetitions', 5, quick=1, help='of each')
    bench.add_size('--zone', 600.0, quick=20.0, help='seconds of vibration in each recording')
    bench.add_argument('--keep', type=Path, metavar='DIR', help='keep recordings and report')
    options = bench.start()
    recordings = plan(options.conditions, options.axes, options.repetitions, options.zone)
    with tempfile.TemporaryDirectory(dir=os.environ.get('TMPDIR')) as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=options.keep is None)
        run(bench, folder, recordings)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
