# SPDX-License-Identifier: Apache-2.0
"""What a user may say about a recording that the recording does not say itself."""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import RecordingError

MAX_RATE_HZ = 1e6
"""No inertial sensor comes near; a larger number is a period or a typing error."""


@dataclass(frozen=True)
class ReadOptions:
    """
    How to read a recording.

    Attributes
    ----------
    topics : tuple of str
        Topics wanted; empty means every Imu topic.
    rate_hz : float or None
        Sample rate of a text file without a time column, in Hz.
    columns : str or None
        Meaning of the columns of a text file: names in the order of the
        columns (``-`` for a column to ignore), or ``header=name`` pairs;
        separated by commas.
    units : str or None
        Units of the columns of a text file: ``name=unit`` pairs separated by
        commas, the unit optionally divided by counts per unit, as in
        ``linear_acceleration=g/16384,angular_velocity=deg/s/131``.
    join : tuple of str
        Text files, by their resolved paths, that are read with the one they continue.
    full : bool
        Orientations and covariances of Imu messages, too, which no analysis needs.

    Raises
    ------
    RecordingError
        If the rate is not a positive number of Hz.

    Examples
    --------
    >>> ReadOptions(rate_hz=100).rate_hz
    100
    """

    topics: tuple[str, ...] = ()
    rate_hz: float | None = None
    columns: str | None = None
    units: str | None = None
    join: tuple[str, ...] = ()
    full: bool = False

    def __post_init__(self) -> None:
        rate = self.rate_hz
        if rate is not None and not (math.isfinite(rate) and 0 < rate <= MAX_RATE_HZ):
            raise RecordingError(
                f'--rate {rate:g}: the sample rate must be above 0 and at most '
                f'{MAX_RATE_HZ:g} Hz, as in --rate 100'
            )
