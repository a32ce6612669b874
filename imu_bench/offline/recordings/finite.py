# SPDX-License-Identifier: Apache-2.0
"""Values that are no numbers: counted, told, left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from imu_bench.bags.problems import NOT_A_NUMBER, Problem
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.gathering import PIECE
from imu_bench.samples import AXES, IMU_QUANTITIES
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

LARGEST, SMALLEST = 1e30, 1e-100
"""In SI: beyond them no sensor measures, and powers of the numbers do not fit a float."""

_CACHED = 1 << 15
"""Values that fit into the fast memory of a processor, with their sizes."""

_INERTIAL = {quantity.field: quantity.name for quantity in IMU_QUANTITIES}


def sift(
    columns: Mapping[str, Floats | None], where: str
) -> tuple[tuple[str, ...], Bools | None, list[str]]:
    """
    Return which quantities are there, which samples to keep, and notes on what is not kept.

    A sample with a NaN or infinite acceleration or angular velocity is not kept; what exceeds
    `LARGEST` counts as infinite.  An axis that never has a number is absent, becomes NaN, and
    judges no sample.  Temperature and magnetic field judge no sample either: they are not kept
    at all unless complete.  What is below `SMALLEST` becomes zero.

    Parameters
    ----------
    columns : mapping of str to ndarray or None
        By the field names of `Samples`.
    where : str
        Names the recording in error texts.

    Returns
    -------
    there : tuple of str
        Names of the quantities that are kept.
    good : ndarray of bool, shape (n,), or None
        None if every sample is kept.
    notes : list of str

    Raises
    ------
    RecordingError
        If no sample is left.

    Examples
    --------
    >>> gyro = np.array([[1, np.nan, 0.0], [2, np.nan, np.inf], [3, np.nan, 5]])
    >>> sift({'angular_velocity': gyro}, 'a.csv')[1:]
    (array([ True, False,  True]), ['angular_velocity.z: 0 NaN and 1 infinite values left out'])
    """
    there: list[str] = []
    notes: list[str] = []
    good: Bools | None = None
    for field, values in columns.items():
        if values is None:
            continue
        if field not in _INERTIAL:
            if _complete(field, values, notes):
                there.append(field)
            continue
        for axis, column in zip(AXES, values.T, strict=True):
            finite, note = _axis(f'{_INERTIAL[field]}.{axis}', column)
            notes += [note] if note else []
            if finite:
                there.append(field)
            if 0 < finite < column.size:
                good = _narrowed(good, column)
    if not _INERTIAL.keys() & set(there):
        raise RecordingError(f'{where}: not a single finite value is stored')
    if good is not None and not good.any():
        raise RecordingError(f'{where}: every sample has a NaN or infinite value; {notes[0]}')
    return tuple(dict.fromkeys(there)), good, notes


def _axis(name: str, column: Floats) -> tuple[int, str]:
    """Return how many values of an axis are finite, and a note if that is not all of them."""
    finite, nan = _counts(column)
    infinite = column.size - finite - nan
    if not finite and infinite:
        column[:] = np.nan
        return 0, f'{name} is not used: it holds no finite value'
    if 0 < finite < column.size:
        words = f'{name}: {nan} NaN and {infinite} infinite values left out'
        return finite, Problem(words, NOT_A_NUMBER)
    return finite, ''


def _narrowed(good: Bools | None, column: Floats) -> Bools:
    """Return which samples are still good when those that are not finite here are not."""
    narrowed = np.ones(column.size, np.bool_) if good is None else good
    for part in _pieces(column.size):
        narrowed[part] &= _finite(column[part])
    return narrowed


def _complete(field: str, values: Floats, notes: list[str]) -> bool:
    """Return whether the axes that are there at all have a number in every sample."""
    rows = values.reshape(len(values), -1)
    present = [row for row in rows.T if _counts(row)[0]]
    whole = 0
    for part in _pieces(len(rows) if present else 0):
        whole += int(np.logical_and.reduce([_finite(row[part]) for row in present]).sum())
    if present and whole == len(rows):
        return True
    notes.append(f'{field} is not used: it has numbers in {whole} of {len(rows)} samples only')
    return False


def _counts(column: Floats) -> tuple[int, int]:
    """Return how many values are finite, and how many are NaN; make tiny ones zero."""
    finite = nan = 0
    sizes = np.empty(min(column.size, _CACHED))
    for start in range(0, column.size, _CACHED):
        values = column[start : start + _CACHED]
        size = np.abs(values, out=sizes[: values.size])
        if size.max() <= LARGEST:  # False if there is a NaN
            finite += values.size
        else:
            finite += int(np.count_nonzero(size <= LARGEST))
            nan += int(np.count_nonzero(np.isnan(values)))
        if not size.min() >= SMALLEST:
            values[size < SMALLEST] = 0.0
    return finite, nan


def _finite(values: Floats) -> Bools:
    return np.asarray(np.abs(values) <= LARGEST, np.bool_)


def _pieces(size: int) -> Iterator[slice]:
    return (slice(start, min(start + PIECE, size)) for start in range(0, size, PIECE))
