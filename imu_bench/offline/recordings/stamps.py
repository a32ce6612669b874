# SPDX-License-Identifier: Apache-2.0
"""Which time stamps of a recording to believe."""

from __future__ import annotations

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings.gathering import PIECE
import numpy as np
import numpy.typing as npt

MAX_BACKWARD = 0.01
"""Share of steps back in time above which header stamps are not a time axis."""

MAX_REPEATED = 0.5
"""Share of repeated stamps above which several samples wear one stamp."""

MAX_SPAN_NS = 1 << 62
"""Stamps further apart, 146 years, are damaged; their differences may not fit 64 bits."""


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


def check_span(stamps: npt.NDArray[np.int64], where: str) -> None:
    """
    Make sure that differences of stamps fit 64 bits.

    Raises
    ------
    RecordingError
        If they lie centuries apart.
    """
    if stamps.size and _span(stamps) > MAX_SPAN_NS:
        raise RecordingError(
            f'{where}: the stamps go from {stamps.min()} to {stamps.max()} ns: some are damaged, '
            'or the unit of the time column is another'
        )


def _span(stamps: npt.NDArray[np.int64]) -> int:
    return int(stamps.max()) - int(stamps.min())


def _fault(stamps: npt.NDArray[np.int64], origin: str) -> str:
    """Return why stamps are no time axis, or nothing."""
    if stamps.size < 2:
        return f'the {origin} stamp is zero' if stamps.size and stamps[0] == 0 else ''
    if _span(stamps) > MAX_SPAN_NS:
        return f'the {origin} stamps span centuries'
    backward = repeated = 0
    for start in range(0, stamps.size - 1, PIECE):
        steps = np.diff(stamps[start : start + PIECE + 1])
        backward += int(np.count_nonzero(steps < 0))
        repeated += int(np.count_nonzero(steps == 0))
    steps_taken = stamps.size - 1
    if repeated == steps_taken:
        return f'every {origin} stamp is {"zero" if stamps[0] == 0 else "the same"}'
    if backward > MAX_BACKWARD * steps_taken:
        return f'{backward / steps_taken:.0%} of the {origin} stamps step back in time'
    if repeated > MAX_REPEATED * steps_taken:
        return f'{repeated / steps_taken:.0%} of the {origin} stamps repeat the one before'
    return ''
