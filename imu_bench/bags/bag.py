# SPDX-License-Identifier: Apache-2.0
"""A ROS 2 bag: its storage files in order, what its metadata announces, and whether they agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
import re
import shutil
from tempfile import mkdtemp
import weakref

from imu_bench.bags import mcap_records, metadata, sqlite
from imu_bench.bags.block import Block, Channel, join, Storage
from imu_bench.bags.buffers import gather
from imu_bench.bags.compression import expand, expand_file, MAX_MESSAGE, ZSTD_MAGIC
from imu_bench.bags.mcap import McapFile
from imu_bench.bags.metadata import Announcement
from imu_bench.bags.problems import COUNTS, INCOMPLETE, Problem
from imu_bench.errors import RecordingError

_LOOKED_AT = 64
"""Messages of a block that tell whether they are compressed."""

_ZSTD_START = int.from_bytes(ZSTD_MAGIC, 'little')
_SPLIT = re.compile(r'^(?P<stem>.*?)(?:_(?P<number>\d+))?(?P<suffix>\.(?:db3|mcap)(?:\.zstd)?)$')


class Bag:
    """
    A bag of ROS 2: a folder with or without metadata, or a single storage file.

    Raises
    ------
    RecordingError
        If it is no bag, or none of its files can be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._problems: list[str] = []
        self._folder: Path | None = None
        self._cleaning: weakref.finalize[..., Bag] | None = None
        self.storages: tuple[Storage, ...] = ()
        self.announcement = self._announcement()
        self.files = self._files()  # the storage files that are read, in order
        try:
            self.storages = self._opened()
            self.channels: tuple[Channel, ...] = tuple(
                dict.fromkeys(channel for storage in self.storages for channel in storage.channels)
            )
            self.counts: dict[str, int] = self._count()  # messages stored by topic
        except BaseException:
            self.close()
            raise
        kinds = dict.fromkeys(
            'mcap' if isinstance(storage, McapFile) else 'sqlite3' for storage in self.storages
        )
        self.format = 'rosbag2 ' + ' and '.join(kinds)  # 'rosbag2 mcap', 'rosbag2 sqlite3' or both
        self._compare()

    @property
    def problems(self) -> list[str]:
        """What is wrong with the bag, as far as it has been read."""
        return self._problems + [line for storage in self.storages for line in storage.problems]

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """Yield the messages of some topics, file after file, decompressed."""
        for storage in self.storages:
            for block in storage.blocks(topics):
                if _packed(block):
                    yield from self._unpacked(block)
                else:
                    yield block

    def close(self) -> None:
        """Give temporary files back; the bag cannot be read afterwards."""
        for storage in self.storages:
            storage.close()
        if self._cleaning is not None:
            self._cleaning()

    # --- which files -------------------------------------------------------------------

    def _announcement(self) -> Announcement | None:
        file = self.path / metadata.FILE_NAME
        if not self.path.is_dir():
            return None
        if not file.is_file():
            self._report(
                'no metadata.yaml: the recorder did not close the bag; the files are scanned'
            )
            return None
        try:
            found = metadata.read(file)
        except (RecordingError, OSError) as problem:
            self._report(f'{problem}; the files are scanned')
            return None
        if found.version > metadata.NEWEST_VERSION:
            self._problems.append(
                f'metadata version {found.version} is newer than {metadata.NEWEST_VERSION}'
            )
        return found

    def _broken(self, announcement: Announcement | None) -> str:
        """Return what is wrong with the files that the metadata names, or that look like some."""
        names = announcement.files if announcement is not None else ()
        there = {file.name: file for file in self.path.iterdir() if file.is_file()}
        files = [there[name] for name in dict.fromkeys(names) if name in there]
        files = files or [file for name, file in sorted(there.items()) if is_named_so(file)]
        return ', '.join(
            f'{file.name} is empty'
            if not file.stat().st_size
            else f'{file.name} is no storage file'
            for file in files
        )

    def _files(self) -> tuple[Path, ...]:
        if not self.path.is_dir():
            return (self.path,)
        present = {file.name: file for file in self.path.iterdir() if kind(file)}
        if not present and (broken := self._broken(self.announcement)):
            raise RecordingError(f'{self.path}: the bag is damaged: {broken}')
        if not present:
            raise RecordingError(
                f'{self.path}: no bag in this folder: it holds no .mcap or .db3 file'
            )
        announced = self.announcement.files if self.announcement is not None else ()
        listed = tuple(dict.fromkeys(announced))
        if len(listed) < len(announced):
            self._problems.append('metadata.yaml names a file more than once: it is read once')
        found = [present[name] for name in listed if name in present]
        missing = [name for name in listed if name not in present]
        if missing:
            self._report(f'files named in metadata.yaml are missing: {", ".join(missing)}')
        if found:
            later = _continuations(found, present)
            if later:
                self._problems.append(
                    'metadata.yaml does not name these later parts, which are read all the same: '
                    + ', '.join(file.name for file in later)
                )
            return (*found, *later)
        return only_recording(self.path, list(present.values()))

    def _opened(self) -> tuple[Storage, ...]:
        opened = [self._try_open(file) for file in self.files]
        storages = [storage for storage in opened if not isinstance(storage, RecordingError)]
        failures = [failure for failure in opened if isinstance(failure, RecordingError)]
        if not storages:
            raise failures[0]
        for failure in failures:
            self._report(f'not read: {failure}')
        return tuple(storages)

    def _try_open(self, file: Path) -> Storage | RecordingError:
        try:
            return self._open(file)
        except RecordingError as problem:
            return problem
        except OSError as problem:
            return RecordingError(f'{file}: cannot be read: {problem.strerror}')

    def _open(self, file: Path) -> Storage:
        plain = file
        if _magic(file).startswith(ZSTD_MAGIC):
            plain = self._temporary() / file.name.removesuffix('.zstd')
            if problem := expand_file(file, plain):
                self._report(f'{file.name}: {problem}')
            if not kind(plain):
                raise RecordingError(f'{file}: damaged: nothing in it can be decompressed')
        try:
            return sqlite.SqliteFile(plain) if kind(plain) == 'sqlite3' else McapFile(plain)
        except RecordingError as problem:  # which names the file it has seen
            raise RecordingError(str(problem).replace(str(plain), str(file))) from problem

    def _report(self, line: str) -> None:
        self._problems.append(Problem(line, INCOMPLETE))

    def _temporary(self) -> Path:
        if self._folder is None:
            self._folder = Path(mkdtemp(prefix='imu_bench_'))
            self._cleaning = weakref.finalize(
                self, shutil.rmtree, self._folder, ignore_errors=True
            )
        return self._folder

    # --- what is in them -----------------------------------------------------------------

    def _count(self) -> dict[str, int]:
        """Return the messages stored by topic; as announced if the totals agree."""
        announced = self.announcement
        if (
            announced is not None
            and announced.counts.keys() >= {channel.topic for channel in self.channels}
            and sum(announced.counts.values())
            == sum(storage.message_count for storage in self.storages)
        ):
            return announced.counts
        counts: Counter[str] = Counter()
        for storage in self.storages:
            counts.update(storage.counts)
        return dict(counts)

    def _compare(self) -> None:
        """Report where the metadata announces something else than is stored."""
        if self.announcement is None:
            return
        for topic, announced in self.announcement.counts.items():
            stored = self.counts.get(topic, 0)
            if stored != announced:
                line = (
                    f'metadata.yaml announces {announced} messages on {topic}, {stored} are stored'
                )
                self._problems.append(Problem(line, COUNTS, topic))
        for topic, stored in self.counts.items():
            if stored and topic not in self.announcement.counts:
                self._problems.append(
                    f'metadata.yaml does not name {topic}, on which {stored} messages are stored'
                )
        for channel in self.channels:
            announced_as = self.announcement.serializations.get(channel.topic)
            if announced_as and announced_as != channel.serialization:
                self._problems.append(
                    f'metadata.yaml says {channel.topic} is serialized as {announced_as}, '
                    f'the storage says {channel.serialization}'
                )

    def _unpacked(self, block: Block) -> Iterator[Block]:
        """Decompress messages that are compressed one by one, some megabytes at a time."""
        blobs: list[bytes] = []
        kept: list[int] = []
        room = MAX_MESSAGE
        for index, blob in enumerate(block.blobs()):
            try:
                blobs.append(bytes(expand(blob, 'zstd', most=MAX_MESSAGE)))
            except RecordingError:
                topic = block.channel.topic
                line = f'compressed messages on {topic}, damaged or too large, were skipped'
                if line not in self._problems:
                    self._report(line)
                continue
            kept.append(index)
            room -= len(blobs[-1])
            if room <= 0:
                yield join(block.channel, block.receive_ns[kept], blobs)
                blobs, kept, room = [], [], MAX_MESSAGE
        if kept:
            yield join(block.channel, block.receive_ns[kept], blobs)


