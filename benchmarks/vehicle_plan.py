# SPDX-License-Identifier: Apache-2.0
"""
The whole campaign of Capriglione et al. 2021, simulated and analysed in one command.

Four service conditions, three axes and five repetitions on three sensors: 180 runs in 60
recordings of 16 min, and nine recordings of the sine alone as reference of the SNR.  Prints how
long it took, the most memory that was held, and what came out.  Run as
``python -m benchmarks.vehicle_plan [--short] [--keep DIR]``; ``--short`` takes zones of 20 s,
40 s and 20 s and two repetitions.
"""

from __future__ import annotations

import argparse
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

CONDITIONS = ('sc1', 'sc2', 'sc3', 'sc4')
AXES = ('x', 'y', 'z')
REPETITIONS = 5
SHORT = ('zones.before=20 s', 'zones.test=40 s', 'zones.after=20 s')
AT_ONCE = 2
"""Recordings that are simulated side by side, each on three threads."""


class Recording(NamedTuple):
    """A recording to make: its name, scenario, seed, and settings of the scenario."""

    name: str
    scenario: str
    seed: int
    settings: tuple[str, ...]


def plan(short: bool) -> list[Recording]:
    """Return every recording of the campaign."""
    zones = SHORT if short else ()
    made = []
    for condition in CONDITIONS:
        for axis in AXES:
            common = (f'axis={axis}', *zones)
            for repetition in range(1, (2 if short else REPETITIONS) + 1):
                name = f'{condition}_{axis}_{repetition}'
                made.append(
                    Recording(name, f'sine_on_random_{condition}', repetition, common)
                )  # fmt: skip
            if condition != 'sc4':  # a swept sine has no SNR
                alone = (*common, 'random.density=0 g²/Hz')
                name = f'{condition}_{axis}_sine'
                made.append(Recording(name, f'sine_on_random_{condition}', 9, alone))
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


def size(folder: Path) -> float:
    """Return GB in a folder."""
    return sum(file.stat().st_size for file in folder.rglob('*') if file.is_file()) / 1e9


def run(folder: Path, short: bool) -> None:
    """Simulate, analyse, and print a table."""
    recordings = plan(short)
    begun = time.perf_counter()
    with ThreadPoolExecutor(AT_ONCE) as pool:
        list(pool.map(lambda one: simulate(one, folder), recordings))
    simulated = time.perf_counter() - begun
    stored = size(folder)
    found = _measured.run(
        ['imu-bench', 'analyze', '--plan', 'sine-on-random', '--cache', 'none',
         *(str(folder / one.name) for one in recordings),
         '--json', str(folder / 'plan.json'), '--html', str(folder / 'plan.html')],
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    document = json.loads((folder / 'plan.json').read_text(encoding='utf-8'))
    runs = len(document['values']['runs'])
    print(f'{len(recordings)} recordings, {runs} runs, {stored:.2f} GB, {os.cpu_count()} cores\n')
    print('| step | time | memory |')
    print('|---|---|---|')
    print(f'| simulate | {simulated:.0f} s | - |')
    print(f'| analyse, with report | {found.seconds:.0f} s | {found.peak / 1e6:.0f} MB |\n')
    for line in document['summary']:
        print(line)


def main() -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--short', action='store_true', help='short zones, two repetitions')
    parser.add_argument('--keep', type=Path, metavar='DIR', help='keep recordings and report')
    arguments = parser.parse_args()
    if arguments.keep is not None:
        arguments.keep.mkdir(parents=True)
        run(arguments.keep, arguments.short)
        return 0
    with tempfile.TemporaryDirectory(dir=os.environ.get('TMPDIR')) as folder:
        run(Path(folder), arguments.short)
    return 0


if __name__ == '__main__':
    sys.exit(main())
