# SPDX-License-Identifier: Apache-2.0
"""Many numbers out of a buffer of bytes at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Buffer = bytes | memoryview
Ints = npt.NDArray[np.int64]


def gather(buffer: Buffer, dtype: str, offsets: Ints) -> Ints:
    """Return the integers at some byte offsets of a buffer, aligned or not."""
    kind = np.dtype(dtype)
    every = np.ndarray((max(0, len(buffer) - kind.itemsize + 1),), kind, buffer, 0, (1,))
    return every[offsets].astype(np.int64)


def table(buffer: Buffer, kind: np.dtype[Any], offsets: Ints) -> npt.NDArray[Any]:
    """Return the records, all of one kind, at some byte offsets of a buffer, aligned or not."""
    # one opaque item from every byte on: numpy copies such items faster than records
    room = max(0, len(buffer) - kind.itemsize + 1)
    every = np.ndarray((room,), f'V{kind.itemsize}', buffer, 0, (1,))
    return every[offsets].view(kind)
