# SPDX-License-Identifier: Apache-2.0
"""`imu-bench import`: whatever `imu-bench analyze` reads, as a bag of ROS 2, CSV or columns."""

from __future__ import annotations

import argparse
from pathlib import Path
import shlex
import sys

from imu_bench.counting import clean
from imu_bench.terminal.arguments import add_reading, check_outputs, read_options
from imu_bench.terminal.words import DONE

FORMS = ('mcap', 'sqlite3', 'csv', 'npy')
"""The same as in imu_bench.offline.imports, which help must not wait for."""

_DESCRIPTION = """\
Writes recordings of any format that `imu-bench analyze` reads as a bag of ROS 2, as CSV in SI
units, or as columns of NumPy.  Samples and stamps stay what they are: nothing is resampled,
filtered or made up, gaps remain gaps, and what is left out is counted.
A bag keeps receive times, frame_id, orientation and constant covariances of a bag, and its
topics with magnetic field, temperature and inclination."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'import', help='recordings as a bag of ROS 2, CSV or columns', description=_DESCRIPTION
    )
    add_reading(parser)
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='OUT',
        help='folder of the bag, of CSV files or of columns; or one file that ends with .csv',
    )  # fmt: skip
    parser.add_argument(
        '--to', choices=FORMS, help='format (default csv for OUT.csv, else a bag in mcap)'
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Import and return the exit code."""
    # imported here: help must not wait for scipy
    from imu_bench.offline.imports import form_of, import_recordings
    from imu_bench.offline.recordings import find_recordings, grouped
    from imu_bench.terminal.progress import Bar

    options = read_options(arguments)
    output: Path = arguments.output
    form = form_of(output, arguments.to)
    if output.suffix.lower() == '.csv' and not output.exists():
        check_outputs([output], arguments.inputs)
    found = [path for given in arguments.inputs for path in find_recordings(given)]
    paths, options = grouped(list(dict.fromkeys(found)), options)
    with Bar() as bar:
        done = import_recordings(paths, options, output, form, bar.phase)
    for note in done.notes:
        print(f'note: {clean(note)}', file=sys.stderr)
    for entry in done.entries:
        print(clean(str(entry)))
    quoted = shlex.quote(str(output))
    more = f' or ros2 bag info {quoted}' if form in ('mcap', 'sqlite3') else ''
    print(clean(f'wrote {output}; next: imu-bench analyze {quoted}{more}'))
    return DONE
