# SPDX-License-Identifier: Apache-2.0
"""What a shell offers when Tab is pressed: verbs and options by argcomplete, and our names."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import os
from typing import Any

from imu_bench.cli.list_ import names
from imu_bench.errors import BenchError

SHELLS = ('bash', 'zsh', 'fish')

_ASKED = '_ARGCOMPLETE'
"""Set by a shell that asks: kislyuk/argcomplete, argcomplete/shell_integration.py."""

_KINDS = {'bench': 'benches', 'plan': 'plans', 'scenario': 'scenarios'}
_FILES = ('yaml', 'yml')


class PrintScript(argparse.Action):
    """Prints what a shell evaluates to complete the command, and ends."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: Any, values: Any, option: Any = None
    ) -> None:
        """Print the script of the shell that was named."""
        from argcomplete.shell_integration import shellcode

        print(shellcode([parser.prog], shell=values), end='')
        parser.exit()


def offer(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks what fits, and end; do nothing if the command is to run."""
    if _ASKED in os.environ:
        from argcomplete import autocomplete

        # the type of a completer is narrower in its annotations than what it calls
        autocomplete(parser, default_completer=_values)  # type: ignore[arg-type]


def _values(
    prefix: str, action: argparse.Action, parsed_args: argparse.Namespace, **_: Any
) -> Iterable[str]:
    """Return what may stand for an argument: names that are known, or files."""
    from argcomplete.completers import FilesCompleter

    files = FilesCompleter(_FILES if action.dest in _KINDS else ())
    found: list[str] = []
    if action.dest == 'test':
        found = _tests(getattr(parsed_args, 'bench', None))
    elif action.dest in _KINDS:
        found = names(_KINDS[action.dest])
    return [name for name in found if name.startswith(prefix)] or files(prefix)


def _tests(bench: str | None) -> list[str]:
    from imu_bench.bench import load_bench
    from imu_bench.config.location import named_file

    try:
        config = load_bench(named_file('benches', bench)) if bench else None
    except BenchError:  # said when the command runs; a line amid what is being typed helps nobody
        config = None
    return [] if config is None else [test.name for test in config.tests]
