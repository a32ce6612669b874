# SPDX-License-Identifier: Apache-2.0
"""
Entry point of `imu-bench`: finds the verbs, runs one, turns errors into one line.

A verb is a file in this folder that defines `register(verbs)`, which adds one parser whose
default `run` is the function to call; it imports nothing heavy before it runs, so that help is
there at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stdout
import difflib
from importlib import import_module
from importlib.util import find_spec
import io
import os
from pathlib import Path
import re
import shlex
import sys
from typing import NoReturn

from imu_bench.cli import completion
from imu_bench.counting import Silence
from imu_bench.errors import BenchError, ConfigError, os_error_text
from imu_bench.terminal.words import complain, FAULT, forgiving, INTERRUPTED, USAGE
from imu_bench.version import __version__

PACKAGE = 'imu_bench.cli'

_VERB = re.compile(r'^def register\(', re.MULTILINE)
_CHOICE = re.compile(r"invalid choice: '(?P<given>[^']*)' \(choose from (?P<known>.*)\)$")


_EXAMPLES = {
    'analyze': ('imu-bench analyze my_bag/ --html report.html',
                'imu-bench analyze log.csv --rate 100 --units angular_velocity=deg/s'),
    'campaign': ('imu-bench campaign mast_inclination --list',
                 'imu-bench campaign mast_inclination --short -o campaign'),
    'compare': ('imu-bench compare monday.json friday.json',
                'imu-bench compare cold/results.json warm/results.json --html runs.html'),
    'demo': ('imu-bench demo', 'imu-bench demo mast_inclination --test tilt'),
    'doctor': ('imu-bench doctor my_bench.yaml', 'imu-bench doctor --check my_bench.yaml'),
    'export': ('imu-bench export results.json --to kalibr --conservative',
               'imu-bench export results.json --to kalibr -o filters/'),
    'import': ('imu-bench import my_bag/ --topic /imu/data_raw -o imu.csv',
               'imu-bench import old_ros1.bag -o new_bag'),
    'list': ('imu-bench list', 'imu-bench list benches'),
    'record': ('imu-bench record my_imu.yaml -o my_bag --duration 20min',
               'imu-bench record my_bench.yaml --test static --into campaign'),
    'simulate': ('imu-bench simulate machine_vibration --duration 14h -o night',
                 'imu-bench simulate --from results.json --duration 1h -o twins'),
}  # fmt: skip
_OWN_DASHES = ('--columns',)
"""Options whose value may begin with a dash, which argparse takes for another option."""


_PRINTERS, _PRINTED = ('export', 'list'), ('json', 'list', 'setup')
"""Verbs and flags that are there for what they print."""

_QUIET = 'no tables, notes and progress: files, errors and the exit code'

_NAMED = ('BENCH', 'bench', '--plan')


class _Formatter(argparse.HelpFormatter):
    """Keeps the lines of examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith('examples:'):
            return text
        return super()._fill_text(text, width, indent)


class _Parser(argparse.ArgumentParser):
    """A parser that says which choice was probably meant, of verbs as of values."""

    def error(self, message: str) -> NoReturn:
        match = _CHOICE.search(message)
        known = re.findall(r'[\w-]+', match['known']) if match else []
        super().error(message + (_nearest(match['given'], known) if match else ''))


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    _allow_every_character()
    parser = build_parser()
    completion.offer(parser)
    given = _joined(sys.argv[1:] if argv is None else argv)
    arguments, unknown = parser.parse_known_args(given)
    arguments.command = shlex.join(['imu-bench', *given])
    if unknown:
        arguments.usage_of.error(_unknown(unknown, arguments.usage_of))
    if arguments.run is None:
        print(_what_next())
        return USAGE
    try:
        with redirect_stdout(Silence()) if _hushed(arguments) else nullcontext():
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


def _what_next() -> str:
    """Return what to try first on this machine."""
    steps = [
        ('analyze RECORDING --html report.html', 'a bag, CSV, array of yours'),
        ('simulate machine_vibration -o night', 'six sensors, without waiting'),
        ('doctor', 'what this computer has'),
        ('list', 'benches, tests, plans, sensors'),
        ('--help', 'verbs; VERB --help: options'),
    ]
    last = 'ROS 2 is not installed here, or not sourced: all but nodes and the demo works.'
    if find_spec('rclpy') is not None:
        steps.insert(0, ('demo', 'six emulated sensors live'))
        last = ''
    title = f'imu-bench {__version__}: which IMU to buy, and which noise numbers a filter needs'
    lines = [f'  imu-bench {step:37} {what}' for step, what in steps]
    return '\n'.join([title, '', *lines, *filter(None, [last])])


def _hushed(arguments: argparse.Namespace) -> bool:
    """Return whether nothing is to be told; what is asked to be printed is printed still."""
    asked = any(getattr(arguments, name, None) is True for name in _PRINTED)
    return getattr(arguments, 'quiet', False) and not asked


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
    parser.add_argument(
        '--completion', action=completion.PrintScript, choices=completion.SHELLS,
        help='print what makes the Tab key complete verbs, options and names: '
        'eval "$(imu-bench --completion bash)" in ~/.bashrc, or zsh in ~/.zshrc after compinit; '
        'imu-bench --completion fish | source in config.fish',
    )  # fmt: skip
    parser.set_defaults(run=None, usage_of=parser, command='')
    verbs = parser.add_subparsers(title='verbs', metavar='VERB')
    for name in verb_names():
        import_module(f'{PACKAGE}.{name}').register(verbs)
    for name, verb in verbs.choices.items():
        verb.set_defaults(usage_of=verb)
        verb.formatter_class = _Formatter
        if name not in _PRINTERS:
            verb.add_argument('-q', '--quiet', action='store_true', help=_QUIET)
        verb.epilog = '\n  '.join(('examples:', *_EXAMPLES[name]))
        if any(word in verb.format_usage() for word in _NAMED):
            verb.epilog += '\n\nnames of benches, plans, scenarios: imu-bench list'
    return parser


def _joined(given: Sequence[str]) -> list[str]:
    """
    Return arguments with values that begin with a dash tied to their options.

    Examples
    --------
    >>> _joined(['a.csv', '--columns', '-,-,ax', '--rate', '100'])
    ['a.csv', '--columns=-,-,ax', '--rate', '100']
    """
    joined: list[str] = []
    for argument in given:
        if joined and joined[-1] in _OWN_DASHES and ',' in argument:
            joined[-1] += f'={argument}'
        else:
            joined.append(argument)
    return joined


def _unknown(given: Sequence[str], parser: argparse.ArgumentParser) -> str:
    """Say which arguments a parser does not know, and which option was probably meant."""
    text = f'unrecognized arguments: {" ".join(given)}'
    wrong = next((argument for argument in given if argument.startswith('--')), '')
    # compared without the dashes, which are alike in all
    options = re.findall(r'--([a-z][a-z-]*)', parser.format_help())
    return text + _nearest(wrong.partition('=')[0].lstrip('-'), options, '--')


def _nearest(given: str, known: Sequence[str], prefix: str = '') -> str:
    close = difflib.get_close_matches(given, known, n=1)
    return f'; did you mean {prefix + close[0]!r}?' if close else ''


def verb_names() -> list[str]:
    """Return the files of this folder that are verbs, by their source, without importing them."""
    files = sorted(Path(__file__).parent.glob('*.py'))
    return [file.stem for file in files if _VERB.search(file.read_text(encoding='utf-8'))]


if __name__ == '__main__':
    sys.exit(main())
