# SPDX-License-Identifier: Apache-2.0
"""
What is told of the code by the code itself: the man page, and the pages of the reference.

`python docs/reference.py` renews docs/man/imu-bench.1; docs/conf.py has the rest written where
the site is built.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
import gzip
from importlib.util import find_spec
import json
from pathlib import Path
import re
from typing import Any

import imu_bench
from imu_bench import drivers
from imu_bench.cli.main import build_parser
from imu_bench.config.schema import REQUIRED, Setting
from imu_bench.config.sensor import SENSOR_SETTINGS
from imu_bench.config.simulated import SIMULATION_SETTINGS
from imu_bench.nodes import topic_names
from imu_bench.offline.analysis import results
from imu_bench.version import __version__
from msg_conversions.quantities import QUANTITIES

DOCS = Path(__file__).resolve().parent
MAN = DOCS / 'man' / 'imu-bench.1'
PAGES = DOCS / 'generated'

RESULTS = Path(imu_bench.__file__).resolve().parents[1] / 'test' / 'golden' / 'expected'
"""What the tests hold against what is computed anew: documents with all there is in one."""

FIELDS = (
    'metrology/estimate.py', 'metrology/curve.py', 'metrology/fitting/noise_model.py',
    'metrology/normality.py', 'offline/analysis/axis_result.py', 'offline/analysis/results.py',
    'offline/health/check.py', 'offline/health/finding.py',
)  # fmt: skip
"""Where the meaning of a field of a result stands beside it."""


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


def verbs_page() -> str:
    """Return what `imu-bench VERB --help` says, of every verb."""
    parser = build_parser()
    parts = ['# Verbs', parser.description or '', _table(('option', ''), arguments(parser))]
    for name, summary, verb in verbs(parser):
        parts += [f'## {name}', verb.description or f'{summary}.']
        parts.append(_table(('argument', ''), arguments(verb)))
        examples = (verb.epilog or '').partition('examples:\n')[2].partition('\n\n')[0]
        lines = '\n'.join(line.strip() for line in examples.splitlines())
        parts.append(f'```sh\n{lines}\n```')
    return '\n\n'.join(parts)


def parameters_page() -> str:
    """Return the settings of sensors and nodes: keys of a YAML, and parameters of ROS."""
    said = (
        'What a YAML of a sensor may set, and the parameters of its node. A value that is not '
        'allowed is refused, never rounded.'
    )
    parts = ['# Parameters', said, '## Every sensor', _settings(SENSOR_SETTINGS)]
    for name in drivers.names():
        driver = drivers.load(name)
        parts += [f'## {name}', f'{driver.title}. {driver.document}', _settings(driver.settings)]
    parts += ['## Simulated sources', 'Below `simulation.`', _settings(SIMULATION_SETTINGS)]
    if find_spec('rclpy') is not None:
        from imu_bench.nodes import analysis, recorder

        for node, module in (('analysis_node', analysis), ('recorder_node', recorder)):
            parts += [f'## {node}', _settings(module.SETTINGS)]
    return '\n\n'.join(parts)


def topics_page() -> str:
    """Return topics and quantities, with names, types and units."""
    heads = 'topic', 'type', 'quantity', 'unit', 'components'
    measured = [
        (f'`{q.topic}`', f'`{q.message.type}`', f'`{q.name}`', q.unit,
         ', '.join(q.components) or 'one number') for q in QUANTITIES
    ]  # fmt: skip
    metrics = [(f'`{name}`',) for name in topic_names.SUFFIXES[len(topic_names.MEASURED) :]]
    where = (
        f'Below the namespace of a sensor, `{topic_names.ROOT}/<sensor>`; what is on '
        '`/diagnostics`: [nodes](../nodes.md).'
    )
    more = 'The analysis node publishes beside them:'
    tables = _table(heads, measured), _table(('topic',), metrics)
    return '\n\n'.join(['# Topics and quantities', where, tables[0], more, tables[1]])


def document_page() -> str:
    """Return the paths of the JSON documents, with type and meaning."""
    meanings = _meanings()
    rows: dict[str, dict[str, set[str]]] = {}
    for file in sorted(RESULTS.glob('*.json.gz')):
        for written in json.loads(gzip.decompress(file.read_bytes())).values():
            schema = written.get('schema') if isinstance(written, dict) else None
            for path, value in _paths(written) if schema else ():
                rows.setdefault(schema, {}).setdefault(path, set()).add(_kind(value))
    said = (
        'What `--json` writes: every path in the documents that the tests compute anew. `AXIS` '
        'stands for `linear_acceleration.x` and so on. An *estimate* has `value`, `low`, `high`, '
        '`unit`, `confidence`, `observable`, `reason` and `method`; what the data do not support '
        'is null, with the reason. Below `SENSOR` of a plan can be all that an analysis has below '
        '`recordings[]`, too. Within a major version nothing is taken away.'
    )
    parts = ['# JSON documents', said]
    known = {
        path.replace('recordings[]', 'values.SENSOR') for path in rows.get(results.SCHEMA, ())
    }
    for schema, paths in sorted(rows.items()):
        table = [
            (f'`{path}`', ' or '.join(sorted(kinds)), meanings.get(path.rpartition('.')[2], ''))
            for path, kinds in paths.items()
            if path not in known
        ]
        parts += [f'## {schema}', _table(('path', 'type', 'meaning'), table)]
    return '\n\n'.join(parts)


def interface_page() -> str:
    """Return the Python interface, whose docstrings Sphinx puts in."""
    parts = ['# Python interface', 'The stable names; [how to use them](../python.md).']
    for name in imu_bench.__all__:
        what = getattr(imu_bench, name)
        if not name.startswith('_'):
            kind = 'autoclass' if isinstance(what, type) else 'autofunction'
            members = '\n   :members:' if isinstance(what, type) else ''
            parts.append(f'```{{eval-rst}}\n.. {kind}:: imu_bench.{name}{members}\n```')
    return '\n\n'.join(parts)


_DIGEST = {'size', 'sum', 'some'}
"""What stands for a long list in what the tests keep."""

_WHOLE = {'value', 'observable'}, _DIGEST
"""Keys of what is shown as a whole: an estimate, a list."""


MADE = {
    'verbs': verbs_page, 'parameters': parameters_page, 'topics': topics_page,
    'document': document_page, 'interface': interface_page,
}  # fmt: skip


def write_pages() -> None:
    """Write every page of the reference that has changed."""
    PAGES.mkdir(exist_ok=True)
    for name, page in MADE.items():
        path, text = PAGES / f'{name}.md', page() + '\n'
        if not path.exists() or path.read_text('utf-8') != text:
            path.write_text(text, encoding='utf-8')


def _table(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [heads, ('---',) * len(heads), *rows]
    return '\n'.join(f'| {" | ".join(map(_cell, line))} |' for line in lines)


def _cell(text: str) -> str:
    """Return a text that is one cell, and no markup unless it is code already."""
    flat = ' '.join(text.split())
    if not flat.startswith('`') and flat != '---':
        flat = re.sub(r'([<>*_$\[\]`{}~])', r'\\\1', flat)
    return flat.replace('|', r'\|')


def _settings(settings: Iterable[Any]) -> str:
    rows = []
    for one in settings:
        given = '' if one.default in (REQUIRED, None, '') else f'`{one.default}`'
        default = 'must be given' if one.default is REQUIRED else given
        allowed = one.constraint if isinstance(one, Setting) else ''
        rows.append((f'`{one.name}`', default, allowed, one.description))
    return _table(('parameter', 'default', 'allowed', ''), rows)


def _paths(value: Any, path: str = '') -> Iterator[tuple[str, Any]]:
    """Yield path and value of everything in a document, estimates and rows as wholes."""
    if isinstance(value, Mapping) and not any(one <= value.keys() for one in _WHOLE):
        for name, entry in value.items():
            known = 'AXIS' if re.fullmatch(r'(\w+\.)?[xyz]', name) else name
            if path == 'values' and isinstance(entry, Mapping):
                known = 'SENSOR'
            yield from _paths(entry, f'{path}.{known}' if path else known)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for entry in value:
            yield from _paths(entry, f'{path}[]')
    else:
        yield path, value


def _kind(value: Any) -> str:
    if isinstance(value, Mapping) and value.keys() >= _DIGEST:
        return 'list of number'
    if isinstance(value, Mapping):
        return 'estimate' if value else 'empty object'
    if isinstance(value, list):
        return f'list of {_kind(value[0])}' if value else 'list'
    names = {bool: 'true/false', int: 'integer', float: 'number', str: 'text', type(None): 'null'}
    return names[type(value)]


def _meanings() -> dict[str, str]:
    """Return what stands beside the fields of results, where a name means one thing only."""
    found: dict[str, set[str]] = {}
    for file in FIELDS:
        text = (Path(imu_bench.__file__).parent / file).read_text('utf-8')
        for name, said in re.findall(r'^    (\w+): [^#\n=]+(?:= [^#\n]+)?  # (.+)$', text, re.M):
            found.setdefault(name, set()).add(said)
    return {name: said.pop() for name, said in found.items() if len(said) == 1}


if __name__ == '__main__':
    MAN.parent.mkdir(exist_ok=True)
    MAN.write_text(man(), encoding='utf-8')
