# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze`: health, noise metrics and a report of one or several recordings."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imu_bench.errors import BenchError, ConfigError
from imu_bench.offline import stages
from imu_bench.terminal.arguments import (
    add_reading,
    check_folder,
    check_outputs,
    moment,
    read_options,
)
from imu_bench.terminal.words import complain, DONE, FAULT

if TYPE_CHECKING:
    from imu_bench.offline.analysis.results import Analysis
    from imu_bench.offline.analysis.settings import Failure, Settings
    from imu_bench.offline.comparing.sensors import Datasheets
    from imu_bench.offline.plans.result import PlanResult
    from imu_bench.offline.recordings import ReadOptions

_ASKED = ('topic', 'rate', 'columns', 'units', 'pair')
"""What a result says that was asked for, beside the settings."""

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
    parser.add_argument(
        '--profile', action='store_true', help='show what each stage took, time and memory'
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
        '--pool',
        action=argparse.BooleanOptionalAction,
        help='a topic in several recordings is one sensor: one curve and one set of numbers, and '
        'how far the runs differ; by default where bags tell the same serial number',
    )
    parser.add_argument(
        '--tau',
        type=_times,
        default=(),
        metavar='T[,T…]',
        help='averaging times, as in 0.1,1,5min',
    )
    parser.add_argument(
        '--start', type=moment, metavar='T', help='begin so long after the first sample, as in 10s'
    )
    parser.add_argument(
        '--end', type=moment, metavar='T', help='end so long after the first sample, as in 2min'
    )
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
    parser.add_argument(
        '--confidence', type=float, metavar='LEVEL', help='of every interval; 0.95 by default'
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
    parser.add_argument(
        '--full', action='store_true', help='every finding, row and column on the terminal'
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write the report')
    parser.add_argument(
        '--figures', type=Path, metavar='DIR', help='write figures as SVG, PDF and PNG'
    )
    parser.add_argument(
        '--sheets', type=Path, metavar='DIR', help='write a measured datasheet of every sensor'
    )
    parser.add_argument('--pdf', action='store_true', help='the measured datasheets as PDF, too')
    parser.add_argument(
        '--strict', action='store_true', help='exit code 1 if a severe finding was made'
    )


def run(arguments: argparse.Namespace) -> int:
    """Analyse the inputs and return the exit code."""
    code = _analyse(arguments)
    if arguments.profile:
        print(stages.table())
    return code


def _analyse(arguments: argparse.Namespace) -> int:
    # imported here and below: help must not wait for scipy, nor reading for the report
    from imu_bench.offline.running import keep_freed_memory, one_thread_each

    one_thread_each()
    keep_freed_memory()
    from imu_bench.offline.analysis.pairing import joined
    from imu_bench.offline.analysis.settings import Settings
    from imu_bench.offline.recordings import grouped
    from imu_bench.offline.running.analyzing import conclude, measured
    from imu_bench.offline.running.pipeline import Order
    from imu_bench.terminal import working
    from imu_bench.terminal.progress import Bar

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
        **({} if arguments.confidence is None else {'confidence': arguments.confidence}),
    )
    sheets = _sheets(arguments.datasheet)
    _check_outputs(arguments)
    failures: list[Failure] = []
    found = [path for given in arguments.inputs for path in _recordings(given, failures)]
    paths, options = grouped(found, options)
    if arguments.plan is not None:
        return _run_plan(arguments, paths, options, settings, failures)
    with working.workers(arguments, paths) as workers:
        places = working.kept(arguments, paths)
        columns = None if places.columns is None else places.columns.absolute()
        order = Order(options, settings, columns)
        with Bar() as bar:
            results, failed = measured(paths, order, workers, places, working.watch(bar))
    if not results:
        return FAULT
    asked = {name: getattr(arguments, name) for name in _ASKED}
    asked['command'] = arguments.command
    results = joined(results, arguments.pair)
    if arguments.pool is not None:
        asked['pool'] = arguments.pool
    analysis = conclude(
        results, [*failures, *failed], settings, sheets=sheets, asked=asked, pool=arguments.pool
    )
    return _present(analysis, settings, arguments, sheets)


def _check_outputs(arguments: argparse.Namespace) -> None:
    check_outputs([arguments.json, arguments.html], arguments.inputs)
    if arguments.pdf and arguments.sheets is None:
        raise ConfigError('--pdf: of the measured datasheets; say where with --sheets DIR')
    for option, wanted in (('--figures', arguments.figures is not None), ('--pdf', arguments.pdf)):
        if wanted:
            from imu_bench.offline.presentation import require_matplotlib

            require_matplotlib(option)
    for folder in (arguments.figures, arguments.sheets):
        if folder is not None:
            check_folder(folder)


@stages.stage('page')
def _present(
    analysis: Analysis, settings: Settings, arguments: argparse.Namespace, sheets: Datasheets
) -> int:
    """Show and write the results; return the exit code."""
    from imu_bench.offline.comparing.sensors import compare
    from imu_bench.terminal import tables

    compared = compare(analysis.recordings, settings.reference, sheets)
    # files first: the reader of a pipe (`| head`) may go before the table ends
    written = _write(analysis, arguments)
    tables.show(analysis, compared, si=arguments.si, full=arguments.full)
    print(*written, sep='\n', end='\n' if written else '')
    severe = any(recording.health.severity == 'severe' for recording in analysis.sensors)
    if arguments.strict and severe:
        complain('a recording has severe findings (--strict)')
    named = [('--reference', settings.reference)] if settings.reference else []
    named += [('--datasheet', name) for name in sheets]
    unknown = [(option, name) for option, name in named if name not in compared.labels]
    for option, name in unknown:
        complain(f'{option} {name}: not among the sensors: {", ".join(compared.labels)}')
    return FAULT if analysis.failed or unknown or (arguments.strict and severe) else DONE


def _sheets(path: Path | None) -> Datasheets:
    """Return the typical values in a file, if one is given."""
    if path is None:
        return {}
    from imu_bench.offline.comparing.sensors import read_datasheets

    return read_datasheets(path)


def _recordings(path: str, failures: list[Failure]) -> Sequence[Path]:
    """Return the recording named, or those found in a folder named."""
    from imu_bench.offline.analysis.settings import Failure
    from imu_bench.offline.recordings import find_recordings

    try:
        return find_recordings(path)
    except BenchError as error:
        complain(str(error))
        failures.append(Failure(path, str(error)))
        return ()


def _write(analysis: Analysis, arguments: argparse.Namespace) -> list[str]:
    """Write what was asked for, and return a line on each."""
    from imu_bench import offline

    written = []
    if arguments.json is not None:
        offline.write_results(analysis, arguments.json)
        written.append(f'wrote {arguments.json}')
    if arguments.html is not None:
        offline.write_report(analysis, arguments.html)
        written.append(f'wrote {arguments.html}')
    if arguments.figures is not None:
        files = offline.write_figures(analysis, arguments.figures)
        written.append(f'wrote {len(files)} files in {arguments.figures}')
    if arguments.sheets is not None:
        from imu_bench.offline.presentation.pages import write_datasheets

        files = write_datasheets(analysis, arguments.sheets, pdf=arguments.pdf)
        written += [f'wrote {file}' for file in files]
    return written


def _times(text: str) -> tuple[float, ...]:
    return tuple(moment(part) for part in text.split(',') if part.strip())


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


def _run_plan(
    arguments: argparse.Namespace,
    paths: Sequence[Path],
    options: ReadOptions,
    settings: Settings,
    failures: Sequence[Failure],
) -> int:
    """Run a plan and return the exit code."""
    from imu_bench.offline import plans
    from imu_bench.offline.running import plan_runs
    from imu_bench.offline.running.mapped import MappedLimit
    from imu_bench.offline.running.pipeline import Order
    from imu_bench.offline.running.workers import MAPPED_BYTES
    from imu_bench.terminal.progress import Bar
    from imu_bench.terminal.tables import show_plan
    from imu_bench.terminal.working import kept, workers

    kind = plans.load(arguments.plan)
    plan = kind(
        _settings(arguments.set), reference=settings.reference, confidence=settings.confidence
    )
    if not paths:
        return FAULT
    with workers(arguments, paths) as team, Bar() as bar, MappedLimit(MAPPED_BYTES):
        order = Order(options, settings, kept(arguments, paths).columns)
        job = plan_runs.Job(
            paths, order, team, bar.phase, lambda found: complain(found.error), arguments.pair
        )
        try:
            result = plan_runs.run_plan(plan, job)
        except plan_runs.NothingMeasured:
            return FAULT  # why, has been said of each
    # files first: the reader of a pipe (`| head`) may go before the tables end
    with stages.stage('page'):
        written = _write_plan(result, arguments)
        show_plan(result, full=arguments.full)
    print(*written, sep='\n', end='\n' if written else '')
    severe = any(finding.severity == 'severe' for finding in result.findings)
    if arguments.strict and severe:
        complain('the plan has severe findings (--strict)')
    return FAULT if failures or result.failures or (arguments.strict and severe) else DONE


def _settings(given: Sequence[str]) -> Mapping[str, str]:
    """Return settings by name; one given twice counts as given last."""
    settings = {}
    for text in given:
        name, equals, value = text.partition('=')
        if not equals or not name.strip():
            raise ConfigError(f'--set {text}: write it as NAME=VALUE')
        settings[name.strip()] = value.strip()
    return settings


def _write_plan(result: PlanResult, arguments: argparse.Namespace) -> list[str]:
    """Write what was asked for, and return a line on each."""
    written = []
    if arguments.json is not None:
        from imu_bench.offline.plans.result import write

        write(result, arguments.json)
        written.append(f'wrote {arguments.json}')
    if arguments.html is not None:
        from imu_bench.offline.presentation.pages import write_plan

        write_plan(result, arguments.html)
        written.append(f'wrote {arguments.html}')
    if arguments.figures is not None:
        from imu_bench.offline.presentation import figure_files

        files = figure_files.write_plan(result, arguments.figures)
        written.append(f'wrote {len(files)} files in {arguments.figures}')
    return written
