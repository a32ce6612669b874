# SPDX-License-Identifier: Apache-2.0
"""Finding the times at which a signal stands still between steps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
import math

from imu_bench.errors import DataError
from imu_bench.metrology.statistics import MAD_TO_SIGMA
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

PER_DWELL = 20
"""Blocks into which the shortest stand is divided."""

BESIDE = 10
"""Blocks on each side of a place that are compared there: half the shortest stand."""

SHORT = 3
"""Blocks whose means show the noise."""

LIMIT = 6.0
"""
A step is a difference beyond so many standard deviations of the noise, that of two short means; in
white noise the medians that are compared scatter 0.7 times as much.
"""

RESTLESS = 5.0
"""
A block is not at rest when its mean is so many scatters off that of its stand, as one good block
of 1.7 million is, or its scatter so many times that of its middle.
"""


@dataclass(frozen=True)
class Stand:
    """Samples from `begin` up to, but without, `end` at one level."""

    begin: int
    end: int
    level: float


@dataclass(frozen=True)
class Stands:
    """What a signal with steps looks like."""

    stands: tuple[Stand, ...]
    noise: float  # standard deviation of the difference of two short means next to each other

    @property
    def contrast(self) -> float:
        """How far the levels are apart, in terms of the noise."""
        levels = [stand.level for stand in self.stands]
        span = max(levels) - min(levels) if levels else 0.0
        return span / self.noise if self.noise > 0.0 else (math.inf if span else 0.0)


def find_stands(
    data: npt.ArrayLike, rate_hz: float, *, dwell_s: float = 5.0, settle_s: float = 1.0
) -> Stands:
    """
    Return where a signal stands still, with moves in between.

    Means of blocks of a twentieth of the shortest stand are looked at.  At every place the
    medians of ten blocks before and after are compared: a moving-sum detector (B. Eichinger
    and C. Kirch 2018, "A MOSUM procedure for the estimation of multiple random change
    points", Bernoulli 24(1):526), with medians for spikes.  Its limit is six times the robust
    scatter of the difference of means over three blocks, which for white noise is wider than
    that of ten blocks and for flicker noise the same.  Each stand between two steps is then
    shortened to the blocks that are at its level and as quiet as its middle.

    Parameters
    ----------
    data : array_like, shape (n,)
        Regular samples, such as an angle.
    dwell_s : float
        Shortest stand to look for.
    settle_s : float
        Time left out after and before each move.

    Raises
    ------
    DataError
        If the signal is shorter than two stands, or the rate too low for the dwell.

    Examples
    --------
    >>> rng = np.random.default_rng(3)
    >>> steps = np.repeat([0.0, 1.0, 2.0, 1.0], 2000) + rng.normal(0.0, 0.3, 8000)
    >>> [round(stand.level) for stand in find_stands(steps, 100.0).stands]
    [0, 1, 2, 1]
    """
    values = np.asarray(data, np.float64)
    size = round(rate_hz * dwell_s / PER_DWELL)
    if size < 1:
        raise DataError(f'{rate_hz:g} Hz is too slow for stands of {dwell_s:g} s')
    count = values.size // size
    if count < 2 * PER_DWELL:
        raise DataError(
            f'{values.size / rate_hz:.3g} s are too short for two stands of {dwell_s:g} s'
        )
    blocks = values[: count * size].reshape(count, size)
    means, spread = blocks.mean(axis=1), blocks.std(axis=1)
    noise = _noise(means)
    changes = _changes(means, max(LIMIT * noise, 1e-9 * float(np.ptp(means))))
    edges = [0, *changes, count]
    own = MAD_TO_SIGMA * float(np.median(np.abs(np.diff(means)))) / math.sqrt(2.0)
    settle = math.ceil(settle_s * rate_hz / size)
    found = []
    for begin, end in pairwise(edges):
        first, last = _quiet(means, spread, begin, end, own)
        first, last = first + settle * (begin > 0), last - settle * (end < count)
        if last - first >= PER_DWELL // 2:
            level = float(np.mean(means[first:last]))
            found.append(Stand(first * size, last * size, level))
    return Stands(_apart(found, LIMIT * noise), noise)


def _noise(means: Floats) -> float:
    """Return the robust scatter of the difference of two short means next to each other."""
    groups = means.size // SHORT
    short = means[: groups * SHORT].reshape(groups, SHORT).mean(axis=1)
    return MAD_TO_SIGMA * float(np.median(np.abs(np.diff(short))))


def _changes(means: Floats, limit: float) -> list[int]:
    """Return the blocks before which the level changes."""
    windows = np.lib.stride_tricks.sliding_window_view(means, BESIDE)
    middle = np.median(windows, axis=1)
    jump = np.abs(middle[BESIDE:] - middle[:-BESIDE])
    # zeros at the ends, so that a step near the start or the end is a peak too
    peaks, _ = scipy.signal.find_peaks(np.pad(jump, 1), height=limit, distance=BESIDE // 2)
    return [int(peak) - 1 + BESIDE for peak in peaks]


def _quiet(means: Floats, spread: Floats, begin: int, end: int, own: float) -> tuple[int, int]:
    """Return the part of a stretch of blocks that is at the level of its middle, and as quiet."""
    quarter = (end - begin) // 4
    core = slice(begin + quarter, max(end - quarter, begin + quarter + 1))
    level = float(np.median(means[core]))
    scale = max(MAD_TO_SIGMA * float(np.median(np.abs(means[core] - level))), own)
    calm = float(np.median(spread[core]))
    restless = np.abs(means[begin:end] - level) > RESTLESS * scale
    restless |= spread[begin:end] > RESTLESS * calm
    # one block alone is a spike, not the end of the stand
    twice = restless[1:] & restless[:-1]
    centre = (core.start + core.stop) // 2 - begin
    before, after = np.flatnonzero(twice[:centre]), np.flatnonzero(twice[centre:])
    first = begin + (int(before[-1]) + 2 if before.size else int(restless[0]))
    last = begin + centre + int(after[0]) if after.size else end - int(restless[-1])
    return first, last


def _apart(found: list[Stand], limit: float) -> tuple[Stand, ...]:
    """Of stands next to each other at the same level keep the longest."""
    kept: list[Stand] = []
    for stand in found:
        if kept and abs(stand.level - kept[-1].level) < limit:
            if stand.end - stand.begin > kept[-1].end - kept[-1].begin:
                kept[-1] = stand
        else:
            kept.append(stand)
    return tuple(kept)
