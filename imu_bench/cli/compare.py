# SPDX-License-Identifier: Apache-2.0
"""`imu-bench compare`: several results against the first, line by line, with a verdict each."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from imu_bench.terminal.arguments import check_outputs
from imu_bench.terminal.words import DONE

if TYPE_CHECKING:
    from imu_bench.offline.comparing.runs import RunComparison
    from imu_bench.offline.presentation.tables import Table
    from rich.console import Console

_DESCRIPTION = """\
Compares results of `imu-bench analyze --json` of the same sensors, or of one sensor each, with the
first one: bias, sigma, noise density, bias instability and random walk of every axis, as ratio and
as difference against the combined uncertainty."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'compare', help='results against one another', description=_DESCRIPTION
    )
    parser.add_argument(
        'results', nargs='+', metavar='RESULT.json', help='the reference first, then the others'
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the comparison')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write a page with figures')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare the results and return the exit code."""
    # imported here: help must not wait for scipy
    from imu_bench import offline
    from imu_bench.offline.presentation import pages
    from imu_bench.offline.whole_files import write_json
    from imu_bench.terminal.tables import console

    check_outputs([arguments.json, arguments.html], arguments.results)
    compared = offline.compare(arguments.results)
    # files first: the reader of a pipe may leave before the end of the tables
    if arguments.json is not None:
        write_json(arguments.json, compared.to_json())
    if arguments.html is not None:
        pages.write_runs(compared, arguments.html)
    _show(compared, console())
    for output in (arguments.json, arguments.html):
        if output is not None:
            print(f'wrote {output}')
    return DONE


def _show(compared: RunComparison, out: Console) -> None:
    """Print what the comparison says, then one table per sensor and run."""
    from imu_bench.counting import clean
    from imu_bench.offline.presentation import run_tables
    from imu_bench.terminal.tables import put
    from rich.text import Text

    for sentence in run_tables.summary(compared):
        out.print(Text(clean(sentence)))
    for sensor, run_name in dict.fromkeys((line.sensor, line.run) for line in compared.lines):
        forms = [
            run_tables.table(compared, sensor, run_name, columns)
            for columns in (run_tables.ALL, run_tables.NARROW)
        ]
        wide, narrow = (replace(one, title=f'{sensor}: {one.title}') for one in forms)
        out.print()
        if not put(out, wide, narrow):
            _stack(out, narrow)
        if wide.note:
            out.print(Text(clean(wide.note), style='yellow'))


def _stack(out: Console, one: Table) -> None:
    """Print one cell per line, for terminals too narrow for a table."""
    from imu_bench.counting import clean
    from imu_bench.offline.presentation.tables import cells
    from imu_bench.terminal.tables import COLOURS
    from rich.text import Text

    out.print(Text(clean(one.title), style='bold'))
    last = ''
    for axis, parameter, change, verdict in cells(one):
        if axis.text != last:
            out.print(Text(axis.text))
        out.print(Text(f'  {parameter.text}'))
        line = Text(f'    {change.text}  ')
        out.print(line.append(verdict.text, style=COLOURS.get(verdict.kind, '')))
        last = axis.text
