# SPDX-License-Identifier: Apache-2.0
"""
Where the parts of a stamped sensor message lie on the wire.

The encoding is plain CDR (OMG DDSI-RTPS 2.5 clause 10 and DDS-XTypes 1.3 clause 7.4): four
bytes of encapsulation header, then int32 sec, uint32 nanosec, the string as uint32 length
(with its terminating zero) and bytes, padding up to a multiple of 8 bytes after the
encapsulation header, then the float64.  XCDR2, which aligns float64 to 4 bytes,
and big-endian messages are understood too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

_ENCAPSULATION = 4
TEXT = _ENCAPSULATION + 12
"""Where the frame_id begins, behind the stamp and its own length."""

# (byte 1 of the encapsulation header): byte order, largest alignment
_REPRESENTATIONS = {0: ('>', 8), 1: ('<', 8), 6: ('>', 4), 7: ('<', 4)}


def row_type(order: str, text: int, start: int, count: int, size: int) -> np.dtype[Any]:
    """Return the structured type of a message whose frame_id takes `text` bytes."""
    return np.dtype(
        {
            'names': ['sec', 'nanosec', 'frame_id', 'values'],
            'formats': [f'{order}i4', f'{order}u4', (np.uint8, (text,)), (f'{order}f8', (count,))],
            'offsets': [_ENCAPSULATION, _ENCAPSULATION + 4, TEXT, start],
            'itemsize': size,
        }
    )


def start_of_numbers(text: int, alignment: int) -> int:
    """Return where the numbers start behind a frame_id of `text` bytes."""
    end = TEXT - _ENCAPSULATION + text
    return _ENCAPSULATION + -(-end // alignment) * alignment


def head_type(order: str, text: int) -> np.dtype[Any]:
    """Return the type of everything before the numbers, as far as it is used."""
    return np.dtype(
        [
            ('encapsulation', '<u4'),
            ('sec', f'{order}i4'),
            ('nanosec', f'{order}u4'),
            ('length', '<u4'),
            ('frame_id', f'S{text}') if text else ('frame_id', np.void, 0),
        ]
    )


def layout(head: bytes, size: int, count: int) -> tuple[str, int, int]:
    """Return byte order, length of the frame_id and start of the numbers; raise if none fit."""
    if size < TEXT or head[0] != 0 or head[1] not in _REPRESENTATIONS:
        raise ValueError(f'{size} bytes that start with {head[:4].hex(" ")} are no CDR message')
    order, alignment = _REPRESENTATIONS[head[1]]
    text = int(np.frombuffer(head[TEXT - 4 : TEXT], dtype=f'{order}u4')[0])
    start = start_of_numbers(text, alignment)
    if start + 8 * count > size:
        raise ValueError(
            f'{size} bytes cannot hold a frame_id of {text} bytes and {count} numbers '
            f'({start + 8 * count} bytes)'
        )
    return order, text, start
