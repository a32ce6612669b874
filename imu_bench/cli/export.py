# SPDX-License-Identifier: Apache-2.0
"""`imu-bench export`: the numbers of an analysis as the programs want them that use them."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from imu_bench.counting import clean
from imu_bench.errors import RecordingError
from imu_bench.terminal.arguments import check_folder, check_outputs
from imu_bench.terminal.words import DONE

if TYPE_CHECKING:
    from imu_bench.offline.analysis.results import RecordingResult
    from imu_bench.offline.health import Finding

FORMATS = (
    'kalibr', 'openvins', 'orb-slam3', 'vins', 'gtsam', 'robot_localization', 'sensor_msgs',
    'gz-sim', 'kalman', 'csv',
)  # fmt: skip
"""The same as in imu_bench.offline.exports, which help must not wait for."""

URDF = 'urdf'
"""Of a bench, whose file stands in the place of a result."""

_DESCRIPTION = """\
Writes the noise numbers of a result of `imu-bench analyze --json` for the program that uses them.
The unit, and whether a number is continuous or discrete, one- or two-sided, stands beside it.
What the recording could not show is its upper bound, and says so. The numbers are those of a
sensor at rest: vibration, temperature and errors of the scale come on top in use."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'export', help='noise numbers for Kalibr, GTSAM, gz-sim, …', description=_DESCRIPTION
    )
    parser.add_argument(
        'result',
        metavar='RESULT.json',
        help='written by imu-bench analyze; with --to urdf a bench, whose mounting: is written',
    )
    parser.add_argument('--to', required=True, choices=(*FORMATS, URDF), help='the program')
    parser.add_argument(
        '--topic', action='append', default=[], metavar='T',
        help='topic or name of a sensor (repeatable); all of them if not given',
    )  # fmt: skip
    parser.add_argument(
        '--conservative',
        action='store_true',
        help='upper ends of the 95 %% intervals instead of the values, of the worst axis where '
        'one number stands for all: for a filter that must not trust the sensor too much',
    )
    parser.add_argument(
        '--force',
        action='store_true',
        help='write numbers although the recording has severe findings',
    )
    parser.add_argument(
        '-o', '--output', type=Path, metavar='FILE|FOLDER',
        help='a file, or a folder in which every sensor has one; stdout if not given',
    )  # fmt: skip
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the export and return the exit code."""
    if arguments.to == URDF:
        return _places(arguments.result, arguments.output)
    # imported here: help must not wait for scipy
    from imu_bench.offline import exports
    from imu_bench.offline.analysis import results
    from imu_bench.offline.whole_files import write_text

    analysis = results.read(arguments.result)
    chosen = exports.choose(analysis, arguments.topic)
    several = len(chosen) > 1 and arguments.to != 'csv'
    output, kind = arguments.output, {'conservative': arguments.conservative}
    into = output is not None and (output.is_dir() or (several and not output.exists()))
    if into:
        check_folder(output)
    else:
        check_outputs([output], [arguments.result])
    if not arguments.force:
        _refuse(chosen)
    written: list[Path] = []
    lacking: list[str] = []
    if into:
        # who names a sensor wants it
        texts = exports.files(
            chosen, arguments.to, lacking=None if arguments.topic else lacking, **kind
        )
        output.mkdir(exist_ok=True)
        for name, text in texts.items():
            write_text(output / name, text)
            written.append(output / name)
    elif several and output is not None:
        raise RecordingError(
            f'{output} is one file for {len(chosen)} sensors: name a folder, or one with --topic: '
            f'{", ".join(chosen)}'
        )
    else:
        # several in one are refused there
        only = replace(analysis, recordings=tuple(chosen.values()))
        text = exports.render(only, arguments.to, **kind)
        if output is None:
            print(text, end='')
        else:
            write_text(output, text)
            written.append(output)
    print(*(f'wrote {path}\n' for path in written), sep='', end='')
    doubts = [
        _told(label, finding)
        for label, recording in chosen.items()
        for finding in recording.health.severe
    ]
    for words in (*(f'left out: {why}' for why in lacking), *doubts):
        print(f'imu-bench: warning: {words}', file=sys.stderr)
    return DONE


def _places(name: str, output: Path | None) -> int:
    """Write where the sensors of a bench are."""
    from imu_bench.bench import load_bench
    from imu_bench.config.location import named_file
    from imu_bench.offline.exports.ros import urdf
    from imu_bench.offline.whole_files import write_text

    path = named_file('benches', name)
    check_outputs([output], [path])
    text = urdf(load_bench(path))
    if output is None:
        print(text, end='')
    else:
        write_text(output, text)
        print(f'wrote {output}')
    return DONE


def _refuse(chosen: Mapping[str, RecordingResult]) -> None:
    """Refuse numbers that describe something else than a sensor."""
    told = [
        _told(label, finding)
        for label, recording in chosen.items()
        for finding in recording.health.severe
    ]
    if told:
        more = f' (and {len(told) - 1} more)' if len(told) > 1 else ''
        raise RecordingError(
            f'not to be trusted: {told[0].rstrip(".")}{more}; leave it out with --topic, or write '
            'it all the same with --force'
        )


def _told(label: str, finding: Finding) -> str:
    return clean(f'{label}: {finding.text} {finding.effect} {finding.action}')
