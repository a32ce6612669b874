# SPDX-License-Identifier: Apache-2.0
"""The tests of a bench: which scenarios are run how often, and the plan that analyses them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, NamedTuple

from imu_bench.config.schema import check_all, flatten, REQUIRED, Setting

_TEST = (
    Setting('name', REQUIRED, 'Short name of the test; its folder.'),
    Setting('title', '', 'What the test is, in one line.'),
    Setting('scenarios', REQUIRED, 'Scenarios to run.', kind='strs'),
    Setting('axes', (), 'Axes along which each scenario is run; its own if none.', kind='strs'),
    Setting('repetitions', 1, 'How often each is run.', bounds=(1, 1000)),
    Setting('set', (), 'Settings of the scenarios, as NAME=VALUE.', kind='strs'),
    Setting(
        'duration', None, "Length of a run; the scenario's own by default.", (), (0.1, 3.2e7), 's',
        'quantity',
    ),
    Setting('plan', 'static', 'Plan that analyses the runs, as in `imu-bench analyze --plan`.'),
    Setting('reference', '', 'Sensor that the others are compared with.'),
    Setting(
        'storage', None, "Format of simulated runs, npy for columns; the recorder's by default.",
        allowed=('mcap', 'sqlite3', 'npy'),
    ),
    Setting('on_request', False, 'Whether the test is run only when it is named.'),
)  # fmt: skip
_ALSO = (
    Setting('name', REQUIRED, 'Last part of the names of these runs.'),
    Setting('scenarios', REQUIRED, 'Scenarios to run.', kind='strs'),
    Setting('set', (), 'Settings of these scenarios, as NAME=VALUE.', kind='strs'),
)
_SHORT = (
    Setting('scenarios', None, 'Scenarios of the short form.', kind='strs'),
    Setting('axes', None, 'Axes of the short form.', kind='strs'),
    Setting('repetitions', None, 'Repetitions of the short form.', bounds=(1, 1000), kind='int'),
    Setting('set', None, 'More settings of the scenarios.', kind='strs'),
    Setting('duration', None, 'Length of a run.', (), (0.1, 3.2e7), 's', 'quantity'),
)


class Run(NamedTuple):
    """One run of a test."""

    name: str  # its folder: scenario, axis and repetition
    scenario: str
    overrides: tuple[str, ...]  # settings of the scenario, as NAME=VALUE
    seed: int  # another run of the same sensors


class ExtraRuns(NamedTuple):
    """More runs of a test, each once along every axis: what the others are compared with."""

    name: str  # last part of their names
    scenarios: tuple[str, ...]
    overrides: tuple[str, ...]  # settings of these scenarios, as NAME=VALUE


@dataclass(frozen=True)
class BenchTest:
    """One test of a bench, checked."""

    name: str
    title: str
    scenarios: tuple[str, ...]
    axes: tuple[str, ...] = ()
    repetitions: int = 1
    overrides: tuple[str, ...] = ()  # settings of the scenarios, as NAME=VALUE
    duration_s: float | None = None  # length of a run; the scenario's own if None
    plan: str = 'static'
    reference: str = ''
    storage: str | None = None  # format of simulated runs; that of the bench's recorder if None
    settings: Mapping[str, str] = field(default_factory=dict)  # of the plan
    on_request: bool = False  # whether it is run only when it is named
    also: ExtraRuns | None = None  # more runs of it
    # by sensor what it is set to in this test, with dotted names
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    # short, live: what its short form changes, and what the form does that runs in about a minute
    short: Mapping[str, Any] = field(default_factory=dict)
    live: Mapping[str, Any] = field(default_factory=dict)
    form: str = ''  # what its short form has changed

    def shortened(self) -> BenchTest:
        """Return the short form of this test; the same if it has none."""
        short = self._changed(self.short)
        changes = '; '.join(_changes(self, short))
        return replace(short, form=changes)

    def made_live(self) -> BenchTest:
        """Return the form of this test that a demo has time for; the same if it has none."""
        return self._changed(self.live)

    def _changed(self, form: Mapping[str, Any]) -> BenchTest:
        changed: dict[str, Any] = {
            name: form[name]
            for name in ('scenarios', 'axes', 'repetitions')
            if form.get(name) is not None
        }
        if form.get('duration') is not None:
            changed['duration_s'] = form['duration'][0]
        if form.get('set') is not None:
            changed['overrides'] = (*self.overrides, *form['set'])
        return BenchTest(**{**vars(self), **changed})

    def runs(self, seed: int = 0) -> Iterator[Run]:
        """
        Yield the runs: every scenario along every axis, as often as it is repeated.

        Examples
        --------
        >>> test = BenchTest('shake', '', ('sine',), ('x', 'y'), repetitions=2)
        >>> [run.name for run in test.runs()]
        ['sine_x_1', 'sine_x_2', 'sine_y_1', 'sine_y_2']
        """
        several = [str(number) for number in range(1, self.repetitions + 1)]
        axes = self.axes or ('',)
        every = list(product(self.scenarios, axes, several if several[1:] else ['']))
        ordinary = len(every)
        if self.also is not None:
            every += product(self.also.scenarios, axes, [self.also.name])
        for number, (scenario, axis, last) in enumerate(every):
            own = (f'axis={axis}',) if axis else ()
            more = self.also.overrides if self.also and number >= ordinary else ()
            name = '_'.join(filter(None, (scenario, axis, last)))
            yield Run(name, scenario, (*own, *self.overrides, *more), seed + number)


def _changes(test: BenchTest, short: BenchTest) -> Iterator[str]:
    """Say in what a form differs from the test."""
    if short.duration_s != test.duration_s:
        own = 'the length of its scenario' if test.duration_s is None else f'{test.duration_s:g} s'
        yield f'a run of {short.duration_s:g} s instead of {own}'
    if short.repetitions != test.repetitions:
        yield f'repetitions {short.repetitions} instead of {test.repetitions}'
    for name in ('scenarios', 'axes'):
        one, other = getattr(short, name), getattr(test, name)
        if one != other:
            yield f'{name} {", ".join(one)} instead of {", ".join(other) or "their own"}'
    if added := short.overrides[len(test.overrides) :]:
        yield f'with {", ".join(added)}'


def read_tests(entries: object, where: str, problems: list[str]) -> tuple[BenchTest, ...]:
    """Return the tests that a bench lists; every problem is added to `problems`."""
    if entries is None:
        return ()
    if not isinstance(entries, list):
        problems.append(f"{where}: {entries!r} is no list of tests like '- name: static'")
        return ()
    tests = [
        test
        for index, entry in enumerate(entries)
        if (test := _test(entry, f'{where}[{index}]', problems)) is not None
    ]
    names = [test.name for test in tests]
    problems.extend(
        f'{where}: {name!r} is there twice; give another name'
        for name in sorted({name for name in names if names.count(name) > 1})
    )
    return tuple(tests)


def _test(entry: object, where: str, problems: list[str]) -> BenchTest | None:
    if not isinstance(entry, Mapping):
        problems.append(f"{where}: {entry!r} is no test like '- name: static'")
        return None
    given = dict(entry)
    named = 'settings', 'also', 'sensors', 'short', 'live'
    parts = {name: given.pop(name, None) or {} for name in named}
    before = len(problems)
    for name, part in parts.items():
        if not isinstance(part, Mapping):
            problems.append(f'{where}.{name}: {part!r} is no mapping of settings')
            return None
    values = check_all(dict(flatten(given)), _TEST, where, problems)
    forms = {
        name: check_all(dict(flatten(parts[name])), _SHORT, f'{where}.{name}', problems)
        for name in ('short', 'live')
    }
    more = parts['also'] and check_all(
        dict(flatten(parts['also'])), _ALSO, f'{where}.also', problems
    )
    for name, part in parts['sensors'].items():
        if not isinstance(part, Mapping):
            problems.append(f'{where}.sensors.{name}: {part!r} is no mapping of settings')
    if len(problems) > before:
        return None
    duration = values.pop('duration')
    return BenchTest(
        overrides=values.pop('set'),
        duration_s=None if duration is None else duration[0],
        settings={str(name): str(value) for name, value in parts['settings'].items()},
        also=ExtraRuns(more['name'], more['scenarios'], more['set']) if more else None,
        sensors={name: dict(flatten(part)) for name, part in parts['sensors'].items()},
        short=forms['short'],
        live=forms['live'],
        **values,
    )
