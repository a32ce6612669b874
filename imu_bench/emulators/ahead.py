# SPDX-License-Identifier: Apache-2.0
"""
Samples filtered and turned into words in blocks, before they are due.

What numpy and scipy cost falls on every call, not on every sample, and a chip is looked at
several hundred times a second.  Of a block only what is due is ever shown.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from imu_bench.samples import Samples
import numpy as np

_Rows = TypeVar('_Rows')


class Source(Protocol):
    """
    What a chip samples, as `imu_bench.simulation.chip.SensorSource` gives it.

    One that makes samples ahead also has `samples_ahead(t_ns)`, which returns those as well.
    """

    def samples_until(self, t_ns: int) -> Samples:
        """Return the samples made since the last call, up to and including `t_ns`."""
        ...

    def restart(self, t_ns: int, nominal_hz: float | None = None) -> None:
        """Sample anew from `t_ns` on, at another rate if one is given."""
        ...


class Stateful(Protocol):
    """Something that remembers the samples before, such as a filter."""

    state: Any
    """All it remembers; never changed in place."""


class Due(NamedTuple):
    """Samples whose time has come: those from `first` to before `last` of a block."""

    samples: Samples  # of the whole block
    # what was made of them, of the whole block: before Python 3.11 no NamedTuple is generic
    rows: Any
    first: int
    last: int


class Ahead(Generic[_Rows]):
    """A source whose samples are converted ahead."""

    def __init__(
        self,
        source: Source,
        convert: Callable[[Samples], _Rows],
        stateful: Callable[[], Iterable[Stateful]] = tuple,
    ) -> None:
        self._source = source
        self._fetch = getattr(source, 'samples_ahead', source.samples_until)
        self._convert = convert
        self._stateful = stateful
        self.forget()

    def forget(self) -> None:
        """Drop what is not due yet."""
        self._samples: Samples | None = None
        self._rows: _Rows | None = None
        self._times: list[int] = []
        self._taken = 0
        self._before: list[tuple[Stateful, Any]] = []

    def restart(self, t_ns: int, nominal_hz: float | None = None) -> None:
        """Sample anew from a time on; what is not due yet is dropped."""
        self.forget()
        self._source.restart(t_ns, nominal_hz)

    def rewind(self) -> None:
        """Take note that a setting is about to change: what is not due yet is made of it anew."""
        if self._samples is None or self._rows is None:
            return
        for thing, state in self._before:
            thing.state = state
        if self._taken:
            self._convert(self._samples[: self._taken])
        self._hold(self._samples[self._taken :])

    def _hold(self, samples: Samples) -> None:
        self._samples, self._rows, self._taken = samples, None, 0
        self._times = samples.stamps.tolist()

    def until(self, to_ns: int) -> Iterator[Due]:
        """Yield what is due, block by block."""
        while True:
            if self._taken == len(self._times):
                samples = self._fetch(to_ns)
                if not len(samples):
                    return
                self._hold(samples)
            samples, first = self._samples, self._taken
            last = bisect_right(self._times, to_ns, first)
            if samples is None or last == first:
                return
            if self._rows is None:
                self._before = [(thing, thing.state) for thing in self._stateful()]
                self._rows = self._convert(samples)
            self._taken = last
            yield Due(samples, self._rows, first, last)


def rows_of(words: np.ndarray) -> list[bytes]:
    """Return the bytes of each row of an array, shape (n, ...)."""
    whole, size = words.tobytes(), words[:1].nbytes
    return [whole[k : k + size] for k in range(0, len(whole), size or 1)]
