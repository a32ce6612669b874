# SPDX-License-Identifier: Apache-2.0
"""Values that are no numbers: counted, told, left out."""

from __future__ import annotations

from imu_bench.errors import RecordingError
from imu_bench.samples import AXES, IMU_QUANTITIES
import numpy as np
import numpy.typing as npt

Columns = dict[str, npt.NDArray[np.float64] | None]

_INERTIAL = {quantity.field: quantity.name for quantity in IMU_QUANTITIES}


def sift(columns: Columns, where: str) -> tuple[Columns, npt.NDArray[np.bool_], list[str]]:
    """
    Return quantities, which samples of them to keep, and notes on what is not kept.

    A sample with a NaN or infinite acceleration or angular velocity is not kept.  An
    axis that never has a number is absent and judges no sample.  Temperature and
    magnetic field judge no sample either: they are not kept at all unless complete.

    Parameters
    ----------
    columns : dict of str to ndarray or None
        By the field names of `Samples`.
    where : str
        Names the recording in error texts.

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
    found: Columns = {}
    notes: list[str] = []
    good: npt.NDArray[np.bool_] | None = None
    for field, values in columns.items():
        if values is None:
            found[field] = None
        elif field in _INERTIAL:
            there, kept = _inertial(_INERTIAL[field], values, notes)
            found[field] = values if there else None
            good = kept if good is None else good & kept
        else:
            found[field] = _complete(field, values, notes)
    if good is None or not any(found.get(field) is not None for field in _INERTIAL):
        raise RecordingError(f'{where}: not a single finite value is stored')
    if not good.any():
        raise RecordingError(f'{where}: every sample has a NaN or infinite value; {notes[0]}')
    return found, good, notes


def _inertial(
    name: str, values: npt.NDArray[np.float64], notes: list[str]
) -> tuple[bool, npt.NDArray[np.bool_]]:
    """Return whether any axis is there, and which samples are good on those that are."""
    good = np.ones(len(values), bool)
    present = 0
    for axis, column in zip(AXES, values.T, strict=True):
        finite = np.isfinite(column)
        bad = column.size - int(np.count_nonzero(finite))
        if bad == column.size:
            continue
        present += 1
        if bad:
            nan = int(np.count_nonzero(np.isnan(column)))
            notes.append(f'{name}.{axis}: {nan} NaN and {bad - nan} infinite values left out')
            good &= finite
    return present > 0, good


def _complete(
    field: str, values: npt.NDArray[np.float64], notes: list[str]
) -> npt.NDArray[np.float64] | None:
    present = np.isfinite(values).reshape(len(values), -1)
    whole = present[:, present.any(axis=0)].all(axis=1)
    if present.any() and whole.all():
        return values
    count = int(whole.sum()) if present.any() else 0
    notes.append(f'{field} is not used: it has numbers in {count} of {len(values)} samples only')
    return None
