# SPDX-License-Identifier: Apache-2.0
"""
What is told of the code by the code itself: the man page, and the pages of the reference.

`python docs/reference.py` renews docs/man/imu-bench.1; docs/conf.py has the rest written where
the site is built.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from imu_bench.cli.main import build_parser
from imu_bench.version import __version__

DOCS = Path(__file__).resolve().parent
MAN = DOCS / 'man' / 'imu-bench.1'


def verbs(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Yield name, summary and parser of each verb."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for said in action._choices_actions:
                yield said.dest, said.help or '', action.choices[said.dest]


def arguments(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """Yield how each argument of a parser is written, and what it means."""
    formatter = parser._get_formatter()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            continue
        names = action.option_strings or ['']
        if isinstance(action, argparse.BooleanOptionalAction) or action.nargs == 0:
            written = ', '.join(names)
        else:
            written = ', '.join(f'{name} {_value(action)}'.strip() for name in names)
        yield written, formatter._expand_help(action) if action.help else ''


def _value(action: argparse.Action) -> str:
    """Return how the value of an argument is written, the same with every version of Python."""
    named = action.metavar or (
        f'{{{",".join(map(str, action.choices))}}}'
        if action.choices
        else action.dest.upper() if action.option_strings else action.dest
    )  # fmt: skip
    name = ' '.join(named) if isinstance(named, tuple) else named
    return {'+': f'{name} [{name} ...]', '*': f'[{name} ...]', '?': f'[{name}]'}.get(
        str(action.nargs), name
    )


def man() -> str:
    """Return the man page, in the macros of man(7)."""
    parser = build_parser()
    lines = [
        f'.TH IMU\\-BENCH 1 "" "imu_bench {__version__}" "User Commands"',
        '.SH NAME',
        'imu\\-bench \\- which IMU to buy, and which noise numbers a filter needs',
        '.SH SYNOPSIS',
        '.B imu\\-bench',
        '.I VERB',
        '[\\fIOPTIONS\\fR]',
        '.SH DESCRIPTION',
        _roff(parser.description or ''),
        '.SH OPTIONS',
        *_listed(parser),
        '.SH VERBS',
    ]
    for name, summary, verb in verbs(parser):
        lines += [f'.SS {_roff(name)}', _roff(verb.description or f'{summary}.'), *_listed(verb)]
        *_, examples = (verb.epilog or '').partition('examples:\n')
        for example in examples.partition('\n\n')[0].splitlines():
            lines += ['.PP', '.EX', _roff(example.strip()), '.EE']
    lines += [
        '.SH ENVIRONMENT',
        *_item('NO_COLOR', 'if set, no colours'),
        *_item('COLUMNS', 'width of tables'),
        *_item('ROS_DOMAIN_ID', 'of the nodes that record and demo start'),
        '.SH EXIT STATUS',
        _roff((parser.epilog or '').removeprefix('exit codes: ')),
        '.SH SEE ALSO',
        '.BR ros2 (1)',
    ]
    return '\n'.join(lines) + '\n'


def _listed(parser: argparse.ArgumentParser) -> Iterator[str]:
    for written, meaning in arguments(parser):
        yield from _item(written, meaning)


def _item(written: str, meaning: str) -> Iterator[str]:
    yield from ('.TP', f'\\fB{_roff(written)}\\fR', _roff(meaning))


def _roff(text: str) -> str:
    """Return text none of which is a macro or an escape."""
    flat = ' '.join(text.split()).replace('\\', '\\e').replace('-', '\\-')
    return f'\\&{flat}' if flat.startswith(('.', "'")) else flat


if __name__ == '__main__':
    MAN.parent.mkdir(exist_ok=True)
    MAN.write_text(man(), encoding='utf-8')