def _packed(block: Block) -> bool:
    """
    Return whether the messages of a block are compressed one by one, whatever the metadata says.

    No serialized message begins like that; where one is damaged, others tell.  A recorder
    compresses all of them or none, so that a few will do.
    """
    whole = block.offsets[:_LOOKED_AT][block.sizes[:_LOOKED_AT] >= len(ZSTD_MAGIC)]
    return bool((gather(block.buffer, '<u4', whole) == _ZSTD_START).any())


def is_bag_folder(folder: Path) -> bool:
    """Return whether a folder holds storage files or metadata of a bag."""
    return (folder / metadata.FILE_NAME).is_file() or any(kind(file) for file in folder.iterdir())


def is_named_so(file: Path) -> bool:
    """Return whether a file has the name of a storage file, whatever is in it."""
    return _SPLIT.match(file.name) is not None


def kind(path: Path) -> str:
    """
    Return the storage format of a file by its first bytes; '' if it is no storage file.

    A zstd file counts if its name says what is in it.
    """
    magic = _magic(path)
    if magic.startswith(mcap_records.MAGIC):
        return 'mcap'
    if magic.startswith(sqlite.MAGIC):
        return 'sqlite3'
    if magic.startswith(ZSTD_MAGIC) and (match := _SPLIT.match(path.name)):
        return 'mcap' if match['suffix'].startswith('.mcap') else 'sqlite3'
    return ''


