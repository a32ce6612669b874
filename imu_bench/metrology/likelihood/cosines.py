# SPDX-License-Identifier: Apache-2.0
"""
A record as its cosine transform, whose terms are as good as independent for any drifting noise.

The even continuation of a record has no jump at its ends, so nothing of a random walk leaks into
high frequencies and no taper has to be paid for.  The terms of the DCT-II are independent, exactly
for white noise and for a random walk (its steps come out in the sines of a DST), nearly for all
between: term k has the variance S(k/2T)/τ0 of the two-sided density S.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from imu_bench.metrology import workspace
from imu_bench.metrology.curve import Floats
import numpy as np
import scipy

BINS_PER_E = 8
"""Bins per factor e of frequency: finer than any feature of a noise."""

LINE = 66.0
"""A term this many medians of its bin is a line: 30 times the mean, by chance in 1 of 2·10⁷."""

SLOWEST = 4096
"""
Terms in which steps and cycles are looked for, 2048 cycles per record at most: there a line is
not left out but found.
"""

_FEWEST = 16


@dataclass(frozen=True, eq=False)
class Cosines:
    """The cosine transform of n values."""

    terms: Floats  # of the orthonormal DCT-II, without the mean
    rate_hz: float  # values per second
    size: int = 1  # samples of which each value is the average
    # what this was before its slowest terms were changed, and how many of them
    before: tuple[Cosines, int] | None = None
    _known: dict[float, Bins] = field(default_factory=dict, repr=False)  # by highest frequency

    @classmethod
    def of(cls, values: Floats, rate_hz: float, size: int = 1) -> Cosines:
        """Return the transform of values without gaps."""
        return cls(np.asarray(scipy.fft.dct(values, norm='ortho')[1:]), rate_hz, size)

    @property
    def span(self) -> float:
        """Length of the record in s."""
        return (self.terms.size + 1) / self.rate_hz

    def density(self, count: int | None = None) -> Floats:
        """Return the one-sided density of each term, or of the slowest."""
        return np.asarray(2.0 / self.rate_hz * self.terms[:count] ** 2)

    def slowest(self, count: int) -> Cosines:
        """Return the transform of averages of which there are this many."""
        count = min(count, self.terms.size + 1)
        share = count / (self.terms.size + 1)
        # averages are smaller by the root of what goes into one: orthonormal over fewer values
        terms = self.terms[: count - 1] * math.sqrt(share)
        return Cosines(terms, self.rate_hz * share)

    def without(self, part: Floats) -> Cosines:
        """Return the transform less that of something known, of the slowest terms."""
        terms = self.terms.copy()
        terms[: part.size] -= part
        return Cosines(terms, self.rate_hz, self.size, (self, part.size))

    def binned(self, highest: float) -> Bins:
        """Return means over bins of frequency, single ones at the low end."""
        if highest not in self._known:
            self._known[highest] = self._binned(highest)
        return self._known[highest]

    def _binned(self, highest: float) -> Bins:
        last = max(min(int(2.0 * self.span * highest), self.terms.size), 2)
        count = max(int(BINS_PER_E * math.log(last)), 1)
        starts = np.unique(np.geomspace(1.0, last + 1.0, count + 1).round().astype(np.int64))[:-1]
        edges = np.append(starts, last + 1)
        sizes = np.diff(edges)
        # bins of terms that are as they were before are so, too
        same = None if self.before is None else self.before[0].binned(highest)
        fresh = starts.size if self.before is None else np.searchsorted(starts, self.before[1] + 1)
        density = self.density(int(edges[fresh]) - 1)
        kept = np.ones(density.size, np.bool_)
        wide = (sizes >= _FEWEST) & (starts > SLOWEST)
        for at in np.flatnonzero(wide[:fresh]).tolist():
            part = slice(edges[at] - 1, edges[at + 1] - 1)
            kept[part] = density[part] <= LINE * workspace.median(density[part])
        degrees = np.add.reduceat(kept.astype(np.float64), starts[:fresh] - 1)
        means = np.add.reduceat(np.where(kept, density, 0.0), starts[:fresh] - 1) / degrees
        if same is not None:
            degrees = np.concatenate([degrees, same.degrees[fresh:]])
            means = np.concatenate([means, same.density[fresh:]])
        # the mean of 1/f² between two edges is 1 over their product, that of 1/f the same to 0.1 %
        frequency = np.sqrt((edges[:-1] - 0.5) * (edges[1:] - 0.5)) / (2.0 * self.span)
        frequency[sizes == 1] = edges[:-1][sizes == 1] / (2.0 * self.span)
        return Bins(frequency, means, degrees, self.span, self.rate_hz, self.size)


@dataclass(frozen=True, eq=False)
class Bins:
    """
    A binned spectrum: `density` of `degrees` independent normal terms each, shape (k,).

    `span` is the length of the record in s; `rate_hz` and `size` are those of the values.
    """

    frequency: Floats
    density: Floats
    degrees: Floats
    span: float
    rate_hz: float
    size: int
