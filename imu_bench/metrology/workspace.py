# SPDX-License-Identifier: Apache-2.0
"""
Where long work arrays come from: memory, unless the caller has a better place.

A day of one axis at 1 kHz is 700 MB, and so is each array of that length that an estimator
works with.  Who must stay below a gigabyte lends arrays in files; this package knows nothing of
files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
import numpy.typing as npt

Lend = Callable[[int, npt.DTypeLike], npt.NDArray[Any]]
"""Returns a new array of so many items; its content does not matter."""

LONG = 1 << 22
"""Items from which an array is borrowed."""

PART = 1 << 20
"""Items that are looked at together."""

_LENDER: ContextVar[Lend | None] = ContextVar('lender', default=None)


@contextmanager
def borrowing(lend: Lend) -> Iterator[None]:
    """
    Let long work arrays come from somewhere else, in this thread.

    Examples
    --------
    >>> with borrowing(lambda size, dtype: np.full(size, 7, dtype)):
    ...     int(empty(LONG, np.int64)[0]), empty(3, np.int64).size
    (7, 3)
    """
    token = _LENDER.set(lend)
    try:
        yield
    finally:
        _LENDER.reset(token)


def parts(size: int, length: int = PART) -> Iterator[slice]:
    """
    Yield the parts of a long array, so that nobody touches all of it at once.

    Examples
    --------
    >>> list(parts(5, 3))
    [slice(0, 3, None), slice(3, 5, None)]
    """
    return (slice(start, min(start + length, size)) for start in range(0, size, length))


def extremes(values: npt.NDArray[np.float64]) -> tuple[float, float]:
    """
    Return the smallest and the largest value; NaN is neither unless there is nothing else.

    Examples
    --------
    >>> extremes(np.array([2.0, np.nan, 1.0]))
    (1.0, 2.0)
    """
    low = high = np.nan
    for part in parts(values.size):
        low = np.fmin(low, np.fmin.reduce(values[part]))
        high = np.fmax(high, np.fmax.reduce(values[part]))
    return float(low), float(high)


def median(values: npt.NDArray[np.float64]) -> float:
    """
    Return the median of values none of which is NaN, at least one; np.median takes twice as long.

    Examples
    --------
    >>> median(np.array([3.0, 1.0, 2.0])), median(np.array([4.0, 1.0, 2.0, 9.0]))
    (2.0, 3.0)
    """
    middle = values.size // 2
    ordered = np.partition(values, middle)
    upper = float(ordered[middle])
    return upper if values.size % 2 else 0.5 * (float(ordered[:middle].max()) + upper)


def all_finite(values: npt.NDArray[np.float64]) -> bool:
    """Return whether no value is NaN or infinite."""
    return all(bool(np.isfinite(values[part]).all()) for part in parts(values.size))


def empty(size: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return a new array of shape (size,) whose content does not matter."""
    lend = _LENDER.get()
    if lend is None or size < LONG:
        return np.empty(size, dtype)
    return lend(size, dtype)


def zeros(size: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return a new array of zeros of shape (size,)."""
    lend = _LENDER.get()
    if lend is None or size < LONG:
        return np.zeros(size, dtype)
    array = lend(size, dtype)
    array[:] = 0
    return array


def counted(size: int) -> npt.NDArray[np.int64]:
    """Return the numbers from 0 on: ``np.arange(size)``."""
    found = empty(size, np.int64)
    for start in range(0, size, LONG):
        found[start : start + LONG] = np.arange(start, min(start + LONG, size))
    return found


def chosen(values: npt.NDArray[Any], keep: npt.NDArray[np.bool_]) -> npt.NDArray[Any]:
    """
    Return the values, shape (n,), that are kept: ``values[keep]``.

    Examples
    --------
    >>> chosen(np.array([1, 2, 3]), np.array([True, False, True])).tolist()
    [1, 3]
    """
    found = empty(int(np.count_nonzero(keep)), values.dtype)
    done = 0
    for start in range(0, values.size, LONG):
        part = values[start : start + LONG][keep[start : start + LONG]]
        found[done : done + part.size] = part
        done += part.size
    return found
