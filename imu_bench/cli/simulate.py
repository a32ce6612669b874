# SPDX-License-Identifier: Apache-2.0
"""`imu-bench simulate`: a bag of a simulated bench, far faster than real time."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
import time
from typing import TYPE_CHECKING

from imu_bench.errors import ConfigError
from imu_bench.terminal.arguments import duration

if TYPE_CHECKING:
    from imu_bench.config import SensorConfig
    from imu_bench.simulation.scenario import Scenario

_DESCRIPTION = """\
Simulates every sensor of a bench in a scenario and writes what a recorder would have written,
with the truth beside it in truth.json.  Nothing waits: hours take seconds."""

TWIN = 'twin'
"""Folder of the sensor files of twins, beside their bag."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'simulate', help='write the bag of a simulated bench', description=_DESCRIPTION
    )
    parser.add_argument(
        'bench',
        nargs='?',
        metavar='BENCH',
        help='a bench of config/benches or a YAML file, also that of a single sensor',
    )
    parser.add_argument(
        '--from', dest='results', type=Path, metavar='JSON',
        help='simulate twins of the sensors in a result of `imu-bench analyze`',
    )  # fmt: skip
    parser.add_argument(
        '--scenario', default='still', metavar='S',
        help='a scenario of config/scenarios or a YAML file (default still)',
    )  # fmt: skip
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME=VALUE', dest='overrides',
        help="change a setting of the scenario, as in 'sine.frequency=90 Hz' (repeatable)",
    )  # fmt: skip
    parser.add_argument(
        '--duration', type=duration, metavar='T',
        help="simulated time, such as 14h, 20min or 90s (default the scenario's own)",
    )  # fmt: skip
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='DIR', help='the bag')
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3', 'npy'),
        help="format of the bag (default the bench's), or npy for columns alone",
    )  # fmt: skip
    parser.add_argument(
        '--seed', type=_seed, default=0, metavar='N', help='another run of the same sensors'
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and return the exit code."""
    # imported here: help must not wait for scipy
    from imu_bench import bench
    from imu_bench.offline.whole_files import whole_folder
    from imu_bench.simulation import recording
    from imu_bench.simulation.scenario import load_scenario
    from imu_bench.terminal.progress import Bar

    if arguments.output.exists():
        raise ConfigError(f'{arguments.output}: exists already; name another folder with -o')
    sensors, storage = _sensors(arguments)
    scenario = load_scenario(
        arguments.scenario, seed=arguments.seed, overrides=arguments.overrides
    )
    duration_s = _length(arguments.duration, scenario)
    simulated = [bench.simulate(sensor, scenario, run=arguments.seed) for sensor in sensors]
    for sensor in simulated:
        for remark in sensor.remarks():
            print(f'note: {remark}', file=sys.stderr)
    begun = time.monotonic()
    with Bar() as bar, whole_folder(arguments.output) as draft:
        step = bar.phase(f'simulating {scenario.name}')
        write = recording.writer(storage)
        counts = write(draft, simulated, scenario, duration_s, run=arguments.seed, progress=step)
        if arguments.results is not None:
            _write_twins(draft, arguments.results)
    if arguments.results is not None:
        twin = arguments.output / TWIN
        print(f'wrote {twin}: sensor files of the twins, and bench.yaml to run them')
    took_s = time.monotonic() - begun
    what = 'samples' if storage == recording.COLUMNS else 'messages'
    print(
        f'wrote {arguments.output}: {sum(counts.values())} {what}, {duration_s:g} s in '
        f'{took_s:.1f} s ({duration_s / took_s:.0f} times real time); '
        f'truth in {arguments.output / recording.TRUTH}'
    )
    return 0


def _sensors(arguments: argparse.Namespace) -> tuple[list[SensorConfig], str]:
    """Return the sensors to simulate and the format of the bag."""
    from imu_bench import bench
    from imu_bench.config import sensor_from_parameters
    from imu_bench.config.location import named_file

    if (arguments.bench is None) == (arguments.results is None):
        raise ConfigError('simulate what? Give either a bench or --from results.json')
    if arguments.bench is not None:
        config = bench.load_bench(named_file('benches', arguments.bench))
        return list(config.sensors), arguments.storage or config.recorder.storage
    from imu_bench.simulation.twin import twins

    made = [
        sensor_from_parameters(
            name, parameters, settings_of=bench.settings_of, source=f'{arguments.results}: {name}'
        )
        for name, parameters in twins(arguments.results).items()
    ]
    return made, arguments.storage or 'mcap'


def _write_twins(folder: Path, results: Path) -> None:
    from imu_bench.simulation.twin import twins, write_twins

    write_twins(folder / TWIN, twins(results), results.name)


def _length(wanted: float | None, scenario: Scenario) -> float:
    length = wanted or scenario.duration_s
    if length is None:
        raise ConfigError(
            f'scenario {scenario.name} has no end; say how long with --duration, such as 20min'
        )
    return length


def _seed(text: str) -> int:
    if not (text.isdecimal() and int(text) < 2**31):
        raise argparse.ArgumentTypeError(f'{text!r} is no whole number from 0 to 2147483647')
    return int(text)
