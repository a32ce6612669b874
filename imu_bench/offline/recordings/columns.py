# SPDX-License-Identifier: Apache-2.0
"""Which column of a text file is which axis, by the names in the file or by the user's word."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import re

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import column_units
from imu_bench.offline.recordings.column_units import Scale, SI
from imu_bench.offline.recordings.layout import Layout
from imu_bench.offline.recordings.source import ReadOptions
from msg_conversions.quantities import BY_NAME, IMU_QUANTITIES, QUANTITIES

INERTIAL = tuple(quantity.name for quantity in IMU_QUANTITIES)
TARGETS = (
    *(column for quantity in QUANTITIES for column in quantity.columns),
    'stamp',
    'nanoseconds',
    'index',
)
"""What a column can be."""

_NATIVE, _UNIT_NAMED, _ALIAS = range(3)

_BRACKETED = re.compile(r'^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$')
_NATIVE_NAME = re.compile(
    rf'^(?:.*[./])?(?P<vector>{"|".join(q.name for q in QUANTITIES if q.components)})'
    r'[./](?P<axis>[xyzw])$'
)
_HEADER_STAMP = re.compile(r'^field\.header\.stamp$')
_STEMS = {
    'linear_acceleration': 'a|acc|accl|accel|acceleration|accelerometer|linear_acceleration|'
    'linear_accel|lin_acc|a_rs_s|specific_force',
    'angular_velocity': 'g|w|gyr|gyro|gyroscope|omega|angular_velocity|angular_rate|ang_vel|'
    'w_rs_s|rotation_rate',
    'magnetic_field': 'm|mag|magnetic_field|magnetometer',
}
_ALIASES = {
    vector: re.compile(
        rf'^(?:imu_?\d*_)?(?:(?:{stems})_?(?:raw_|cal_)?(?P<axis>[xyz])'
        rf'|(?P<first>[xyz])_?(?:{stems}))(?:_raw|_cal)?$'
    )
    for vector, stems in _STEMS.items()
}
_STAMP = re.compile(
    r'^(?:relative_|elapsed_|unix_|epoch_)?(?:stamp|time_?stamp|time|t|seconds|sec)'
    r'(?:_(?P<unit>s|sec|ms|us|ns))?$'
)
_SECONDS = ('sec', 'secs', 'seconds', 's')
_NANOSECONDS = re.compile(r'^(?P<stem>.*?)_?(?:nano_?sec(?:ond)?s?|nsecs?|nanos)$')
"""The second part of a stamp in two columns, as messages of ROS have it."""

_ISO_DATE = '2001-09-09 01:46:40.5'
_INDEX = re.compile(
    r'^(?:index|idx|sample|n_samples|sample_?(?:no|number|index|counter)|counter)$'
)
_TEMPERATURE = re.compile(r'^(?:imu_?\d*_)?(?:temp|temperature)(?:_(?P<unit>c|degc))?$')
_FILE_WORD = re.compile(
    r'(?<![a-z])(?:acc(?:el(?:erometer|eration)?)?|gyr(?:o(?:scope)?)?|mag(?:netometer)?)(?![a-z])'
)
_QUANTITY_NAMES = {
    'acceleration': 'linear_acceleration',
    'accel': 'linear_acceleration',
    'acc': 'linear_acceleration',
    'gyro': 'angular_velocity',
    'gyr': 'angular_velocity',
    'mag': 'magnetic_field',
    'temp': 'temperature',
    'time': 'stamp',
}


@dataclass(frozen=True)
class Assigned:
    """A column that is used: its place in the file, what it is, how it becomes SI."""

    index: int
    target: str
    scale: Scale

    @property
    def quantity(self) -> str:
        """The target without its axis."""
        return self.target.partition('.')[0]


@dataclass(frozen=True)
class _Found:
    index: int
    label: str
    target: str
    unit: str = ''
    rank: int = _ALIAS

    @property
    def quantity(self) -> str:
        return self.target.partition('.')[0]


def assign(path: Path, layout: Layout, options: ReadOptions) -> tuple[list[Assigned], list[str]]:
    """Return the columns to read, and notes on columns that are not."""
    found = [
        replace(column, unit='s')
        if column.target == 'stamp' and _dated(column, layout)
        else column
        for column in _chosen(path, layout, options)
    ]
    found = _unambiguous(path, found)
    if not any(column.quantity in INERTIAL for column in found):
        raise RecordingError(
            f'{path}: no column with an acceleration or angular velocity recognised; '
            f'{_listing(layout)}; name them as in --columns {_positional_example(layout)}, '
            'with their units in --units and, without a time column, the rate in --rate'
        )
    for column in found:
        if not layout.numeric[column.index]:
            dates = f'; dates are read as in {_ISO_DATE}' if column.target == 'stamp' else ''
            raise RecordingError(f'{path}: column {column.label!r} does not hold numbers{dates}')
    columns, notes, lacking = _scaled(found, options)
    notes += _beyond(found, layout, options)
    problems = []
    if lacking:
        problems.append(
            f'the unit of {" and ".join(lacking)} is not known: add it, for example '
            + column_units.missing(lacking, column_units.parse_units(options.units))
        )
    if options.rate_hz is None and not any(column.target == 'stamp' for column in found):
        hint = layout.stated_rate or 'HZ'
        stated = f' (a line before the table mentions {hint} Hz)' if layout.stated_rate else ''
        problems.append(
            f'there is no time column: give the sample rate with --rate {hint}{stated}, or name '
            'the column with --columns'
        )
    if problems:
        raise RecordingError(f'{path}: {"; ".join(problems)}; {_listing(layout)}')
    return columns, notes


def recognise(name: str) -> tuple[str, str, int] | None:
    """Return what a column name means: target, unit it carries, and how sure that is."""
    match = _BRACKETED.match(name)
    bare, unit = (match['name'], match['unit']) if match else (name, '')
    native = _NATIVE_NAME.match(bare.lower())
    if native and native['axis'] in BY_NAME[native['vector']].components:
        vector = native['vector']
        own = column_units.named_unit(vector, unit) if unit else None
        return f'{vector}.{native["axis"]}', own or SI[vector], _NATIVE
    if _HEADER_STAMP.match(bare):
        return 'stamp', 'ns', _NATIVE
    plain = re.sub(r'[^a-z0-9]+', '_', bare.lower()).strip('_')
    target, carried = _alias(plain)
    if not target:
        return None
    quantity = target.partition('.')[0]
    own = column_units.named_unit(quantity, unit or carried) if unit or carried else None
    return target, own or '', _UNIT_NAMED if own else _ALIAS


def _alias(plain: str) -> tuple[str, str]:
    for vector, pattern in _ALIASES.items():
        if match := pattern.match(plain):
            return f'{vector}.{match["axis"] or match["first"]}', ''
    if match := _STAMP.match(plain):
        unit = match['unit'] or ('s' if plain in ('seconds', 'sec') else '')
        return 'stamp', unit
    if _INDEX.match(plain):
        return 'index', '1'
    if match := _TEMPERATURE.match(plain):
        return 'temperature', '°C' if match['unit'] else ''
    return '', ''


def _chosen(path: Path, layout: Layout, options: ReadOptions) -> list[_Found]:
    names = layout.header or ('',) * layout.width
    own = []
    for index, name in enumerate(names):
        if (meaning := recognise(name) or _said_by_file(path, name)) is not None:
            own.append(_Found(index, name, *meaning))
    own = _of_two_parts(names, own)
    if layout.moment >= 0:
        own = [column for column in own if column.target != 'stamp']
        own.append(_Found(layout.moment, names[layout.moment], 'stamp', 's', _NATIVE))
    if options.columns is None:
        return own
    parts = [part.strip() for part in options.columns.split(',')]
    if not any('=' in part for part in parts):
        return _by_position(path, layout, parts)
    pairs = [_pair(path, layout, part) for part in parts]
    taken = {column.target for column in pairs}
    used = {column.index for column in pairs}
    dropped = {column.index for column in pairs if column.target == '-'}
    rest = [c for c in own if c.target not in taken and c.index not in used]
    return [column for column in pairs + rest if column.index not in dropped]


def _dated(column: _Found, layout: Layout) -> bool:
    """Return whether a column holds dates; where they are in two columns, both do."""
    return layout.moment >= 0 and 0 <= column.index - layout.moment <= 1


def _of_two_parts(names: Sequence[str], own: list[_Found]) -> list[_Found]:
    """Return columns with a stamp of seconds and nanoseconds, if two names say so."""
    plain = [re.sub(r'[^a-z0-9]+', '_', name.lower()).strip('_') for name in names]
    for index, name in enumerate(plain):
        match = _NANOSECONDS.match(name)
        wanted = [f'{match["stem"]}_{s}'.strip('_') for s in _SECONDS] if match else []
        first = next((k for k, other in enumerate(plain) if other in wanted), None)
        if first is not None:
            rest = [c for c in own if c.target != 'stamp' and c.index not in (first, index)]
            return [
                *rest,
                _Found(first, names[first], 'stamp', 's', _NATIVE),
                _Found(index, names[index], 'nanoseconds', 'ns', _NATIVE),
            ]
    return own


def _said_by_file(path: Path, name: str) -> tuple[str, str, int] | None:
    """Return the meaning of a column x, y or z in a file that is named after one sensor."""
    words = set(_FILE_WORD.findall(path.stem.lower()))
    if len(words) != 1 or name.lower() not in ('x', 'y', 'z'):
        return None
    return recognise(f'{words.pop()}_{name}')


def _by_position(path: Path, layout: Layout, parts: list[str]) -> list[_Found]:
    if len(parts) > layout.width:
        raise RecordingError(
            f'{path}: --columns names {len(parts)} columns, the file has {layout.width}'
        )
    found = []
    for index, part in enumerate(parts):
        if part not in ('', '-'):
            label = layout.header[index] if layout.header else f'column {index + 1}'
            found.append(_Found(index, label, *_named_target(part)))
    return found


def _beyond(found: Sequence[_Found], layout: Layout, options: ReadOptions) -> list[str]:
    """Return a note if an axis has no name while the file has columns left: one was forgotten."""
    parts = (options.columns or '').split(',')
    if options.columns is None or len(parts) >= layout.width or any('=' in p for p in parts):
        return []
    named = {column.target for column in found}
    lacking = [
        f'{vector}.{axis}'
        for vector in INERTIAL
        for axis in 'xyz'
        if f'{vector}.{axis}' not in named and any(name.startswith(vector) for name in named)
    ]
    if not lacking:
        return []
    note = (
        f'--columns names {len(parts)} of {layout.width} columns and no {", ".join(lacking)}: '
        'what is in the others is not used (a - at their place says that this is meant)'
    )
    return [note]


def _pair(path: Path, layout: Layout, part: str) -> _Found:
    name, _, target = (piece.strip() for piece in part.partition('='))
    if not target:
        raise RecordingError(
            f'--columns: {part!r}: either every entry is of the form header=name, or none is'
        )
    lowered = [column.lower() for column in layout.header]
    if name.lower() not in lowered:
        raise RecordingError(f'{path}: no column {name!r}; {_listing(layout)}')
    index = layout.header.index(name) if name in layout.header else lowered.index(name.lower())
    if target == '-':
        return _Found(index, name, '-')
    return _Found(index, layout.header[index], *_named_target(target))


def _named_target(name: str) -> tuple[str, str, int]:
    """Return what the user calls a column; a name alone does not make its unit SI."""
    if name in TARGETS:
        return name, {'index': '1', 'nanoseconds': 'ns'}.get(name, ''), _NATIVE
    meaning = recognise(name)
    if meaning is None:
        raise RecordingError(f'--columns: unknown name {name!r}; known are {", ".join(TARGETS)}')
    target, unit, rank = meaning
    return target, unit if rank == _UNIT_NAMED else '', _NATIVE


def _unambiguous(path: Path, found: list[_Found]) -> list[_Found]:
    best: dict[str, _Found] = {}
    for column in found:
        other = best.get(column.target)
        if other is None or column.rank < other.rank:
            best[column.target] = column
        elif column.rank == other.rank:
            raise RecordingError(
                f'{path}: columns {other.label!r} and {column.label!r} both look like '
                f'{column.target}; choose: --columns "{other.label}={column.target},'
                f'{column.label}=-"'
            )
    return sorted(best.values(), key=lambda column: column.index)


def _scaled(
    found: list[_Found], options: ReadOptions
) -> tuple[list[Assigned], list[str], list[str]]:
    """Return columns with known units, notes on those left out, and what lacks a unit."""
    given = _given_units(found, options)
    columns, notes, lacking = [], [], []
    for column in found:
        keys = (column.target, column.label, column.quantity)
        unit = next((given[key] for key in keys if key in given), column.unit)
        if column.target == 'nanoseconds':
            unit = column.unit
        if unit:
            columns.append(
                Assigned(column.index, column.target, column_units.scale(column.quantity, unit))
            )
        elif column.quantity in BY_NAME and column.quantity not in INERTIAL:
            notes.append(
                f'column {column.label!r} is not used: its unit is not known; '
                f'add {column_units.EXAMPLES[column.quantity]} to --units'
            )
        elif column.quantity not in lacking:
            lacking.append(column.quantity)
    return columns, notes, lacking


def _given_units(found: list[_Found], options: ReadOptions) -> dict[str, str]:
    given = column_units.parse_units(options.units)
    known = {*SI, *(column.label for column in found), *(column.target for column in found)}
    given = {_known_as(name, known): unit for name, unit in given.items()}
    for name in given:
        if name not in known:
            raise RecordingError(
                f'--units: nothing is called {name!r}; known are {", ".join(sorted(known))}'
            )
    return given


def _known_as(name: str, known: Collection[str]) -> str:
    """Return the quantity or the column that a name of --units means: `acc`, `ax` or `t`."""
    if name in known:
        return name
    meaning = recognise(name)
    return meaning[0] if meaning and meaning[0] in known else _QUANTITY_NAMES.get(name, name)


def _listing(layout: Layout) -> str:
    if layout.header:
        return f'the columns are {", ".join(layout.header)}'
    columns = 'one column without a name'
    if layout.width > 1:
        columns = f'{layout.width} columns without names'
    return f'the file has {columns}'


def _positional_example(layout: Layout) -> str:
    names = ('linear_acceleration', 'angular_velocity')
    axes = [f'{name}.{axis}' for name in names for axis in 'xyz']
    if layout.width > len(axes):
        axes.insert(0, 'stamp_s')
    return ','.join(axes[: layout.width])
