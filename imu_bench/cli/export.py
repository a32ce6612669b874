# SPDX-License-Identifier: Apache-2.0
"""`imu-bench export`: the numbers of an analysis as the programs want them that use them."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from imu_bench.cli.main import DONE
from imu_bench.cli.outputs import check_outputs
from imu_bench.cli.words import clean

if TYPE_CHECKING:
    from imu_bench.offline.results import RecordingResult

FORMATS = (
    'kalibr', 'openvins', 'orb-slam3', 'vins', 'gtsam', 'robot_localization', 'sensor_msgs',
    'gz-sim', 'kalman', 'csv',
)  # fmt: skip
"""The same as in imu_bench.offline.exports, which help must not wait for."""

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
    parser.add_argument('result', metavar='RESULT.json', help='written by imu-bench analyze')
    parser.add_argument('--to', required=True, choices=FORMATS, help='the program')
    parser.add_argument('--topic', default='', metavar='T', help='topic or name of the sensor')
    parser.add_argument(
        '--conservative',
        action='store_true',
        help='upper ends of the 95 %% intervals instead of the values, of the worst axis where '
        'one number stands for all: for a filter that must not trust the sensor too much',
    )
    parser.add_argument(
        '-o', '--output', type=Path, metavar='FILE', help='where to write; stdout if not given'
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the export and return the exit code."""
    # imported here: help must not wait for scipy
    from imu_bench.offline import results
    from imu_bench.offline.exports import choose, render
    from imu_bench.offline.whole_files import write_text

    check_outputs([arguments.output], [arguments.result])
    analysis = results.read(arguments.result)
    text = render(analysis, arguments.to, arguments.topic, conservative=arguments.conservative)
    if arguments.output is None:
        print(text, end='')
    else:
        write_text(arguments.output, text)
        print(f'wrote {arguments.output}')
    if arguments.to != 'csv':
        _warn(choose(analysis, arguments.topic))
    return DONE


def _warn(recording: RecordingResult) -> None:
    """Say of a recording that is not to be trusted why; the file that was made says it, too."""
    for finding in recording.health.findings:
        if finding.severity == 'severe':
            line = clean(f'{finding.text} {finding.effect} {finding.action}')
            print(f'imu-bench: warning: {line}', file=sys.stderr)
