# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze --plan`: recordings through a test plan, shown and written."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from imu_bench.cli.main import complain, DONE, FAULT
from imu_bench.cli.plan_view import show
from imu_bench.cli.progress import Bar
from imu_bench.cli.running import kept, workers
from imu_bench.errors import ConfigError
from imu_bench.offline import plan_runs, plans
from imu_bench.offline.failure import Failure
from imu_bench.offline.mapped import Residency
from imu_bench.offline.pipeline import Order
from imu_bench.offline.plans.result import PlanResult, write
from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.settings import Settings
from imu_bench.offline.workers import MAPPED_BYTES


def run(
    arguments: argparse.Namespace,
    paths: Sequence[Path],
    options: ReadOptions,
    settings: Settings,
    failures: Sequence[Failure],
) -> int:
    """
    Run a plan and return the exit code.

    Raises
    ------
    ConfigError
        If there is no such plan, or a setting of it is not allowed.
    RecordingError
        If the recordings do not hold what the plan needs.
    """
    kind = plans.load(arguments.plan)
    plan = kind(_settings(arguments.set), reference=settings.reference)
    if not paths:
        return FAULT
    with workers(arguments, paths) as team, Bar() as bar, Residency(MAPPED_BYTES):
        order = Order(options, settings, kept(arguments, paths).columns)
        job = plan_runs.Job(
            paths, order, team, bar.phase, lambda found: complain(found.error), arguments.pair
        )
        try:
            result = plan_runs.run(plan, job)
        except plan_runs.NothingMeasured:
            return FAULT  # why, has been said of each
    # files first: the reader of a pipe (`| head`) may go before the tables end
    written = _write(result, arguments)
    show(result)
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


def _write(result: PlanResult, arguments: argparse.Namespace) -> list[str]:
    """Write what was asked for, and return a line on each."""
    written = []
    if arguments.json is not None:
        write(result, arguments.json)
        written.append(f'wrote {arguments.json}')
    if arguments.html is not None:
        from imu_bench.offline.report.plan_page import write as write_page

        write_page(result, arguments.html)
        written.append(f'wrote {arguments.html}')
    if arguments.figures is not None:
        from imu_bench.offline.figure_files.plan import write as write_figures

        files = write_figures(result, arguments.figures)
        written.append(f'wrote {len(files)} files in {arguments.figures}')
    return written