def _magic(path: Path) -> bytes:
    if not path.is_file():
        return b''
    with path.open('rb') as file:
        return file.read(16)


def _parts(name: str) -> tuple[str, int, str]:
    """Return the name a split file shares with its siblings, and its number."""
    match = _SPLIT.match(name)
    if match is None:
        return name, -1, ''
    return match['stem'], -1 if match['number'] is None else int(match['number']), match['suffix']


def _continuations(found: list[Path], present: dict[str, Path]) -> list[Path]:
    """Return files that carry on the numbering of the listed ones."""
    stem, last, suffix = _parts(found[-1].name)
    if last < 0:
        return []
    later = []
    for name, file in present.items():
        other, number, kind_ = _parts(name)
        if (other, kind_) == (stem, suffix) and number > last:
            later.append((number, file))
    return [file for _, file in sorted(later)]


def only_recording(path: Path, files: Sequence[Path]) -> tuple[Path, ...]:
    """
    Return storage files in the order of their numbers.

    Raises
    ------
    RecordingError
        If they do not belong to one recording.
    """
    ordered = sorted(files, key=lambda file: _parts(file.name))
    if len({_parts(file.name)[0] for file in files}) > 1:
        raise RecordingError(
            f'{path}: holds several recordings without metadata.yaml '
            f'({", ".join(file.name for file in ordered)}); name one file'
        )
    return tuple(ordered)
