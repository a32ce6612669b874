# SPDX-License-Identifier: Apache-2.0
"""From a path to an opened recording: which format is it."""

from __future__ import annotations

from pathlib import Path
import re

from imu_bench.bags import bag, ros1
from imu_bench.bus.recording.file import MAGIC as WIRE
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.array_files import kind, MAGIC_SIZE
from imu_bench.offline.recordings.discovery import find_recordings, STAMPS_FILE
from imu_bench.offline.recordings.source import ReadOptions, Source

_LISTED = 8

_OWN = re.compile(rb'\s*\{\s*"schema": "imu_bench\.')
_OWN_SIZE = 64
"""Bytes in which a file of our own says what it is."""


def open_source(path: str | Path, options: ReadOptions | None = None) -> Source:
    """Open a recording of any known format; nothing is modified, little is read."""
    place = Path(path)
    chosen = options or ReadOptions()
    try:
        return _open(place, chosen)
    except FileNotFoundError as problem:
        raise RecordingError(f'{place}: no such file or folder') from problem
    except OSError as problem:
        raise RecordingError(f'{place}: cannot be read: {problem.strerror}') from problem


def _open(path: Path, options: ReadOptions) -> Source:
    # imported late: each format brings its own libraries
    if (path / STAMPS_FILE).is_file():
        from imu_bench.offline.recordings import arrays

        return arrays.open_arrays(path, options)
    if path.is_dir() and not bag.is_bag_folder(path):
        raise RecordingError(f'{path}: this folder is no bag; {_inside(path)}')
    if path.is_dir() or bag.kind(path):
        from imu_bench.offline.recordings import bags

        return _without(options, bags.open_ros2(path, full=options.full))
    with path.open('rb') as file:
        start = file.read(max(len(ros1.ANY_VERSION), MAGIC_SIZE, _OWN_SIZE))
    if not start:
        raise RecordingError(f'{path}: the file is empty')
    if start.startswith(ros1.ANY_VERSION):
        from imu_bench.offline.recordings import bags

        return _without(options, bags.open_ros1(path, full=options.full))
    if kind(path, start):
        from imu_bench.offline.recordings import arrays

        return arrays.open_arrays(path, options)
    if _OWN.match(start):
        raise RecordingError(
            f'{path}: this is a result of imu-bench analyze, no recording; imu-bench export and '
            'imu-bench compare read results'
        )
    if start.startswith(WIRE):
        raise RecordingError(
            f'{path}: this is a wire recording; play it with sensor_node --ros-args -p '
            f'backend:=recorded -p wire_recording:={path}, and imu-bench record'
        )
    from imu_bench.offline.recordings import text

    return text.open_text(path, options)


def _without(options: ReadOptions, source: Source) -> Source:
    """Say on a bag which options are not used: its messages say all that themselves."""
    given = ('--rate', options.rate_hz), ('--columns', options.columns), ('--units', options.units)
    unused = [name for name, value in given if value is not None]
    if unused:
        verb = 'is' if len(unused) == 1 else 'are'
        source.problems.append(
            f'{" and ".join(unused)} {verb} not used: a bag has stamps, names and SI units'
        )
    return source


def _inside(folder: Path) -> str:
    try:
        found = find_recordings(folder)
    except RecordingError:
        return 'it holds no bag, CSV or text file'
    names = [str(path.relative_to(folder)) for path in found[:_LISTED]]
    more = ', ...' if len(found) > _LISTED else ''
    return f'name one of the {len(found)} recordings in it: {", ".join(names)}{more}'
