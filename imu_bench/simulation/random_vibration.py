# SPDX-License-Identifier: Apache-2.0
"""Band-limited random vibration, the same for every sensor that asks at whatever times."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
import math
import threading

from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import Band, Part, Seed
from imu_bench.simulation.sensor_errors import Array
from msg_conversions.quantities import AXES
import numpy as np

BLOCK = 1 << 15
"""Points that are made at once; half of them overlap with the next block."""

POINTS_PER_PERIOD = 8
"""Points per period of the highest frequency: cubic interpolation loses 0.8 % there."""

KEPT = 64
"""Pieces in memory: sensors of a bench that are simulated side by side share them."""


class RandomVibration(Part):
    """
    Gaussian acceleration of constant spectral density within a band, nothing outside.

    Blocks of independent random phases and amplitudes on every line of the band overlap by
    half, with sine and cosine as weights, so that the variance is the same at all times.
    """

    def __init__(
        self,
        density: Sequence[float],
        low_hz: float,
        high_hz: float,
        seed: Seed = 0,
        name: str = 'random vibration',
    ) -> None:
        if not 0.0 < low_hz < high_hz:
            raise ConfigError(
                f'{name}: no band between {low_hz:g} Hz and {high_hz:g} Hz; low must be above '
                'zero and below high'
            )
        self._density = np.asarray(density, dtype=float)
        self._band = Band(name, low_hz, high_hz)
        self._seed = [seed] if isinstance(seed, int) else list(seed)
        self._rate_hz = POINTS_PER_PERIOD * high_hz
        self._pieces: OrderedDict[tuple[int, int], Array] = OrderedDict()
        self._blocks: OrderedDict[tuple[int, int], Array] = OrderedDict()
        self._lock = threading.Lock()
        phase = np.pi * (np.arange(BLOCK) + 0.5) / BLOCK
        self._weights = np.sin(phase)

    @property
    def bands(self) -> Sequence[Band]:
        """The band, if anything shakes in it."""
        return (self._band,) if self._density.any() else ()

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3)."""
        force = np.zeros((t.size, len(AXES)))
        if not t.size:
            return force
        place = t * self._rate_hz
        index = np.floor(place).astype(np.int64)
        weights = _cubic(place - index)
        first, last = int(index.min()) - 1, int(index.max()) + 2
        index -= first
        for axis in np.flatnonzero(self._density):
            points = self._points(int(axis), first, last)
            force[:, axis] = sum(
                weight * points[index + k]
                for k, weight in zip((-1, 0, 1, 2), weights, strict=True)
            )
        return force

    def _points(self, axis: int, first: int, last: int) -> Array:
        """Return the points from number `first` to `last`, both included."""
        half = BLOCK // 2
        pieces = range(first // half, last // half + 1)
        with self._lock:
            points = [self._piece(axis, number) for number in pieces]
        joined = points[0] if len(points) == 1 else np.concatenate(points)
        start = first - pieces[0] * half
        return joined[start : start + last - first + 1]

    def _piece(self, axis: int, number: int) -> Array:
        """Return half a block of points: the end of one block and the beginning of the next."""
        key = (axis, number)
        if key not in self._pieces:
            half = BLOCK // 2
            old, new = self._block(axis, number - 1), self._block(axis, number)
            _keep(self._pieces, key, old[half:] + new[:half])
        return self._pieces[key]

    def _block(self, axis: int, number: int) -> Array:
        key = (axis, number)
        if key not in self._blocks:
            width = self._rate_hz / BLOCK
            lines = np.arange(
                math.ceil(self._band.low_hz / width), math.floor(self._band.high_hz / width) + 1
            )
            # numbers of seeds are not negative; the first block is number -2
            rng = np.random.default_rng([*self._seed, axis, number + 2])
            parts = rng.standard_normal((2, lines.size))
            spectrum = np.zeros(BLOCK // 2 + 1, dtype=complex)
            # the power of the band, shared by the lines in it
            power = self._density[axis] * (self._band.high_hz - self._band.low_hz) / lines.size
            spectrum[lines] = math.sqrt(power) * (parts[0] - 1j * parts[1]) * (BLOCK / 2)
            _keep(self._blocks, key, np.fft.irfft(spectrum, BLOCK) * self._weights)
        return self._blocks[key]


def _keep(store: OrderedDict[tuple[int, int], Array], key: tuple[int, int], made: Array) -> None:
    store[key] = made
    while len(store) > KEPT:
        store.popitem(last=False)


def _cubic(u: Array) -> tuple[Array, Array, Array, Array]:
    """Return Lagrange's weights of the points at -1, 0, 1 and 2 for a place between 0 and 1."""
    below, above = u - 1.0, u + 1.0
    beyond = u - 2.0
    return (
        -u * below * beyond / 6.0,
        above * below * beyond / 2.0,
        -above * u * beyond / 2.0,
        above * u * below / 6.0,
    )
