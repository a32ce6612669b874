# SPDX-License-Identifier: Apache-2.0
"""Quiet and shaken parts of a recording, found from how strongly it moves."""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.stretches import stretches
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

CONTRAST = 10.0
"""
A shaken part is at least so many times as strong in power as a quiet one: 10 dB.  Noise alone
comes apart by 3.1 dB at most (blocks of 16 samples of one axis, 2000 records of 240 blocks).
"""

_BLOCK_S = 0.5
_PER_BLOCK = 16
"""Length of a block, and the fewest samples of one."""


@dataclass(frozen=True)
class Zone:
    """A part of a recording, s since its first sample."""

    begin_s: float
    end_s: float

    @property
    def length_s(self) -> float:
        """Duration in s."""
        return self.end_s - self.begin_s

    def inside(self, guard_s: float) -> Zone:
        """Return the zone without `guard_s` at either end, but half of it at least."""
        guard = min(guard_s, 0.25 * self.length_s)
        return Zone(self.begin_s + guard, self.end_s - guard)

    def samples(self, rate_hz: float) -> slice:
        """Return the samples of the regular grid that lie in it."""
        return slice(max(0, math.ceil(self.begin_s * rate_hz)), math.floor(self.end_s * rate_hz))


@dataclass(frozen=True)
class Run:
    """A shaken zone with the quiet ones on either side, or None where there is none."""

    before: Zone | None
    test: Zone
    after: Zone | None


def power(data: Floats, rate_hz: float) -> tuple[Floats, float]:
    """
    Return how strongly the data move, block after block, and the length of a block in s.

    Parameters
    ----------
    data : ndarray, shape (n, axes)
        On the regular time grid.

    Returns
    -------
    ndarray, shape (blocks,)
        Variance within each block, summed over the axes.

    Raises
    ------
    DataError
        If the data are shorter than four blocks.
    """
    size = max(_PER_BLOCK, round(_BLOCK_S * rate_hz))
    count = data.shape[0] // size
    if count < 4:
        raise DataError(f'{data.shape[0] / rate_hz:.3g} s are too short to hold several zones')
    # axis by axis and in place of a copy of everything
    total = np.zeros(count)
    for axis in range(data.shape[1]):
        total += data[: count * size, axis].reshape(count, size).var(axis=1)
    return total, size / rate_hz


def shaken(level: Floats, block_s: float, shortest_s: float) -> list[Zone]:
    """
    Return the parts that move much more than the quiet ones, in order.

    Parameters
    ----------
    level : ndarray, shape (blocks,)
        From `power`.
    shortest_s : float
        Shaken parts and quiet gaps shorter than this are no zones of their own.

    Raises
    ------
    DataError
        If quiet and shaken parts cannot be told apart.

    Notes
    -----
    The threshold is Otsu's (N. Otsu 1979, IEEE Trans. Syst. Man Cybern. SMC-9(1):62) on the
    logarithm of the power: it makes the two classes as different as possible.

    Examples
    --------
    >>> quiet, loud = np.full(40, 1e-4), np.full(60, 1.0)
    >>> shaken(np.concatenate([quiet, loud, quiet]), 0.5, 5.0)
    [Zone(begin_s=20.0, end_s=50.0)]
    """
    tiny = np.finfo(np.float64).tiny
    positive = level[level > 0.0]
    if positive.size == 0:
        raise DataError('nothing moves in it')
    decades = np.log10(np.maximum(level, max(float(positive.min()), tiny)))
    limit, contrast = _otsu(decades)
    if contrast < math.log10(CONTRAST):
        raise DataError(
            f'its strongest part is only {10.0 * contrast:.1f} dB above the quiet one, not '
            f'{10.0 * math.log10(CONTRAST):g} dB'
        )
    shortest = max(1, math.ceil(shortest_s / block_s))
    loud = _closed(decades > limit, shortest)
    return [
        Zone(a * block_s, b * block_s) for a, b in stretches(loud).tolist() if b - a >= shortest
    ]


def runs(zones: list[Zone], length_s: float, shortest_s: float) -> list[Run]:
    """
    Return each shaken zone with the quiet parts beside it.

    A quiet part between two tests belongs half to the one, half to the other; one shorter
    than `shortest_s` is none.

    Parameters
    ----------
    zones : list of Zone
        The shaken parts, in the order of time.
    length_s : float
        Length of the recording in s.
    shortest_s : float
        Length in s from which on a quiet part counts.

    Examples
    --------
    >>> runs([Zone(20.0, 50.0)], 70.0, 5.0)[0].after
    Zone(begin_s=50.0, end_s=70.0)
    """
    found = []
    for number, zone in enumerate(zones):
        begin = 0.5 * (zones[number - 1].end_s + zone.begin_s) if number else 0.0
        last = number + 1 == len(zones)
        end = length_s if last else 0.5 * (zone.end_s + zones[number + 1].begin_s)
        before, after = Zone(begin, zone.begin_s), Zone(zone.end_s, end)
        found.append(
            Run(
                before if before.length_s >= shortest_s else None,
                zone,
                after if after.length_s >= shortest_s else None,
            )
        )
    return found


def _otsu(values: Floats) -> tuple[float, float]:
    """Return the threshold between two classes and the distance of their means."""
    ordered = np.sort(values)
    count = np.arange(1, ordered.size)
    below = np.cumsum(ordered)[:-1] / count
    above = (ordered.sum() - np.cumsum(ordered)[:-1]) / (ordered.size - count)
    between = count * (ordered.size - count) * (above - below) ** 2
    cut = int(np.argmax(between))
    return 0.5 * float(ordered[cut] + ordered[cut + 1]), float(above[cut] - below[cut])


def _closed(loud: Mask, shortest: int) -> Mask:
    """Return the mask with short quiet gaps between loud parts filled."""
    filled = loud.copy()
    for begin, end in stretches(~loud).tolist():
        if end - begin < shortest and begin > 0 and end < loud.size:
            filled[begin:end] = True
    return filled
