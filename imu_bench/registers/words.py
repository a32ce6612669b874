# SPDX-License-Identifier: Apache-2.0
"""
Words as they travel: those that numpy knows, and words of three bytes, which it does not.

A word of three bytes is written '>i3', '<i3', '>u3' or '<u3', and is held in four.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

_HELD = {'>i3': 'i4', '<i3': 'i4', '>u3': 'u4', '<u3': 'u4'}


def is_three(dtype: str) -> bool:
    """Return whether numpy has no such word."""
    return dtype in _HELD


def held(dtype: str) -> np.dtype[Any]:
    """Return the type in which words are held."""
    return np.dtype(_HELD.get(dtype, dtype))


def size(dtype: str) -> int:
    """Return how many bytes a word takes."""
    return 3 if is_three(dtype) else np.dtype(dtype).itemsize


def limits(dtype: str) -> tuple[int, int]:
    """Return the smallest and the largest integer."""
    info = np.iinfo(held(dtype))
    unused = 8 if is_three(dtype) else 0
    return int(info.min) >> unused, int(info.max) >> unused


def widen(raw: npt.NDArray[np.uint8], dtype: str) -> npt.NDArray[Any]:
    """Return the words, shape (...,), that three bytes each make, shape (..., 3)."""
    big = dtype[0] == '>'
    four = np.zeros((*raw.shape[:-1], 4), np.uint8)
    four[..., : 3 if big else 4] = raw if big else np.insert(raw, 0, 0, axis=-1)
    return np.asarray(four.view(dtype[0] + _HELD[dtype])[..., 0] >> 8, held(dtype))


def narrow(words: npt.NDArray[Any], dtype: str) -> npt.NDArray[np.uint8]:
    """Return three bytes for each word, shape (..., 3)."""
    big = dtype[0] == '>'
    four = np.asarray(np.asarray(words) << 8, dtype[0] + _HELD[dtype])
    as_bytes = np.ascontiguousarray(four)[..., np.newaxis].view(np.uint8)
    return as_bytes[..., :3] if big else as_bytes[..., 1:]
