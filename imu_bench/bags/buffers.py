# SPDX-License-Identifier: Apache-2.0
"""Many numbers out of a buffer of bytes at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Buffer = bytes | memoryview
Ints = npt.NDArray[np.int64]


def gather(buffer: Buffer, dtype: str, offsets: Ints) -> Ints:
    """
    Return the integers at some byte offsets of a buffer, aligned or not.

    Examples
    --------
    >>> gather(bytes(range(8)), '<u2', np.array([1, 4])).tolist()
    [513, 1284]
    """
    kind = np.dtype(dtype)
    every = np.ndarray((max(0, len(buffer) - kind.itemsize + 1),), kind, buffer, 0, (1,))
    return every[offsets].astype(np.int64)
