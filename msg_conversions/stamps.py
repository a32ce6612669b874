# SPDX-License-Identifier: Apache-2.0
"""Nanoseconds since the epoch to and from the two fields of builtin_interfaces/Time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

NANOSECONDS = 1_000_000_000

_SECONDS = np.iinfo(np.int32)


def split(stamps_ns: npt.ArrayLike) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.uint32]]:
    """
    Return seconds and nanoseconds of stamps, as builtin_interfaces/Time stores them.

    Parameters
    ----------
    stamps_ns : array_like of int64, shape (n,)
        Nanoseconds since the epoch; may be negative.

    Returns
    -------
    nanosec : ndarray of uint32, shape (n,)
        Always 0 to 999 999 999; the sign is in the seconds (builtin_interfaces/Time.msg).

    Raises
    ------
    ValueError
        If a stamp lies outside the years 1901 to 2038, which int32 seconds can hold.

    Examples
    --------
    >>> sec, nanosec = split([1_500_000_002, -1])
    >>> sec.tolist(), nanosec.tolist()
    ([1, -1], [500000002, 999999999])
    """
    sec, nanosec = np.divmod(np.asarray(stamps_ns, dtype=np.int64), NANOSECONDS)
    if sec.size and (sec.min() < _SECONDS.min or sec.max() > _SECONDS.max):
        raise ValueError(
            f'stamps from {sec.min()} s to {sec.max()} s do not fit builtin_interfaces/Time '
            f'({_SECONDS.min} s to {_SECONDS.max} s)'
        )
    return sec.astype(np.int32), nanosec.astype(np.uint32)


def join(sec: npt.ArrayLike, nanosec: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """
    Return nanoseconds since the epoch from the fields of builtin_interfaces/Time.

    Examples
    --------
    >>> join([1, -1], [500000002, 999999999]).tolist()
    [1500000002, -1]
    """
    whole = np.asarray(sec, dtype=np.int64) * NANOSECONDS
    stamps: npt.NDArray[np.int64] = whole + np.asarray(nanosec, dtype=np.int64)
    return stamps
