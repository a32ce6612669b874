# SPDX-License-Identifier: Apache-2.0
"""`imu-bench campaign`: every test of a bench, simulated or recorded, analysed by its plan."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from imu_bench.errors import BenchError, ConfigError, RecordingError
from imu_bench.terminal.words import complain, DONE, FAULT

if TYPE_CHECKING:
    from imu_bench.config import BenchConfig
    from imu_bench.config.campaign import BenchTest, Run
    from imu_bench.offline.presentation.pages import Chapter

_DESCRIPTION = """\
Runs the tests that a bench lists: simulates every run that is not there yet, analyses the runs of
each test with its plan, and writes one report per test and a page that leads to them.  Recordings
of a real bench, put into the folders that --list names, are analysed in the same way."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'campaign', help='all tests of a bench, each with its report', description=_DESCRIPTION
    )
    parser.add_argument('bench', metavar='BENCH', help='a bench of config/benches or a YAML file')
    parser.add_argument(
        '--test', action='append', default=[], metavar='NAME', help='only this test (repeatable)'
    )
    parser.add_argument('--list', action='store_true', help='show tests and folders, do nothing')
    parser.add_argument(
        '--short', action='store_true', help='the short form of every test: minutes, not hours'
    )
    parser.add_argument(
        '--recorded', action='store_true', help='analyse what is there; simulate nothing'
    )
    parser.add_argument(
        '--storage', choices=('mcap', 'sqlite3', 'npy'),
        help="format of simulated runs, npy for columns alone (default the test's or the bench's)",
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of the first run')
    parser.add_argument('--jobs', type=int, metavar='N', help='processes; one per core by default')
    parser.add_argument('-o', '--output', type=Path, metavar='DIR', help='where everything goes')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the campaign; return 0 if every test has its result."""
    # imported here: help must not wait for scipy
    from imu_bench import bench
    from imu_bench.config.location import named_file

    config = bench.load_bench(named_file('benches', arguments.bench))
    tests = _chosen(config, arguments)
    if arguments.list:
        _show(config, tests, arguments)
        return DONE
    if arguments.output is None:
        raise ConfigError('where to? Name a folder with -o DIR')
    from imu_bench.offline.presentation.pages import Chapter, write_campaign

    arguments.output.mkdir(parents=True, exist_ok=True)
    chapters: list[Chapter] = []
    for test in tests:
        print(f'{test.name}: {test.title or ", ".join(test.scenarios)}')
        if test.form:
            print(f'  short form: {test.form}')
        try:
            chapters.append(_conduct(config, test, arguments))
        except BenchError as error:
            complain(f'test {test.name}: {error}')
            chapters.append(Chapter(test.name, test.title, test.plan, failure=str(error)))
    index = arguments.output / 'index.html'
    write_campaign(config.title or config.name, chapters, index)
    print(f'wrote {index}')
    return FAULT if any(chapter.failed for chapter in chapters) else DONE


def _chosen(config: BenchConfig, arguments: argparse.Namespace) -> list[BenchTest]:
    """Return the tests that were asked for, in the order of the bench."""
    for name in arguments.test or [test.name for test in config.tests[:1]] or ['']:
        config.test(name)
    chosen = [
        test
        for test in config.tests
        if (test.name in arguments.test if arguments.test else not test.on_request)
    ]
    return [test.shortened() if arguments.short else test for test in chosen]


def _show(config: BenchConfig, tests: list[BenchTest], arguments: argparse.Namespace) -> None:
    base = arguments.output or Path('DIR')
    for test in tests:
        print(f'{test.name}: {test.title}')
        print(f'  plan {test.plan}' + (f', reference {test.reference}' if test.reference else ''))
        for one in test.runs(arguments.seed):
            print(f'  {base / test.name / one.name}')
    left = [t.name for t in config.tests if t.on_request and t.name not in arguments.test]
    if left and not arguments.test:
        print(f'only with --test: {", ".join(left)}', file=sys.stderr)


def _conduct(config: BenchConfig, test: BenchTest, arguments: argparse.Namespace) -> Chapter:
    """Run one test and write its results."""
    from imu_bench import bench
    from imu_bench.offline import plans
    from imu_bench.offline.presentation.pages import Chapter
    from imu_bench.offline.recordings import find_recordings
    from imu_bench.terminal.working import run_test_plan

    config = bench.as_tested(config, test)
    # a setting that is wrong shall not be found after hours of simulation
    plans.load(test.plan)(test.settings, reference=test.reference)
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
    result = run_test_plan(test, paths, folder, arguments.jobs)
    for sentence in result.summary:
        print(f'  {sentence}')
    return Chapter(
        test.name, test.title, test.plan, result, f'{test.name}/report.html', len(wanted)
    )


def _simulate(
    config: BenchConfig, test: BenchTest, missing: list[Run], folder: Path, storage: str
) -> None:
    """Write the runs; one that is broken off leaves nothing that looks finished."""
    from imu_bench import bench
    from imu_bench.offline.whole_files import whole_folder
    from imu_bench.simulation import recording
    from imu_bench.simulation.scenario import load_scenario
    from imu_bench.terminal.progress import Bar

    folder.mkdir(parents=True, exist_ok=True)
    write = recording.writer(storage)
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
                write(draft, sensors, scenario, length, run=run.seed, progress=step)
