# SPDX-License-Identifier: Apache-2.0
"""Measured quantities: where their words are, what an LSB is worth, which way the axes point."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Any

from imu_bench.errors import ConfigError
from imu_bench.registers import words as wire_words
from imu_bench.registers.fields import Declaration, Field, Register, Value
import numpy as np
import numpy.typing as npt

Factor = float | tuple[float, ...]
"""SI per LSB: one number, or one per component in the order of the registers."""

Limits = tuple[int, int]
"""Smallest and largest reading."""

_Array = npt.NDArray[Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Channel(Declaration, ABC):
    """A measured quantity: where its words are and what an LSB is worth; see Vector and Scalar."""

    first: Register  # the run of registers that holds the words
    quantity: str  # field of `Samples` that receives it
    unit: str  # SI unit
    # word as numpy writes it, byte order included, such as '>i2'; '>i3' has three bytes
    dtype: str
    si_per_lsb: Factor | Mapping[Any, Factor]
    scaled_by: Field | None = None  # the range field on which the LSB depends
    offset: float = 0.0  # SI value at word 0
    shift: int = 0  # unused low bits of left-justified words
    # smallest and largest reading, after the shift; a reading there counts as saturated. Default:
    # the whole word
    limits: Limits | Mapping[Any, Limits] | None = None
    components = 1

    def __post_init__(self) -> None:
        by_range = isinstance(self.si_per_lsb, Mapping)
        codes = None if self.scaled_by is None else self.scaled_by.codes
        ranges = set(codes) if codes is not None else None
        if by_range is not (ranges is not None) or (
            isinstance(self.si_per_lsb, Mapping) and set(self.si_per_lsb) != ranges
        ):
            raise ConfigError(
                f'{self.quantity}: si_per_lsb must give one factor for each value of scaled_by '
                f'({ranges})'
            )
        if wire_words.size(self.dtype) * self.components != self.first.size:
            raise ConfigError(
                f'{self.quantity}: {self.components} x {self.dtype} does not fill the '
                f'{self.first.size} bytes from 0x{self.first.address:02X} on'
            )

    @cached_property
    def is_integer(self) -> bool:
        """Return whether words are counts; False for a chip that sends floats."""
        return wire_words.held(self.dtype).kind in 'iu'

    @cached_property
    def quantised(self) -> bool:
        """Return whether readings have steps: counts, be they sent as integers or as floats."""
        return self.is_integer or self.limits is not None

    @cached_property
    def word_limits(self) -> tuple[float, float]:
        """Return the smallest and the largest reading, of the widest range."""
        if isinstance(self.limits, Mapping):
            low, high = zip(*self.limits.values(), strict=True)
            return min(low), max(high)
        if self.limits is not None:
            return self.limits
        if not self.is_integer:
            return -math.inf, math.inf
        smallest, largest = wire_words.limits(self.dtype)
        return smallest >> self.shift, largest >> self.shift

    def limits_at(self, range_: Value | None) -> tuple[float, float]:
        """Return the smallest and the largest reading at a range."""
        return self.limits[range_] if isinstance(self.limits, Mapping) else self.word_limits

    def factor(self, range_: Value | None = None) -> _Array:
        """Return SI per LSB of each component, in the order of the registers."""
        return self._factors[range_]

    @cached_property
    def _factors(self) -> dict[Value | None, _Array]:
        table = self.si_per_lsb
        by_range = table if isinstance(table, Mapping) else {None: table}
        return {range_: np.full(self.components, factor) for range_, factor in by_range.items()}

    def counts(self, words: _Array) -> _Array:
        """Return readings from words as they came over the wire."""
        return words >> self.shift if self.shift else words

    def within(self, words: _Array, range_: Value | None = None) -> bool:
        """Return whether no component stands at its limit: what `saturated` nearly always says."""
        if not words.size:
            return True
        # a list, because numpy takes longer for as few as a burst has
        counts = self.counts(words).ravel().tolist()
        low, high = self.limits_at(range_)
        return bool(max(counts) < high and min(counts) > low)

    def saturated(self, words: _Array, range_: Value | None = None) -> npt.NDArray[np.bool_]:
        """Return for each row of words whether a component stands at its limit, shape (n,)."""
        counts = self.counts(words).reshape(-1, self.components)
        low, high = self.limits_at(range_)
        return np.asarray(((counts <= low) | (counts >= high)).any(axis=1))

    @abstractmethod
    def decode(self, words: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return SI values of words as they came over the wire."""

    @abstractmethod
    def encode(self, si: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the words a chip sends for SI values: quantised and saturated."""

    @abstractmethod
    def resolution(self, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the size of one LSB in SI of each component."""

    def _quantise(self, counts: _Array, range_: Value | None = None) -> _Array:
        low, high = self.limits_at(range_)
        if self.is_integer:
            counts = np.rint(counts)
        clipped: _Array = np.clip(counts, low, high) * (1 << self.shift)
        return clipped.astype(wire_words.held(self.dtype))


@dataclass(frozen=True, eq=False, kw_only=True)
class Scalar(Channel):
    """
    A quantity with one component, shape (n,).

    Examples
    --------
    >>> out = Register(0x41, access='ro', size=2, reset=None)
    >>> t = Scalar(first=out, quantity='temperature', unit='°C', dtype='>i2',
    ...            si_per_lsb=1 / 333.87, offset=21.0)
    >>> t.decode(np.array([0, 3339])).round(2).tolist()
    [21.0, 31.0]
    """

    def decode(self, words: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return SI values, shape (n,), of words as they came over the wire, shape (n,)."""
        return np.asarray(self.counts(words) * (self.factor(range_)[0] * trim) + self.offset)

    def encode(self, si: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the words a chip sends for SI values: quantised, saturated, shape (n,)."""
        return self._quantise((si - self.offset) / (self.factor(range_)[0] * trim), range_)

    def resolution(self, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the size of one LSB in SI, shape (1,)."""
        return np.asarray(np.abs(self.factor(range_) * trim))


@dataclass(frozen=True, eq=False, kw_only=True)
class Vector(Channel):
    """
    A quantity with three components, shape (n, 3).

    Examples
    --------
    >>> out = Register(0x03, access='ro', size=6, reset=None)
    >>> field = Vector(first=out, quantity='magnetic_field', unit='T', dtype='<i2',
    ...                si_per_lsb=0.15e-6, axes=((0, 1, 0), (1, 0, 0), (0, 0, -1)))
    >>> (field.decode(np.array([[100, 200, 300]])) * 1e6).round(6).tolist()
    [[30.0, 15.0, -45.0]]
    """

    # rows x, y, z of the right-handed body frame (REP-103) over the words in the order of the
    # registers
    axes: tuple[tuple[int, int, int], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    components = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        matrix = np.abs(np.asarray(self.axes))
        if matrix.shape != (3, 3) or (matrix.sum(axis=0) != 1).any() or (matrix > 1).any():
            raise ConfigError(f'{self.quantity}: axes {self.axes} must map axis to axis, by sign')

    @cached_property
    def _order(self) -> _Array | slice:
        """Return which word belongs to x, y, z; a slice when nothing has to be moved."""
        order = np.argmax(np.abs(np.asarray(self.axes)), axis=1)
        return slice(None) if order.tolist() == [0, 1, 2] else order

    @cached_property
    def _signed_factors(self) -> dict[Value | None, _Array]:
        sign = np.asarray(self.axes).sum(axis=1)
        return {range_: factor[self._order] * sign for range_, factor in self._factors.items()}

    def _signed_factor(self, range_: Value | None, trim: Any) -> _Array:
        factor = self._signed_factors[range_]
        if isinstance(trim, float):
            return factor if trim == 1.0 else np.asarray(factor * trim)
        return np.asarray(factor * np.asarray(trim)[self._order])

    def decode(self, words: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """
        Return SI values in the body frame of words as they came over the wire.

        Parameters
        ----------
        words : ndarray, shape (n, 3)
            In the order of the registers.
        range_ : value of `scaled_by`
            The full scale that is set.
        trim : float or array of shape (3,)
            The chip's own sensitivity correction, in the order of the registers.
        """
        si = self.counts(words)[:, self._order] * self._signed_factor(range_, trim)
        return np.asarray(si + self.offset if self.offset else si)

    def encode(self, si: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the words a chip sends for SI values (n, 3): quantised, saturated, (n, 3)."""
        counts = np.empty((len(si), 3))
        counts[:, self._order] = (si - self.offset) / self._signed_factor(range_, trim)
        return self._quantise(counts, range_)

    def resolution(self, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the size of one LSB in SI along x, y, z of the body frame, shape (3,)."""
        return np.abs(self._signed_factor(range_, trim))


@dataclass(frozen=True, eq=False, kw_only=True)
class Axis(Channel):
    """
    The one axis of a vector that a sensor measures; the others are NaN, shape (n, 3).

    Examples
    --------
    >>> out = Register(0x00, access='ro', size=2, reset=None)
    >>> z = Axis(first=out, quantity='acceleration', unit='m/s²', dtype='>u2', si_per_lsb=0.1,
    ...          limits=(0, 4095), zero=2048)
    >>> z.decode(np.array([2058])).tolist()
    [[nan, nan, 1.0]]
    """

    axis: int = 2  # 0 for x, 1 for y, 2 for z
    zero: int = 0  # reading at zero: 0 for two's complement, half of full scale for offset binary

    def decode(self, words: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return SI values, shape (n, 3), of words as they came over the wire, shape (n,)."""
        si = np.full((len(words), 3), np.nan)
        counts = self.counts(words).astype(np.float64) - self.zero
        si[:, self.axis] = counts * (self.factor(range_)[0] * trim) + self.offset
        return si

    def encode(self, si: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the words a chip sends for SI values (n, 3): quantised, saturated, (n,)."""
        counts = (si[:, self.axis] - self.offset) / (self.factor(range_)[0] * trim)
        return self._quantise(counts + self.zero, range_)

    def resolution(self, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the size of one LSB in SI, shape (1,)."""
        return np.asarray(self.factor(range_) * trim)


@dataclass(frozen=True, eq=False, kw_only=True)
class Quaternion(Channel):
    """
    An orientation, shape (n, 4): x, y, z, w, from words in the order w, x, y, z.

    Examples
    --------
    >>> out = Register(0x20, access='ro', size=8, reset=None)
    >>> q = Quaternion(first=out, quantity='orientation', unit='1', dtype='<i2',
    ...                si_per_lsb=2**-14)
    >>> q.decode(np.array([[16384, 0, 0, 0]])).tolist()
    [[0.0, 0.0, 0.0, 1.0]]
    """

    components = 4

    def decode(self, words: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return x, y, z, w, shape (n, 4), of words as they came over the wire, shape (n, 4)."""
        return np.asarray(self.counts(words)[:, [1, 2, 3, 0]] * (self.factor(range_)[0] * trim))

    def encode(self, si: _Array, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the words a chip sends for x, y, z, w (n, 4): quantised, saturated, (n, 4)."""
        counts = np.asarray(si)[:, [3, 0, 1, 2]] / (self.factor(range_)[0] * trim)
        return self._quantise(counts, range_)

    def resolution(self, range_: Value | None = None, trim: Any = 1.0) -> _Array:
        """Return the size of one LSB, shape (4,)."""
        return np.asarray(self.factor(range_) * trim)
