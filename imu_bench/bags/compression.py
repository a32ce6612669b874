# SPDX-License-Identifier: Apache-2.0
"""zstd, lz4 and bz2, whole or cut off, with a limit on what comes out."""

from __future__ import annotations

import bz2
from pathlib import Path
import shutil
import sys
from typing import BinaryIO

from imu_bench.errors import RecordingError
import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAX_EXPANDED = 1 << 29
"""Bytes; a single chunk or message that claims to be larger is damaged."""

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
"""First bytes of a frame: RFC 8878, section 3.1.1."""

_STEP = 1 << 20
_FILE_STEP = 1 << 16
_SALVAGE_STEP = 1 << 12
_DAMAGED = (zstd.ZstdError, RuntimeError, EOFError, OSError)


def expand(
    data: bytes | memoryview, algorithm: str, size: int | None = None
) -> bytes | memoryview:
    """
    Return decompressed data.

    Parameters
    ----------
    data : bytes-like
    algorithm : str
        'zstd', 'lz4' (frame format), 'bz2' or '' for none.
    size : int, optional
        Expected number of bytes.

    Raises
    ------
    RecordingError
        If the data is damaged or cut off, does not have the expected size, is
        larger than 512 MiB, or the algorithm is unknown.

    Examples
    --------
    >>> expand(compress(b'abc'), 'zstd', 3)
    b'abc'
    """
    if size is not None and size > MAX_EXPANDED:
        raise RecordingError(f'claims {size} bytes, more than {MAX_EXPANDED}')
    if not algorithm:
        out: bytes | memoryview = data
        complete = True
    else:
        decompressor = _decompressor(algorithm)
        try:
            # one more than expected, so that the decompressor reaches the end of its frame
            room = (MAX_EXPANDED if size is None else size) + 1
            out = decompressor.decompress(data, max_length=room)
        except _DAMAGED as problem:
            raise RecordingError(f'{algorithm} data damaged: {problem}') from problem
        complete = decompressor.eof
    if not complete or (size is not None and len(out) != size):
        raise RecordingError(f'{algorithm or "stored"} data damaged after {len(out)} bytes')
    return out


def expand_part(data: bytes | memoryview, algorithm: str) -> bytes | memoryview:
    """
    Return what can be decompressed from the beginning of cut-off data.

    Examples
    --------
    >>> expand_part(b'abc', '')
    b'abc'
    """
    if not algorithm:
        return data
    decompressor = _decompressor(algorithm)
    view = memoryview(data)
    parts: list[bytes] = []
    room = MAX_EXPANDED
    try:
        # in small steps, so that what comes before a damaged place is kept
        for start in range(0, len(view), _SALVAGE_STEP):
            if decompressor.eof or room <= 0:
                break
            part = decompressor.decompress(view[start : start + _SALVAGE_STEP], max_length=room)
            parts.append(part)
            room -= len(part)
    except _DAMAGED:
        pass  # the caller knows that the data is damaged: this is what is left of it
    return b''.join(parts)


def compress(data: bytes) -> bytes:
    """Return data as one zstd frame."""
    return zstd.compress(data, level=1)


def expand_file(source: Path, target: Path) -> bool:
    """
    Decompress a zstd file; return False if it is damaged or cut off.

    What could be decompressed is in the target in either case.

    Raises
    ------
    RecordingError
        If the target's file system has no room for it.
    """
    with source.open('rb') as packed, target.open('wb') as plain:
        try:
            return _copy(packed, plain)
        except OSError as problem:
            free = shutil.disk_usage(target.parent).free
            raise RecordingError(
                f'{source}: cannot decompress into {target.parent} ({free >> 20} MiB free): '
                f'{problem.strerror}; set TMPDIR to a folder with more room'
            ) from problem


def _copy(packed: BinaryIO, plain: BinaryIO) -> bool:
    decompressor = zstd.ZstdDecompressor()
    while True:
        data = b''
        if decompressor.eof:
            data = decompressor.unused_data or packed.read(_FILE_STEP)
            if not data:
                return True
            decompressor = zstd.ZstdDecompressor()
        elif decompressor.needs_input and not (data := packed.read(_FILE_STEP)):
            return False
        try:
            plain.write(decompressor.decompress(data, max_length=_STEP))
        except zstd.ZstdError:
            return False


def _decompressor(
    algorithm: str,
) -> zstd.ZstdDecompressor | lz4.frame.LZ4FrameDecompressor | bz2.BZ2Decompressor:
    if algorithm == 'zstd':
        return zstd.ZstdDecompressor()
    if algorithm == 'bz2':
        return bz2.BZ2Decompressor()
    if algorithm == 'lz4':
        return lz4.frame.LZ4FrameDecompressor()
    raise RecordingError(f'compression {algorithm!r} is unknown; known are zstd, lz4 and bz2')
