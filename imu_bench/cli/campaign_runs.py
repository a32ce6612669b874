# SPDX-License-Identifier: Apache-2.0
"""One test of a campaign: its runs simulated where they are missing, and its plan run on them."""

from __future__ import annotations

import argparse
from pathlib import Path

from imu_bench import bench
from imu_bench.cli.main import complain
from imu_bench.cli.progress import Bar
from imu_bench.cli.running import within_memory
from imu_bench.config import BenchConfig
from imu_bench.config.campaign import BenchTest, Run
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.offline import plan_runs, plans
from imu_bench.offline.pipeline import Order
from imu_bench.offline.plans.result import write as write_json
from imu_bench.offline.recordings import find_recordings, ReadOptions
from imu_bench.offline.report.campaign_page import Chapter
from imu_bench.offline.report.plan_page import write as write_page
from imu_bench.offline.settings import Settings
from imu_bench.offline.whole_files import whole_folder
from imu_bench.offline.workers import Processes, usable_cores
from imu_bench.simulation import recording
from imu_bench.simulation.scenario import load_scenario


def conduct(config: BenchConfig, test: BenchTest, arguments: argparse.Namespace) -> Chapter:
    """
    Run one test and write its results.

    Raises
    ------
    ConfigError
        If its plan or its scenarios do not exist, or a setting is not allowed.
    RecordingError
        If runs are missing that were to be recorded, or the plan finds nothing in them.
    """
    plan = plans.load(test.plan)(test.settings, reference=test.reference)
    folder = arguments.output / test.name
    wanted = list(test.runs(arguments.seed))
    missing = [run for run in wanted if not (folder / run.name).exists()]
    if missing and arguments.recorded:
        names = ', '.join(str(folder / run.name) for run in missing[:3])
        raise RecordingError(
            f'{len(missing)} of {len(wanted)} runs are missing, such as {names}: record them '
            'there, or leave out --recorded'
        )
    storage = arguments.storage or test.storage or config.recorder.storage
    _simulate(config, test, missing, folder, storage)
    paths = [path for run in wanted for path in find_recordings(folder / run.name)]
    order = Order(ReadOptions(), Settings(reference=test.reference))
    jobs = within_memory(arguments.jobs or usable_cores())
    with Processes(jobs) as team, Bar() as bar:
        job = plan_runs.Job(paths, order, team, bar.phase, lambda found: complain(found.error))
        result = plan_runs.run(plan, job)
    report = folder / 'report.html'
    write_json(result, folder / 'results.json')
    write_page(result, report)
    for sentence in result.summary:
        print(f'  {sentence}')
    return Chapter(
        test.name, test.title, test.plan, result, f'{test.name}/report.html', len(wanted)
    )


def _simulate(
    config: BenchConfig, test: BenchTest, missing: list[Run], folder: Path, storage: str
) -> None:
    """Write the runs; one that is broken off leaves nothing that looks finished."""
    folder.mkdir(parents=True, exist_ok=True)
    with Bar() as bar:
        for number, run in enumerate(missing, 1):
            step = bar.phase(f'{test.name}: simulating run {number} of {len(missing)}')
            scenario = load_scenario(run.scenario, seed=run.seed, overrides=run.overrides)
            length = test.duration_s or scenario.duration_s
            if length is None:
                raise ConfigError(
                    f'test {test.name}: scenario {run.scenario} has no end; give a duration'
                )
            sensors = [bench.simulate(one, scenario, run=run.seed) for one in config.sensors]
            with whole_folder(folder / run.name) as draft:
                recording.write(
                    draft, sensors, scenario, length,
                    storage=storage, run=run.seed, progress=step,
                )  # fmt: skip
