# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze`: health, noise metrics and a report of one or several recordings."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

from imu_bench.cli.main import complain, DONE, FAULT
from imu_bench.cli.outputs import check_folder, check_outputs
from imu_bench.cli.reading import add_reading, read_options
from imu_bench.errors import BenchError, ConfigError

if TYPE_CHECKING:
    from imu_bench.offline.datasheets import Document
    from imu_bench.offline.failure import Failure
    from imu_bench.offline.results import Analysis, RecordingResult
    from imu_bench.offline.settings import Settings

_DESCRIPTION = """\
Reads ROS 2 bags, ROS 1 bags, text files and arrays of NumPy and MATLAB, checks the health of
every Imu topic, and measures statistics, noise density, Allan deviation and the coefficients N, B
and K of every axis.
Several inputs give one result that compares them."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'analyze', help='health and noise metrics of recordings', description=_DESCRIPTION
    )
    add_reading(parser)
    _add_measuring(parser)
    _add_writing(parser)
    parser.add_argument(
        '--jobs', type=int, metavar='N', help='processes; as many as there are cores by default'
    )
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', help='work on this Dask cluster, as in tcp://host:8786'
    )
    parser.add_argument(
        '--cache', metavar='DIR', help='keep the columns of recordings there; none for nothing'
    )
    parser.set_defaults(run=run)


def _add_measuring(parser: argparse.ArgumentParser) -> None:
    """Add what says which part is measured, and how."""
    parser.add_argument(
        '--pair',
        action='append',
        nargs=2,
        default=[],
        metavar=('ACCEL', 'GYRO'),
        help='topics or files of an accelerometer and a gyroscope that are one sensor',
    )
    parser.add_argument(
        '--tau', type=_numbers, default=(), metavar='S[,S…]', help='averaging times in s'
    )
    parser.add_argument('--start', type=float, metavar='S', help='begin, s after the first sample')
    parser.add_argument('--end', type=float, metavar='S', help='end, s after the first sample')
    parser.add_argument(
        '--window', type=_window, metavar='NS:NS', help='first and last stamp in ns, both included'
    )
    parser.add_argument(
        '--min-share',
        type=float,
        default=1.0,
        metavar='SHARE',
        help='averages count if this share of their samples is there, as in 0.95; 1 by default',
    )
    parser.add_argument('--reference', default='', metavar='NAME', help='sensor for the ratios')
    parser.add_argument(
        '--datasheet', type=Path, metavar='FILE', help='YAML with typical values of the sensors'
    )
    parser.add_argument(
        '--plan', metavar='PLAN', help='what the test plan of a document asks: see docs/plan_*.md'
    )
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME=VALUE', help='setting of the plan'
    )


def _add_writing(parser: argparse.ArgumentParser) -> None:
    """Add what says what is shown and written."""
    parser.add_argument('--si', action='store_true', help='table in SI instead of datasheet units')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write the report')
    parser.add_argument(
        '--figures', type=Path, metavar='DIR', help='write figures as SVG, PDF and PNG'
    )
    parser.add_argument(
        '--strict', action='store_true', help='exit code 1 if a severe finding was made'
    )


def run(arguments: argparse.Namespace) -> int:
    """Analyse the inputs and return the exit code."""
    # imported here and below: help must not wait for scipy, nor reading for the report
    from imu_bench.offline.environment import one_thread_each

    one_thread_each()
    from imu_bench.cli import running
    from imu_bench.offline.pairing import joined
    from imu_bench.offline.recordings import grouped
    from imu_bench.offline.settings import Settings

    if arguments.set and arguments.plan is None:
        raise ConfigError(f'--set {arguments.set[0]}: a setting of a plan; name it with --plan')
    options = read_options(arguments)
    settings = Settings(
        taus=arguments.tau,
        start_s=arguments.start,
        end_s=arguments.end,
        window_ns=arguments.window,
        reference=arguments.reference,
        min_share=arguments.min_share,
    )
    sheets = _sheets(arguments.datasheet)
    _check_outputs(arguments)
    failures: list[Failure] = []
    found = [path for given in arguments.inputs for path in _recordings(given, failures)]
    paths, options = grouped(found, options)
    if arguments.plan is not None:
        from imu_bench.cli import planning

        return planning.run(arguments, paths, options, settings, failures)
    with running.workers(arguments, paths) as workers:
        results = running.analyse(arguments, paths, options, settings, workers, failures)
    return _present(joined(results, arguments.pair), failures, settings, arguments, sheets)


def _check_outputs(arguments: argparse.Namespace) -> None:
    check_outputs([arguments.json, arguments.html], arguments.inputs)
    if arguments.figures is not None:
        from imu_bench.offline.figure_files import require

        require()
        check_folder(arguments.figures)


def _present(
    found: Sequence[RecordingResult],
    failures: Sequence[Failure],
    settings: Settings,
    arguments: argparse.Namespace,
    sheets: Document,
) -> int:
    """Show and write the results; return the exit code."""
    from imu_bench.cli import table
    from imu_bench.offline.comparison import compare
    from imu_bench.offline.results import Analysis

    if not found:
        return FAULT
    compared = compare(found, settings.reference, sheets)
    asked: dict[str, Any] = {
        name: getattr(arguments, name) for name in ('topic', 'rate', 'columns', 'units', 'pair')
    }
    stated = settings.to_json() | asked | {'datasheets': sheets}
    analysis = Analysis(tuple(found), tuple(failures), stated, compared.to_json())
    # files first: the reader of a pipe (`| head`) may go before the table ends
    written = _write(analysis, arguments)
    table.show(analysis, compared, si=arguments.si)
    print(*written, sep='\n', end='\n' if written else '')
    severe = any(recording.health.severity == 'severe' for recording in found)
    if arguments.strict and severe:
        complain('a recording has severe findings (--strict)')
    named = [('--reference', settings.reference)] if settings.reference else []
    named += [('--datasheet', name) for name in sheets]
    unknown = [(option, name) for option, name in named if name not in compared.labels]
    for option, name in unknown:
        complain(f'{option} {name}: not among the sensors: {", ".join(compared.labels)}')
    return FAULT if failures or unknown or (arguments.strict and severe) else DONE


def _sheets(path: Path | None) -> Document:
    """Return the typical values in a file, if one is given."""
    if path is None:
        return {}
    from imu_bench.offline import datasheets

    return datasheets.read(path)


def _recordings(path: str, failures: list[Failure]) -> Sequence[Path]:
    """Return the recording named, or those found in a folder named."""
    from imu_bench.offline.failure import Failure
    from imu_bench.offline.recordings import find_recordings

    try:
        return find_recordings(path)
    except BenchError as error:
        complain(str(error))
        failures.append(Failure(path, str(error)))
        return ()


def _write(analysis: Analysis, arguments: argparse.Namespace) -> list[str]:
    """Write what was asked for, and return a line on each."""
    from imu_bench.offline import report, results

    written = []
    if arguments.json is not None:
        results.write(analysis, arguments.json)
        written.append(f'wrote {arguments.json}')
    if arguments.html is not None:
        report.write(analysis, arguments.html)
        written.append(f'wrote {arguments.html}')
    if arguments.figures is not None:
        from imu_bench.offline.figure_files.write import write as write_figures

        files = write_figures(analysis, arguments.figures)
        written.append(f'wrote {len(files)} files in {arguments.figures}')
    return written


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(',') if part.strip())
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{text!r} is not a list of seconds such as 0.1,1,10'
        ) from None


def _window(text: str) -> tuple[int, int]:
    try:
        first, last = (int(part) for part in text.split(':'))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{text!r} is not a pair of stamps such as 1700000000000000000:1700000600000000000'
        ) from None
    if not first < last:
        raise argparse.ArgumentTypeError('the first stamp must be before the last')
    return first, last
