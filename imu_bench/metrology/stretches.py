# SPDX-License-Identifier: Apache-2.0
"""Stretches of an array in which something is true, such as those without a missing sample."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def stretches(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """
    Return first and one past the last index of every run of True, shape (k, 2).

    Examples
    --------
    >>> stretches(np.array([False, True, True, False, True])).tolist()
    [[1, 3], [4, 5]]
    """
    padded = np.concatenate(([False], mask, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return edges.reshape(-1, 2).astype(np.int64)


def longest(mask: npt.NDArray[np.bool_]) -> slice:
    """
    Return where the longest run of True is; an empty slice if there is none.

    Examples
    --------
    >>> longest(np.array([True, False, True, True]))
    slice(2, 4, None)
    """
    found = stretches(mask)
    if not found.size:
        return slice(0, 0)
    first, last = found[int(np.argmax(found[:, 1] - found[:, 0]))].tolist()
    return slice(first, last)
