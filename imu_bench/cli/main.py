# SPDX-License-Identifier: Apache-2.0
"""
Entry point of `imu-bench`: finds the verbs, runs one, turns errors into one line.

A verb is a file in this folder that defines `register(verbs)`, which adds one parser whose
default `run` is the function to call.  Other files are helpers and are not imported; a verb
imports nothing heavy before it runs, so that help is there at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import difflib
from importlib import import_module
import io
import os
from pathlib import Path
import re
import sys
from typing import NoReturn

from imu_bench import __version__
from imu_bench.cli.words import clean, forgiving
from imu_bench.errors import BenchError, ConfigError, os_error_text

PACKAGE = 'imu_bench.cli'

DONE, FAULT, USAGE, INTERRUPTED = 0, 1, 2, 130
"""Exit codes: done; the input or the machine is at fault; wrong usage; stopped with Ctrl-C."""

_VERB = re.compile(r'^def register\(', re.MULTILINE)
_CHOICE = re.compile(r"invalid choice: '(?P<given>[^']*)' \(choose from (?P<known>.*)\)$")


class _Parser(argparse.ArgumentParser):
    """A parser that says which choice was probably meant, of verbs as of values."""

    def error(self, message: str) -> NoReturn:
        match = _CHOICE.search(message)
        known = re.findall(r'[\w-]+', match['known']) if match else []
        super().error(message + (_nearest(match['given'], known) if match else ''))


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run one verb and return the exit code.

    Examples
    --------
    >>> main([])  # doctest: +ELLIPSIS
    usage: imu-bench [-h] [--version] VERB ...
    2
    """
    _allow_every_character()
    parser = build_parser()
    arguments, unknown = parser.parse_known_args(argv)
    if unknown:
        arguments.usage_of.error(_unknown(unknown, arguments.usage_of))
    if arguments.run is None:
        parser.print_help()
        return USAGE
    try:
        code = int(arguments.run(arguments))
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print('imu-bench: stopped', file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of a pipe (`| head`) has gone; Python must not complain at exit either
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAULT
    except ConfigError as error:  # a problem a line
        complain('; '.join(str(error).splitlines()))
    except BenchError as error:
        complain(str(error))
    except MemoryError:
        complain('not enough memory for this recording: analyse a part of it (--start, --end)')
    except OSError as error:
        complain(os_error_text(error))
    return FAULT


def _allow_every_character() -> None:
    """Let a terminal or pipe that knows no µ show a question mark instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=forgiving())


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command with every verb found in this folder."""
    parser = _Parser(
        prog='imu-bench',
        description='Test bench for several IMUs: run it, record it, analyse it.',
        epilog='exit codes: 0 done, 1 the input or the machine is at fault, 2 wrong usage',
    )
    parser.add_argument('--version', action='version', version=f'imu-bench {__version__}')
    parser.set_defaults(run=None, usage_of=parser)
    verbs = parser.add_subparsers(title='verbs', metavar='VERB')
    for name in verb_names():
        import_module(f'{PACKAGE}.{name}').register(verbs)
    for verb in verbs.choices.values():
        verb.set_defaults(usage_of=verb)
    return parser


def _unknown(given: Sequence[str], parser: argparse.ArgumentParser) -> str:
    """
    Say which arguments a parser does not know, and which option was probably meant.

    Examples
    --------
    >>> parser = argparse.ArgumentParser()
    >>> _ = parser.add_argument('--duration'), parser.add_argument('--rate')
    >>> _unknown(['--duratoin=3s'], parser)
    "unrecognized arguments: --duratoin=3s; did you mean '--duration'?"
    >>> _unknown(['--start=3'], parser)
    'unrecognized arguments: --start=3'
    """
    text = f'unrecognized arguments: {" ".join(given)}'
    wrong = next((argument for argument in given if argument.startswith('--')), '')
    # compared without the dashes, which are alike in all
    options = re.findall(r'--([a-z][a-z-]*)', parser.format_help())
    return text + _nearest(wrong.partition('=')[0].lstrip('-'), options, '--')


def _nearest(given: str, known: Sequence[str], prefix: str = '') -> str:
    close = difflib.get_close_matches(given, known, n=1)
    return f'; did you mean {prefix + close[0]!r}?' if close else ''


def verb_names() -> list[str]:
    """
    Return the files of this folder that are verbs, told by their source, without importing them.

    Examples
    --------
    >>> 'analyze' in verb_names(), 'table' in verb_names()
    (True, False)
    """
    files = sorted(Path(__file__).parent.glob('*.py'))
    return [file.stem for file in files if _VERB.search(file.read_text(encoding='utf-8'))]


def complain(message: str) -> None:
    """Print one error line on stderr; characters that would steer a terminal are made visible."""
    print(f'imu-bench: error: {clean(" ".join(message.split()))}', file=sys.stderr)


if __name__ == '__main__':
    sys.exit(main())
