# SPDX-License-Identifier: Apache-2.0
"""What a demo moves its bench by: a test of the bench made short, or a scenario."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imu_bench.config import BenchConfig
from imu_bench.config.campaign import BenchTest, Run
from imu_bench.errors import ConfigError
from imu_bench.simulation.scenario import load_scenario, Scenario, scenario_document
import yaml

NOT_YET = 1e10
"""Unix time, s, at which a scenario begins of which nobody knows yet when it will."""


@dataclass(frozen=True, eq=False)
class LiveTest:
    """A scenario for a demo, and what is made of the recording."""

    # name, overrides: of the scenario, with the settings that it is run with
    name: str
    overrides: tuple[str, ...]
    scenario: Scenario
    duration_s: float  # how long it runs
    # the test it belongs to, whose plan analyses the recording; None for a scenario alone
    test: BenchTest | None = None
    remark: str = ''  # what the user should know about it, one line

    def write(self, folder: Path) -> dict[str, Any]:
        """Write the scenario into a folder; return the parameters that make a sensor follow it."""
        folder.mkdir()
        path = folder / f'{self.scenario.name}.yaml'
        document = scenario_document(self.name, self.overrides)
        text = yaml.safe_dump(document, allow_unicode=True, sort_keys=False)
        path.write_text(text, encoding='utf-8')
        return {'simulation.scenario': str(path.resolve()), 'simulation.begin': NOT_YET}

    def analysis(self) -> list[str]:
        """Return the arguments of `imu-bench analyze` that run the plan of the test."""
        return [] if self.test is None else plan_arguments(self.test)


def plan_arguments(test: BenchTest) -> list[str]:
    """Return the arguments of `imu-bench analyze` that run the plan of a test."""
    settings = [f'{name}={value}' for name, value in test.settings.items()]
    flags = [word for setting in settings for word in ('--set', setting)]
    reference = ['--reference', test.reference] if test.reference else []
    return ['--plan', test.plan, *flags, *reference]


def of_test(bench: BenchConfig, name: str, duration_s: float) -> LiveTest:
    """
    Return the first run of a test in a form that fits a duration.

    That is the test as it is, or its live form, or its short form; one that may be stopped at
    any time is.

    Raises
    ------
    ConfigError
        If there is no such test, or none of its forms fits.
    """
    from imu_bench.offline import plans  # with all of the analysis, which a scenario does not need

    test = bench.test(name)
    plans.load(test.plan)(test.settings, reference=test.reference)  # bad settings show now
    lengths = []
    for form in (test, test.made_live(), test.shortened()):
        run = next(form.runs())
        scenario = load_scenario(run.scenario, overrides=run.overrides)
        wanted = form.duration_s or scenario.duration_s
        length = min(wanted or duration_s, duration_s) if scenario.endless else wanted
        if length is not None and length <= duration_s:
            remark = '; '.join(_remarks(test, form, run, length))
            return LiveTest(run.scenario, run.overrides, scenario, length, test, remark)
        lengths.append(length or 0.0)
    raise ConfigError(
        f'test {name} takes {min(lengths):.0f} s at least, not {duration_s:g} s; give a longer '
        '--duration, or a form that is short enough under live: in the file of the bench'
    )


def _remarks(test: BenchTest, form: BenchTest, run: Run, length_s: float) -> Iterator[str]:
    """Say what of a test is run."""
    count = len(list(test.runs()))
    yield f'scenario {run.scenario} for {length_s:.3g} s'
    if count > 1:
        yield f'one of {count} runs'
    changed = form.overrides[len(test.overrides) :]
    if changed:
        yield f'made short with {", ".join(changed)}'
    elif test.duration_s is not None and test.duration_s > length_s:
        yield f'the test takes {test.duration_s:g} s'


def of_scenario(name: str, overrides: Sequence[str], duration_s: float) -> LiveTest:
    """
    Return a scenario that runs as long as there is time.

    Raises
    ------
    ConfigError
        If there is no such scenario.
    """
    scenario = load_scenario(name, overrides=overrides)
    wanted = scenario.duration_s
    remark = f'scenario {scenario.name} for {duration_s:g} s'
    if wanted is not None and wanted > duration_s:
        remark += f' of its {wanted:.4g} s'
    return LiveTest(name, tuple(overrides), scenario, duration_s, None, remark)
