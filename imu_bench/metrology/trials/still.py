# SPDX-License-Identifier: Apache-2.0
"""Finding the positions at which a sensor that is turned about lies still."""

from __future__ import annotations

from typing import NamedTuple

from imu_bench.errors import DataError
from imu_bench.metrology.statistics import MAD_TO_SIGMA
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

BLOCK_S = 0.25
"""Stillness is judged in blocks of this length."""

FEWEST = 5
"""Samples of a block, whatever its length."""

QUIET = 0.1
"""Share of the blocks that is still, at least: these show the noise."""

RESTLESS = 3.0
"""
A block scatters so many times as much as the quiet ones when it is not still: one good block in
ten million of `FEWEST` samples of three axes, fewer of more samples.
"""

JUMP = 8.0
"""Neighbouring blocks of one position differ by less than so many times their usual scatter."""


class Position(NamedTuple):
    """Samples from `begin` up to, but without, `end`."""

    begin: int
    end: int


def find_positions(
    acceleration: npt.ArrayLike,
    rate_hz: float,
    angular_velocity: npt.ArrayLike | None = None,
    *,
    shortest_s: float = 1.0,
) -> tuple[Position, ...]:
    """
    Return where a sensor lies still.

    As D. Tedaldi, A. Pretto and E. Menegatti 2014, "A robust and easy to implement method for
    IMU calibration without external equipments", ICRA: still is what scatters little.  The limit
    is three times the scatter of the quietest tenth of all blocks, for accelerometer and
    gyroscope each; a block at both ends of a position is left out.

    Parameters
    ----------
    shortest_s : float
        Shortest position to look for.

    Raises
    ------
    DataError
        If the recording is shorter than that.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> force = np.repeat([[0, 0, 9.8], [9.8, 0, 0]], 500, axis=0) + rng.normal(0, 0.01, (1000, 3))
    >>> force[450:550] += rng.normal(0, 1.0, (100, 3))
    >>> [(p.begin, p.end) for p in find_positions(force, 100.0)]
    [(0, 425), (575, 1000)]
    """
    size = max(FEWEST, round(rate_hz * BLOCK_S))
    signals = [np.asarray(acceleration, np.float64)]
    if angular_velocity is not None:
        signals.append(np.asarray(angular_velocity, np.float64))
    count = len(signals[0]) // size
    if count * size < shortest_s * rate_hz or count < 4:
        raise DataError(
            f'{len(signals[0]) / rate_hz:.3g} s are too short for positions of {shortest_s:g} s'
        )
    still = np.ones(count, np.bool_)
    jumps = np.zeros(count, np.bool_)
    for values in signals:
        blocks = values[: count * size].reshape(count, size, 3)
        scatter = np.sqrt(blocks.var(axis=1).sum(axis=1))
        still &= scatter <= RESTLESS * float(np.quantile(scatter, QUIET))
        jumps |= _jumps(blocks.mean(axis=1), still)
    found = []
    for begin, end in _runs(still, jumps):
        first, last = begin + (begin > 0), end - (end < count)
        if (last - first) * size >= shortest_s * rate_hz:
            found.append(Position(first * size, last * size))
    return tuple(found)


def _jumps(means: Floats, still: Mask) -> Mask:
    """Return before which blocks a still sensor has moved."""
    steps = np.linalg.norm(np.diff(means, axis=0), axis=1)
    both = still[1:] & still[:-1]
    usual = MAD_TO_SIGMA * float(np.median(steps[both])) if both.any() else 0.0
    return np.concatenate([[False], steps > JUMP * usual])


def _runs(still: Mask, jumps: Mask) -> list[tuple[int, int]]:
    """Return begin and end of the stretches of still blocks without a jump."""
    runs: list[tuple[int, int]] = []
    begin = -1
    for index, quiet in enumerate([*still.tolist(), False]):
        broken = index < jumps.size and bool(jumps[index])
        if begin >= 0 and (not quiet or broken):
            runs.append((begin, index))
            begin = -1
        if quiet and begin < 0:
            begin = index
    return runs
