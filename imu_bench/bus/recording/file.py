# SPDX-License-Identifier: Apache-2.0
"""
The file of a wire recording: two lines of text, then blocks.

The first line says what it is, the second is JSON: the head.  A block is its length and its
CRC-32 (uint32 each, little endian) and so many bytes, compressed by zlib, that unpack to whole
events.  A block of length 0 with the CRC-32 of `LAST` ends a recording that was ended in order.
Of a file that is cut off every whole block is good.
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
BLOCK = struct.Struct('<II')
LAST = b'end of recording'
END = BLOCK.pack(0, zlib.crc32(LAST))

BLOCK_BYTES = 1 << 16
"""A block is full with so many bytes before compression."""

_MOST_HEAD = 1 << 16
_MOST_BLOCK = 1 << 26
_MOST_TORN = 1 << 20


@dataclass(frozen=True)
class WireHead:
    """
    One wire as it was when recording began.

    Attributes
    ----------
    part : str
        Name of the die; the main one is ''.
    kind : str
        'registers', 'frames', 'stream' or 'board'.
    name : str
        Device and address, as in error texts.
    baud : int
        Of a stream.
    """

    part: str
    kind: str
    name: str
    baud: int = 0


@dataclass(frozen=True)
class Head:
    """
    What was recorded.

    Attributes
    ----------
    driver : str
    settings : mapping
        The driver's own, all of them.
    label : str
        What stood behind the sensor: 'hardware mpu9250 i2c-1 0x68', 'emulated mpu9250'.
    version : str
        Of imu_bench.
    begun : str
        When, UTC, ISO 8601.
    wires : tuple of WireHead
    """

    driver: str
    settings: Mapping[str, Any]
    label: str
    version: str
    begun: str
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
        """
        Refuse what cannot be played with such a driver and such settings.

        Raises
        ------
        RecordingError
        """
        found = self.differences(driver, settings)
        if found:
            listed = '; '.join(f'{name}: {text}' for name, text in found.items())
            raise RecordingError(f'{self.origin}: {listed}')

    def as_bytes(self) -> bytes:
        """Return both lines."""
        return MAGIC + b'%d\n' % FORMAT + json.dumps(asdict(self)).encode() + b'\n'


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
        return _head(file, path)


class Reading:
    """
    A recording that is read from its beginning to its end.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    RecordingError
        If there is no such file, or it is no wire recording.

    Attributes
    ----------
    head : Head
    whole : bool
        Its end has been read, and it was ended in order.
    unread : int
        Bytes at the end that are no whole block.
    """

    def __init__(self, path: str | Path) -> None:
        self.whole = False
        self.unread = 0
        self._path = path
        self._file = _opened(path)
        try:
            self.head = _head(self._file, path)
        except RecordingError:
            self._file.close()
            raise

    def events(self) -> Iterator[Event]:
        """
        Yield every event; stop where the file ends or was cut off.

        Raises
        ------
        RecordingError
            If the file is damaged, with where.
        """
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
        header = self._file.read(BLOCK.size)
        if header == END:
            self.whole = True
            return None
        if len(header) < BLOCK.size:
            self.unread = len(header)
            return None
        length, crc = BLOCK.unpack(header)
        data = self._file.read(min(length, _MOST_BLOCK))
        if len(data) == length > 0 and zlib.crc32(data) == crc:
            return _unzipped(data)
        # what was being written when the power went: nothing but zeros comes behind it
        if len(data) > _MOST_TORN or self._file.read(_MOST_TORN).strip(b'\0'):
            raise RecordingError('a wrong checksum')
        self.unread = len(header) + len(data)
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


def _head(file: BinaryIO, path: str | Path) -> Head:
    first = file.readline(len(MAGIC) + 12)
    if not first.startswith(MAGIC):
        raise RecordingError(
            f'{path}: no wire recording; wire_recording: FILE on backend: hardware writes one'
        )
    if first != MAGIC + b'%d\n' % FORMAT:
        raise RecordingError(
            f'{path}: its format {first[len(MAGIC) :].strip().decode(errors="replace")} is not '
            f'{FORMAT}, the one this version reads; play it with the version that wrote it'
        )
    try:
        found = json.loads(file.readline(_MOST_HEAD))
        wires = tuple(WireHead(**wire) for wire in found.pop('wires'))
        head = Head(**found, wires=wires)
        if not all(isinstance(value, str) for value in (head.driver, head.label, head.version)):
            raise TypeError('texts')
        dict(head.settings)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise RecordingError(
            f'{path}: its head cannot be read; the file was cut off or changed'
        ) from error
    return head
