# SPDX-License-Identifier: Apache-2.0
"""The tests of a bench: which scenarios are run how often, and the plan that analyses them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
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
    """
    One run of a test.

    Attributes
    ----------
    name : str
        Its folder: scenario, axis and repetition.
    scenario : str
    overrides : tuple of str
        Settings of the scenario, as NAME=VALUE.
    seed : int
        Another run of the same sensors.
    """

    name: str
    scenario: str
    overrides: tuple[str, ...]
    seed: int


class Also(NamedTuple):
    """
    More runs of a test, each once along every axis: what the others are compared with.

    Attributes
    ----------
    name : str
        Last part of their names.
    scenarios : tuple of str
    overrides : tuple of str
        Settings of these scenarios, as NAME=VALUE.
    """

    name: str
    scenarios: tuple[str, ...]
    overrides: tuple[str, ...]


@dataclass(frozen=True)
class BenchTest:
    """
    One test of a bench, checked.

    Attributes
    ----------
    name, title : str
    scenarios, axes : tuple of str
    repetitions : int
    overrides : tuple of str
        Settings of the scenarios, as NAME=VALUE.
    duration_s : float or None
        Length of a run; the scenario's own if None.
    plan, reference : str
    storage : str or None
        Format of simulated runs; that of the bench's recorder if None.
    settings : mapping of str to str
        Of the plan.
    on_request : bool
        Whether it is run only when it is named.
    also : Also, optional
        More runs of it.
    short, live : mapping of str to object
        What its short form changes, and what the form does that runs in about a minute.
    """

    name: str
    title: str
    scenarios: tuple[str, ...]
    axes: tuple[str, ...] = ()
    repetitions: int = 1
    overrides: tuple[str, ...] = ()
    duration_s: float | None = None
    plan: str = 'static'
    reference: str = ''
    storage: str | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    on_request: bool = False
    also: Also | None = None
    short: Mapping[str, Any] = field(default_factory=dict)
    live: Mapping[str, Any] = field(default_factory=dict)

    def shortened(self) -> BenchTest:
        """Return the short form of this test; the same if it has none."""
        return self._changed(self.short)

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
    parts = {name: given.pop(name, None) or {} for name in ('settings', 'also', 'short', 'live')}
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
    if len(problems) > before:
        return None
    duration = values.pop('duration')
    return BenchTest(
        overrides=values.pop('set'),
        duration_s=None if duration is None else duration[0],
        settings={str(name): str(value) for name, value in parts['settings'].items()},
        also=Also(more['name'], more['scenarios'], more['set']) if more else None,
        short=forms['short'],
        live=forms['live'],
        **values,
    )
