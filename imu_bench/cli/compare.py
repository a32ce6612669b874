# SPDX-License-Identifier: Apache-2.0
"""`imu-bench compare`: several results against the first, line by line, with a verdict each."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from imu_bench.cli.main import DONE
from imu_bench.cli.outputs import check_outputs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from imu_bench.offline.across import Across
    from imu_bench.offline.across_text import Row
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

_DESCRIPTION = """\
Compares results of `imu-bench analyze --json` of the same sensors, or of one sensor each, with the
first one: bias, sigma, noise density, bias instability and random walk of every axis, as ratio and
as difference against the combined uncertainty."""

_COLOURS = {'higher': 'yellow', 'lower': 'yellow', 'undecided': 'dim', 'same': ''}
_WIDE = ('axis', 'parameter', 'reference', 'value', 'difference', 'ratio', 'e_n', 'verdict')
_NARROW = ('axis', 'parameter', 'change', 'verdict')


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
    from imu_bench.cli.table import console
    from imu_bench.offline import results
    from imu_bench.offline.across import compare_runs, named
    from imu_bench.offline.report import runs_page
    from imu_bench.offline.whole_files import write_text

    check_outputs([arguments.json, arguments.html], arguments.results)
    analyses = [results.read(path) for path in arguments.results]
    across = compare_runs(named(arguments.results, analyses))
    # files first: the reader of a pipe may leave before the end of the tables
    if arguments.json is not None:
        document = json.dumps(across.to_json(), ensure_ascii=False, allow_nan=False, indent=1)
        write_text(arguments.json, document + '\n')
    if arguments.html is not None:
        runs_page.write(across, arguments.html)
    _show(across, console())
    for output in (arguments.json, arguments.html):
        if output is not None:
            print(f'wrote {output}')
    return DONE


def _show(across: Across, out: Console) -> None:
    """Print what the comparison says, then one table per sensor and run."""
    from imu_bench.cli.table import fits
    from imu_bench.cli.words import clean
    from imu_bench.offline import across_text
    from rich.text import Text

    for sentence in across_text.summary(across):
        out.print(Text(clean(sentence)))
    groups = dict.fromkeys((line.sensor, line.run) for line in across.lines)
    for group in groups:
        rows = [across_text.row(line) for line in across.lines if (line.sensor, line.run) == group]
        out.print()
        tables = (_table(across.runs[0].name, *group, rows, names) for names in (_WIDE, _NARROW))
        fitting = next((table for table in tables if fits(table, out)), None)
        if fitting is None:
            _stacked(across.runs[0].name, *group, rows, out)
        else:
            out.print(fitting)


def _title(reference: str, sensor: str, run_name: str) -> Text:
    from imu_bench.cli.words import clean
    from rich.text import Text

    return Text(clean(f'{sensor}: {run_name} against {reference}'), style='bold')


def _stacked(
    reference: str, sensor: str, run_name: str, rows: Sequence[Row], out: Console
) -> None:
    """Print one cell per line, for terminals too narrow for a table."""
    from rich.text import Text

    out.print(_title(reference, sensor, run_name))
    last = ''
    for row in rows:
        if row.axis != last:
            out.print(Text(row.axis))
        out.print(Text(f'  {row.parameter}'))
        line = Text(f'    {row.change}  ')
        out.print(line.append(row.verdict, style=_COLOURS[row.verdict]))
        last = row.axis


def _table(
    reference: str, sensor: str, run_name: str, rows: Sequence[Row], columns: Sequence[str]
) -> Table:
    from imu_bench.cli.words import clean
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=_title(reference, sensor, run_name),
        title_justify='left', box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1),
    )  # fmt: skip
    titles = {'reference': reference, 'value': run_name, 'e_n': 'E_n'}
    for name in columns:
        left = name in ('axis', 'parameter', 'verdict')
        title = Text(clean(titles.get(name, name)))
        table.add_column(title, justify='left' if left else 'right')
    last = ''
    for row in rows:
        cells = [Text(getattr(row, name)) for name in columns]
        if row.axis == last:
            cells[0] = Text()
        cells[-1].stylize(_COLOURS[row.verdict])
        table.add_row(*cells)
        last = row.axis
    return table
