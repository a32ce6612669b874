# SPDX-License-Identifier: Apache-2.0
"""Which time stamps of a recording to believe."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

MAX_BACKWARD = 0.01
"""Share of steps back in time above which header stamps are not a time axis."""

MAX_REPEATED = 0.5
"""Share of repeated stamps above which several samples wear one stamp."""


def choose(
    stamps: npt.NDArray[np.int64], receive_ns: npt.NDArray[np.int64] | None, origin: str
) -> tuple[npt.NDArray[np.int64], str, str]:
    """
    Return the stamps to use, where they come from, and why.

    The header stamp is the time of measurement and is used unless it cannot be
    one; then the time of arrival takes its place, jitter of the transport included.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        Stamps of the measurement in ns.
    receive_ns : ndarray of int64, shape (n,), or None
        Times of arrival in ns.
    origin : str
        Name of the origin of the stamps, for example 'header'.

    Examples
    --------
    >>> choose(np.zeros(3, np.int64), np.array([5, 15, 25]), 'header')[1:]
    ('receive', 'every header stamp is zero')
    """
    fault = _fault(stamps, origin)
    if fault and receive_ns is not None and not _fault(receive_ns, 'receive'):
        return receive_ns, 'receive', fault
    return stamps, origin, fault or 'they increase as a time of measurement does'


def _fault(stamps: npt.NDArray[np.int64], origin: str) -> str:
    """Return why stamps are no time axis, or nothing."""
    if stamps.size < 2:
        return f'the {origin} stamp is zero' if stamps.size and stamps[0] == 0 else ''
    if not stamps.any():
        return f'every {origin} stamp is zero'
    if (stamps == stamps[0]).all():
        return f'every {origin} stamp is the same'
    steps = np.diff(stamps)
    backward = float(np.count_nonzero(steps < 0)) / steps.size
    if backward > MAX_BACKWARD:
        return f'{backward:.0%} of the {origin} stamps step back in time'
    repeated = float(np.count_nonzero(steps == 0)) / steps.size
    if repeated > MAX_REPEATED:
        return f'{repeated:.0%} of the {origin} stamps repeat the one before'
    return ''
