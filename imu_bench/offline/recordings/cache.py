# SPDX-License-Identifier: Apache-2.0
"""Columns of large recordings in files, to be read again without the recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
import hashlib
import json
import os
from pathlib import Path
import shutil
from tempfile import mkdtemp
from typing import Any

from imu_bench.bags.problems import code_of, Problem
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.delivery import Delivery, Stretch
from imu_bench.offline.recordings.discovery import siblings
from imu_bench.offline.recordings.loading import load_all, Progress, Recording, stored_bytes
from imu_bench.offline.recordings.opening import open_source
from imu_bench.offline.recordings.source import ReadOptions
from imu_bench.offline.recordings.thermometers import Thermometer
from imu_bench.offline.running.mapped import ArrayFolder, attach, locate, Place
from imu_bench.samples import Samples
from imu_bench.version import __version__
import numpy as np

LARGE = 8 << 20
"""Bytes of a recording from which its columns go to disk."""

_MANY = 1 << 20
"""Samples from which they do so as well: what hardly changes takes few bytes, compressed."""

SCHEMA = 'imu_bench.columns/7'
_INDEX = 'columns.json'
_PLAIN = (
    'source', 'topic', 'frame_id', 'announced', 'stored', 'left_out', 'stamp_source',
    'stamp_reason', 'covariances', 'serial',
)  # fmt: skip
_WARM = ('warm_stamps', 'warm_receive_ns', 'warm_celsius')
_EDGE = 1 << 16


@dataclass(frozen=True, eq=False)
class Read:
    """What was read of a recording."""

    recordings: list[Recording]  # one per topic
    problems: list[str]  # what went wrong while it was opened and read


@contextmanager
def columns(
    path: Path,
    options: ReadOptions,
    *,
    keep: Path | None = None,
    progress: Progress | None = None,
) -> Iterator[Read]:
    """
    Give the topics of a recording, from a cache if they are there.

    The columns of a large recording lie in files; those are removed afterwards unless
    they are to be kept.
    """
    if not path.exists() or sum(map(stored_bytes, _files(path, options))) < LARGE:
        with open_source(path, options) as source:
            topics = source.select(options.topics)
            if sum(topic.count for topic in topics) < _MANY:
                yield Read(load_all(source, topics, progress), source.problems)
                return
    if keep is None:
        folder = Path(mkdtemp(prefix='imu_bench_'))
        try:
            _fill(folder, path, options, progress)
            yield _restored(folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        return
    folder = keep / f'{path.stem}-{fingerprint(path, options)[:16]}'
    if (read := _found(folder)) is None:
        _make(folder, path, options, progress)
        read = _restored(folder)
    yield read


def fingerprint(path: Path, options: ReadOptions, *more: object) -> str:
    """
    Return what changes when a recording, or what is asked of it, changes.

    Names, sizes, times and both ends of its files are looked at, not all of their bytes.
    """
    asked = asdict(replace(options, join=()))  # the files of this recording follow below
    known = hashlib.sha256()
    known.update(json.dumps([SCHEMA, __version__, asked, *map(str, more)]).encode())
    for file in _files(path, options):
        state = file.stat()
        known.update(f'{file.resolve()}\0{state.st_size}\0{state.st_mtime_ns}\0'.encode())
        with file.open('rb') as opened:
            known.update(opened.read(_EDGE))
            opened.seek(max(0, state.st_size - _EDGE))
            known.update(opened.read(_EDGE))
    return known.hexdigest()


def _files(path: Path, options: ReadOptions) -> list[Path]:
    if path.is_dir():
        return sorted(file for file in path.rglob('*') if file.is_file())
    return [path, *siblings(path, options.join)]


def _make(folder: Path, path: Path, options: ReadOptions, progress: Progress | None) -> None:
    """Make a folder of columns, which is there as a whole or not at all."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    unfinished = Path(mkdtemp(prefix=f'.{folder.name}.', dir=folder.parent))
    try:
        _fill(unfinished, path, options, progress)
        shutil.rmtree(folder, ignore_errors=True)
        unfinished.rename(folder)
    except OSError:
        # another process has made the same folder meanwhile
        if not (folder / _INDEX).is_file():
            raise
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _fill(folder: Path, path: Path, options: ReadOptions, progress: Progress | None) -> None:
    arrays = ArrayFolder(folder)
    with open_source(path, options) as source:
        found = load_all(source, source.select(options.topics), progress, arrays.empty)
        document: dict[str, Any] = {
            'schema': SCHEMA,
            'problems': list(map(_packed, source.problems)),
            'recordings': [_described(recording, arrays) for recording in found],
        }
    text = json.dumps(document, ensure_ascii=False)
    # written last: without it the folder is not complete
    (folder / _INDEX).write_text(text, encoding='utf-8')
    used = {
        place['path']
        for recording in document['recordings']
        for place in recording['columns'].values()
    }
    for file in folder.glob('*.bin'):
        if file.name not in used:  # a column that was outgrown, or is not complete
            file.unlink()


def _described(recording: Recording, folder: ArrayFolder) -> dict[str, Any]:
    arrays = {
        'stamps': recording.samples.stamps,
        'receive_ns': recording.receive_ns,
        **recording.samples.columns,
    }
    if (warm := recording.thermometer) is not None:
        arrays |= dict(zip(_WARM, map(folder.put, warm[1:]), strict=True))
    places = {name: locate(array) for name, array in arrays.items() if array is not None}
    return {
        **{name: getattr(recording, name) for name in _PLAIN},
        'notes': list(map(_packed, recording.notes)),
        'delivery': None if recording.delivery is None else asdict(recording.delivery),
        'thermometer': None if warm is None else warm.topic,
        'columns': {
            name: {**place._asdict(), 'path': os.path.basename(place.path)}
            for name, place in places.items()
            if place is not None
        },
    }


def _packed(words: str) -> list[str]:
    return [words, code_of(words), words.topic if isinstance(words, Problem) else '']


def _found(folder: Path) -> Read | None:
    """Return what an earlier run has left, None if that is nothing that can be used."""
    try:
        return _restored(folder)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _restored(folder: Path) -> Read:
    document = json.loads((folder / _INDEX).read_text(encoding='utf-8'))
    if document['schema'] != SCHEMA:
        raise RecordingError(f'{folder}: columns of another version')
    found = [_recording(folder, described) for described in document['recordings']]
    return Read(found, [Problem(*packed) for packed in document['problems']])


def _recording(folder: Path, described: Mapping[str, Any]) -> Recording:
    arrays: dict[str, Any] = {}
    for name, place in described['columns'].items():
        file = folder / Path(place['path']).name
        shape, strides = tuple(place['shape']), tuple(place['strides'])
        arrays[name] = attach(Place(str(file), place['offset'], place['dtype'], shape, strides))
    receive: np.ndarray[Any, np.dtype[np.int64]] | None = arrays.pop('receive_ns', None)
    warm = [arrays.pop(name) for name in _WARM if name in arrays]
    return Recording(
        samples=Samples(**arrays),
        receive_ns=receive,
        notes=tuple(Problem(*packed) for packed in described['notes']),
        delivery=_delivery(described['delivery']),
        thermometer=Thermometer(described['thermometer'], *warm) if warm else None,
        **{name: described[name] for name in _PLAIN},
    )


def _delivery(described: Mapping[str, Any] | None) -> Delivery | None:
    if described is None:
        return None
    worst = tuple(Stretch(*stretch) for stretch in described['worst'])
    return Delivery(**{**described, 'worst': worst})
