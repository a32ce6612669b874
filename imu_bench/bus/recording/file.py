# SPDX-License-Identifier: Apache-2.0
"""
The file of a wire recording: two lines of text, then blocks.

The first line says what it is, with the CRC-32 of the second, which is JSON: the head.  A block is
three numbers (uint32, little endian), namely its length, a CRC-32 and the CRC-32 of these two, and
so many bytes, compressed by zlib, that unpack to whole events.  The CRC-32 of a block goes on from
that of the block before, the first one from that of the head: no block can be missing, or stand
in another place.  A block of no bytes, with the CRC-32 of `LAST`, ends a recording that was ended
in order.  Of a file that is cut off every whole block is good.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
import json
from pathlib import Path
import struct
from typing import Any, BinaryIO
import zlib

from imu_bench.bus.recording.events import Event, unpack
from imu_bench.errors import os_error_text, RecordingError

MAGIC = b'imu_bench wire recording '
FORMAT = 1
BLOCK = struct.Struct('<III')
LAST = b'end of recording'

BLOCK_BYTES = 1 << 16
"""A block is full with so many bytes before compression."""

_MOST_HEAD = 1 << 16
_MOST_BLOCK = 1 << 26
_CHUNK = 1 << 20


@dataclass(frozen=True)
class WireHead:
    """One wire as it was when recording began."""

    part: str  # name of the die; the main one is ''
    kind: str  # 'registers', 'frames', 'stream' or 'board'
    name: str  # device and address, as in error texts
    baud: int = 0  # of a stream


@dataclass(frozen=True)
class Head:
    """What was recorded."""

    driver: str
    settings: Mapping[str, Any]  # the driver's own, all of them
    label: str  # what stood behind the sensor: 'hardware mpu9250 i2c-1 0x68', 'emulated mpu9250'
    version: str  # of imu_bench
    begun: str  # when, UTC, ISO 8601
    wires: tuple[WireHead, ...]

    @property
    def origin(self) -> str:
        """What was recorded and when, for people."""
        return f'{self.label}, {self.begun}'

    def differences(self, driver: str, settings: Mapping[str, Any]) -> dict[str, str]:
        """
        Return what cannot be played with such a driver and such settings, by name.

        Examples
        --------
        >>> head = Head('mpu9250', {'rate_hz': 100.0}, 'emulated mpu9250', '0.1.0', '', ())
        >>> head.differences('mpu9250', {'rate_hz': 200.0})
        {'rate_hz': 'recorded with 100.0, not with 200.0'}
        """
        if driver != self.driver:
            return {'driver': f'recorded with {self.driver}, not with {driver}'}
        return {
            name: f'recorded with {self.settings.get(name)!r}, not with {value!r}'
            for name, value in settings.items()
            # in JSON a tuple is a list
            if self.settings.get(name) != (list(value) if isinstance(value, tuple) else value)
        }

    def check(self, driver: str, settings: Mapping[str, Any]) -> None:
        """Refuse what cannot be played with such a driver and such settings."""
        found = self.differences(driver, settings)
        if found:
            listed = '; '.join(f'{name}: {text}' for name, text in found.items())
            raise RecordingError(f'{self.origin}: {listed}')

    def as_bytes(self) -> bytes:
        """Return both lines."""
        line = json.dumps(asdict(self)).encode()
        return MAGIC + b'%d %08x\n%s\n' % (FORMAT, zlib.crc32(line), line)


def block_of(data: bytes, before: int) -> tuple[bytes, int]:
    """Return a block and its CRC-32, from which the next one goes on."""
    crc = zlib.crc32(data or LAST, before)
    return _front(len(data), crc) + data, crc


def _front(length: int, crc: int) -> bytes:
    return BLOCK.pack(length, crc, zlib.crc32(struct.pack('<II', length, crc)))


def read_head(path: str | Path) -> Head:
    """
    Return what a file holds.

    Raises
    ------
    RecordingError
        If there is no such file, or it is no wire recording.
    """
    file = _opened(path)
    with file:
        return _head(file, path)[0]


class Reading:
    """A recording that is read from its beginning to its end."""

    def __init__(self, path: str | Path) -> None:
        self.whole = False  # its end has been read, and it was ended in order
        self.unread = 0  # bytes at the end that are no whole block
        self._path = path
        self._file = _opened(path)
        try:
            self.head, self._crc = _head(self._file, path)
        except RecordingError:
            self._file.close()
            raise

    def events(self) -> Iterator[Event]:
        """Yield every event; stop where the file ends or was cut off."""
        while True:
            at = self._file.tell()
            try:
                block = self._block()
                if block is None:
                    return
                yield from unpack(block)
            except (RecordingError, OSError, zlib.error) as error:
                raise RecordingError(
                    f'{self._path}: damaged at byte {at} ({error}); copy it again, or play what '
                    f'comes before: head -c {at} {self._path} > part.wire'
                ) from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _block(self) -> bytes | None:
        """Return what the next block holds; None at the end, in order or not."""
        at = self._file.tell()
        front = self._file.read(BLOCK.size)
        if len(front) == BLOCK.size:
            length, crc, _ = BLOCK.unpack(front)
            if front == _front(length, crc):
                data = self._file.read(min(length, _MOST_BLOCK))
                if len(data) == length and zlib.crc32(data or LAST, self._crc) == crc:
                    self._crc = crc
                    self.whole = not data
                    return _unzipped(data) if data else None
        # what was being written when the power went: nothing but zeros comes behind it
        while chunk := self._file.read(_CHUNK):
            if chunk.strip(b'\0'):
                raise RecordingError('a wrong checksum')
        self.unread = self._file.tell() - at
        return None


def _unzipped(data: bytes) -> bytes:
    unzip = zlib.decompressobj()
    block = unzip.decompress(data, _MOST_BLOCK)
    if not unzip.eof:
        raise RecordingError('a block that is too long')
    return block


def _opened(path: str | Path) -> BinaryIO:
    try:
        return Path(path).open('rb')
    except OSError as error:
        raise RecordingError(os_error_text(error)) from error


def _head(file: BinaryIO, path: str | Path) -> tuple[Head, int]:
    """Return the head and the CRC-32 of both of its lines."""
    first = file.readline(len(MAGIC) + 20)
    if not first.startswith(MAGIC):
        raise RecordingError(
            f'{path}: no wire recording; wire_recording: FILE on backend: hardware writes one'
        )
    version = first[len(MAGIC) :].split(b' ')[0].decode(errors='replace').strip()
    if version != f'{FORMAT}':
        raise RecordingError(
            f'{path}: its format {version} is not {FORMAT}, the one this version reads; play it '
            'with the version that wrote it'
        )
    line = file.readline(_MOST_HEAD)
    try:
        if first != MAGIC + b'%d %08x\n' % (FORMAT, zlib.crc32(line.rstrip(b'\n'))):
            raise ValueError('a wrong checksum')
        found = json.loads(line)
        wires = tuple(WireHead(**wire) for wire in found.pop('wires'))
        head = Head(**found, wires=wires)
        if not all(isinstance(value, str) for value in (head.driver, head.label, head.version)):
            raise TypeError('texts')
        dict(head.settings)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise RecordingError(
            f'{path}: its head cannot be read; the file was cut off or changed'
        ) from error
    return head, zlib.crc32(first + line)
