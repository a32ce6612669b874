# SPDX-License-Identifier: Apache-2.0
"""`imu-bench list`: the names that other verbs take."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from imu_bench.terminal.words import DONE


def _files(folder: str) -> list[str]:
    from imu_bench.config.location import names_in

    return names_in(folder)


def _tests() -> list[str]:
    from imu_bench.bench import load_bench
    from imu_bench.config.location import named_file

    return [
        f'{bench} {test.name}: {test.title}'
        for bench in _files('benches')
        for test in load_bench(named_file('benches', bench)).tests
    ]


def _plans() -> list[str]:
    from imu_bench.offline import plans

    return plans.names()


def _drivers() -> list[str]:
    from imu_bench import drivers

    return list(drivers.names())


def _exports() -> list[str]:
    from imu_bench.cli.export import FORMATS, URDF

    return [*FORMATS, URDF]


_KINDS: dict[str, Callable[[], list[str]]] = {
    'benches': lambda: _files('benches'),
    'tests': _tests,
    'plans': _plans,
    'sensors': lambda: _files('sensors'),
    'drivers': _drivers,
    'scenarios': lambda: _files('scenarios'),
    'exports': _exports,
}


def names(kind: str) -> list[str]:
    """Return the names of a kind."""
    return _KINDS[kind]()


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add this verb."""
    parser = verbs.add_parser(
        'list',
        help='names of benches, tests, plans, sensors, …',
        description='Lists names that other verbs take, one a line; all kinds if none is named.',
    )
    parser.add_argument('kind', nargs='?', choices=tuple(_KINDS), help='what to list')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the names and return the exit code."""
    if arguments.kind is not None:
        print(*names(arguments.kind), sep='\n')
        return DONE
    for kind in _KINDS:
        print(f'{kind}:', *(f'  {name}' for name in names(kind)), sep='\n')
    return DONE
