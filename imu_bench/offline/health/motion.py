# SPDX-License-Identifier: Apache-2.0
"""
Was the sensor still?  Finds when it was turned, tilted, shaken or touched.

The recording is cut into blocks of about one second.  Sensor noise that is
stationary moves the mean of a block by no more than its own scatter allows,
and keeps the scatter inside a block constant; motion breaks one of the two.
A change counts only if it is both improbable for the noise of this very
recording and larger than any bias drift of a sensor at rest, so that neither a
noisy sensor nor a very quiet one raises a false alarm.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from imu_bench.metrology.stretches import stretches
from imu_bench.offline.analysis.axes import Axis
from msg_conversions.quantities import ANGULAR_VELOCITY
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

BLOCK_S = 1.0
_MIN_BLOCK = 32  # samples; fewer make the scatter of a block itself too uncertain
_SIGMAS = 8.0  # improbable in 10 million blocks of Gaussian noise
_SPREAD = 4.0  # block scatter against its median; 32 samples give 1 ± 0.13
_COLOURED = 10.0  # block means of filtered noise scatter up to this much more than of white noise
# What a MEMS sensor at rest does not do from one second to the next (m/s², rad/s): the bias
# instability of consumer parts is below 0.2 mg (Shabulinzenze 2020, Tampere University MSc thesis,
# table 5.5: 6.8 m/s/h) and 15 °/h (the MPU-6050 of the data set mpu6050_static), and warm-up
# drifts take minutes.  These are 25 and 70 times as much.
_MEAN_FLOOR = {False: 0.05, True: 0.005}
_SCATTER_FLOOR = {False: 0.05, True: 0.01}
_PAUSE = 5  # blocks; a shorter rest between two motions counts as motion
_MAD = 1.4826  # median absolute deviation to σ of a normal distribution


class Motion(NamedTuple):
    """Blocks of a recording with motion; `moving` has shape (blocks,), `size` samples each."""

    size: int
    moving: Bools

    @property
    def share(self) -> float:
        """Part of the recording with motion, between 0 and 1."""
        return float(self.moving.mean()) if self.moving.size else 0.0

    def at(self, positions: npt.NDArray[np.int64]) -> Bools:
        """Return for each sample position whether the sensor moved in its block or next to it."""
        if not self.moving.size:
            return np.zeros(positions.shape, dtype=bool)
        near = self.moving.copy()
        near[1:] |= self.moving[:-1]
        near[:-1] |= self.moving[1:]
        return near[np.minimum(positions // self.size, self.moving.size - 1)]

    def intervals(self) -> list[tuple[int, int]]:
        """Return the moving stretches as sample positions [first, after last)."""
        return [(a * self.size, b * self.size) for a, b in _runs(self.moving)]

    def longest_still(self) -> tuple[int, int]:
        """Return the longest stretch without motion as sample positions."""
        still = _runs(~self.moving)
        if not still:
            return 0, 0
        first, after = max(still, key=lambda run: run[1] - run[0])
        return first * self.size, after * self.size


def detect(signals: Iterable[Axis], rate_hz: float) -> Motion:
    """Return when the sensor moved."""
    size = max(_MIN_BLOCK, round(rate_hz * BLOCK_S))
    moving: Bools | None = None
    for axis in signals:
        found = _axis_moves(axis, size)
        moving = found if moving is None else moving | found
    if moving is None:
        moving = np.zeros(0, dtype=bool)
    for first, after in _runs(~moving):
        if first > 0 and after < moving.size and after - first < _PAUSE:
            moving[first:after] = True
    return Motion(size, moving)


def _axis_moves(axis: Axis, size: int) -> Bools:
    blocks = axis.values.size // size
    if blocks < 3:
        return np.zeros(blocks, dtype=bool)
    mean, scatter = _block_statistics(axis.values, size, blocks)
    rotation = axis.quantity == ANGULAR_VELOCITY
    usual = float(np.median(scatter))
    white = usual * np.sqrt(2.0 / size)
    typical = _MAD * float(np.median(np.abs(np.diff(mean))))
    if typical > max(_COLOURED * white, _MEAN_FLOOR[rotation]):
        return np.ones(blocks, dtype=bool)
    limits = (
        max(_SIGMAS * max(typical, white), _MEAN_FLOOR[rotation]),
        max(_SPREAD * usual, _SCATTER_FLOOR[rotation]),
    )
    suspects = _beyond(mean, scatter, *limits)
    # one wild sample in a block is a fault of the data, not a motion
    for block in np.flatnonzero(suspects):
        mean[block], scatter[block] = _trimmed(axis.values[block * size : (block + 1) * size])
    return _beyond(mean, scatter, *limits) if suspects.any() else suspects


def _beyond(mean: Floats, scatter: Floats, largest_step: float, largest_scatter: float) -> Bools:
    """Return the blocks that are shaken, or on either side of a jump of the mean."""
    # steps between neighbours only: what drifts slowly is bias, not motion
    jump = np.abs(np.diff(mean)) > largest_step
    moving = np.asarray(scatter > largest_scatter)
    moving[1:] |= jump
    moving[:-1] |= jump
    return moving


def _block_statistics(values: Floats, size: int, blocks: int) -> tuple[Floats, Floats]:
    """Return mean and standard deviation of each block, with little memory."""
    mean, scatter = np.empty(blocks), np.empty(blocks)
    at_once = max(1, 2**18 // size)
    for first in range(0, blocks, at_once):
        last = min(first + at_once, blocks)
        part = values[first * size : last * size].reshape(last - first, size)
        mean[first:last] = part.mean(axis=1)
        scatter[first:last] = part.std(axis=1)
    known = np.isfinite(mean)
    if not known.all():
        # a block with lost values tells nothing: neither a jump nor a shake
        mean[~known] = np.median(mean[known]) if known.any() else 0.0
        scatter[~known] = np.median(scatter[known]) if known.any() else 0.0
    return mean, scatter


def _trimmed(block: Floats) -> tuple[float, float]:
    """Return mean and standard deviation without the few most extreme values."""
    distance = np.abs(block - np.median(block))
    kept = block[np.argsort(distance)[: block.size - max(2, block.size // 50)]]
    return float(kept.mean()), float(kept.std())


def _runs(flags: Bools) -> list[tuple[int, int]]:
    return [(a, b) for a, b in stretches(flags).tolist()]
