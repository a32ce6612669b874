# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze`: health, noise metrics and a report of one or several recordings."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imu_bench.cli.main import complain, DONE, FAULT, os_error_text
from imu_bench.errors import BenchError, RecordingError

if TYPE_CHECKING:
    from imu_bench.offline.analyse import Settings
    from imu_bench.offline.recordings import ReadOptions
    from imu_bench.offline.results import Analysis, Failure, RecordingResult

_DESCRIPTION = """\
Reads ROS 2 bags, ROS 1 bags and text files, checks the health of every Imu topic, and measures
statistics, noise density, Allan deviation and the coefficients N, B and K of every axis.
Several inputs give one result that compares them."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'analyze', help='health and noise metrics of recordings', description=_DESCRIPTION
    )
    parser.add_argument(
        'inputs', nargs='+', metavar='INPUT', help='bag, CSV, or a folder with some'
    )
    parser.add_argument(
        '--topic', action='append', default=[], metavar='T', help='only this topic (repeatable)'
    )
    parser.add_argument(
        '--rate', type=float, metavar='HZ', help='sample rate of a text file without a time column'
    )
    parser.add_argument(
        '--tau', type=_numbers, default=(), metavar='S[,S…]', help='averaging times in s'
    )
    parser.add_argument(
        '--columns', metavar='NAMES', help='columns of a text file: names in order, - to ignore'
    )
    parser.add_argument(
        '--units', metavar='NAME=UNIT,…', help='units of the columns, as in angular_velocity=deg/s'
    )
    parser.add_argument('--start', type=float, metavar='S', help='begin, s after the first sample')
    parser.add_argument('--end', type=float, metavar='S', help='end, s after the first sample')
    parser.add_argument(
        '--window', type=_window, metavar='NS:NS', help='first and last stamp in ns, both included'
    )
    parser.add_argument('--reference', default='', metavar='NAME', help='sensor for the ratios')
    parser.add_argument('--si', action='store_true', help='table in SI instead of datasheet units')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write the report')
    parser.add_argument(
        '--strict', action='store_true', help='exit code 1 if a severe finding was made'
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Analyse the inputs and return the exit code."""
    # imported here: help must not wait for scipy
    from imu_bench.cli import table
    from imu_bench.offline import results
    from imu_bench.offline.analyse import Settings
    from imu_bench.offline.comparison import compare
    from imu_bench.offline.recordings import ReadOptions

    options = ReadOptions(
        topics=tuple(arguments.topic),
        rate_hz=arguments.rate,
        columns=arguments.columns,
        units=arguments.units,
    )
    settings = Settings(
        taus=arguments.tau,
        start_s=arguments.start,
        end_s=arguments.end,
        window_ns=arguments.window,
        reference=arguments.reference,
    )
    for output in (arguments.json, arguments.html):
        _check_output(output)

    found: list[RecordingResult] = []
    failures: list[results.Failure] = []
    for given in arguments.inputs:
        for path in _recordings(given, failures):
            found.extend(_analyse(path, options, settings, failures))
    if not found:
        return FAULT
    compared = compare(found, settings.reference)
    asked = {name: getattr(arguments, name) for name in ('topic', 'rate', 'columns', 'units')}
    analysis = results.Analysis(
        tuple(found), tuple(failures), settings.to_json() | asked, compared.to_json()
    )
    table.show(analysis, compared, si=arguments.si)
    _write(analysis, arguments)
    severe = any(recording.health.severity == 'severe' for recording in found)
    if arguments.strict and severe:
        complain('a recording has severe findings (--strict)')
    return FAULT if failures or (arguments.strict and severe) else DONE


def _recordings(path: str, failures: list[Failure]) -> Sequence[Path]:
    """Return the recording named, or those found in a folder named."""
    from imu_bench.offline.recordings import find_recordings

    try:
        return find_recordings(path)
    except BenchError as error:
        _fail(path, error, failures)
        return ()


def _analyse(
    path: Path, options: ReadOptions, settings: Settings, failures: list[Failure]
) -> Iterator[RecordingResult]:
    """Yield the results of every topic of one recording; what fails is reported and kept."""
    from imu_bench.cli.progress import Bar
    from imu_bench.offline.analyse import analyse
    from imu_bench.offline.recordings import load_all, open_source

    errors: list[BenchError | OSError] = []
    try:
        with Bar() as bar, open_source(path, options) as source:
            topics = source.select(options.topics)
            recordings = load_all(source, topics, bar.phase(f'reading {path.name}'))
            for recording in recordings:
                step = bar.phase(f'analysing {recording.topic}')
                try:
                    yield analyse(recording, settings, problems=source.problems, progress=step)
                except BenchError as error:
                    errors.append(error)
    except (BenchError, OSError) as error:
        errors.append(error)
    for problem in errors:
        _fail(path, problem, failures)


def _fail(path: str | Path, error: BenchError | OSError, failures: list[Failure]) -> None:
    from imu_bench.offline.results import Failure

    message = str(error) if isinstance(error, BenchError) else os_error_text(error)
    complain(message)
    failures.append(Failure(str(path), message))


def _write(analysis: Analysis, arguments: argparse.Namespace) -> None:
    from imu_bench.offline import report, results

    for output, write in ((arguments.json, results.write), (arguments.html, report.write)):
        if output is not None:
            write(analysis, output)
            print(f'wrote {output}')


def _check_output(path: Path | None) -> None:
    """Refuse an output that cannot be written before hours of work, not after."""
    if path is None:
        return
    if path.is_dir():
        raise RecordingError(f'{path} is a folder: name a file to write')
    if not path.parent.is_dir():
        raise RecordingError(f'{path}: the folder {path.parent} does not exist')


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
