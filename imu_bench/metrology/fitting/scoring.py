# SPDX-License-Identifier: Apache-2.0
"""
Maximum likelihood of variances that are sums of terms, for many sums at once.

An estimate s of a variance σ² with ν degrees of freedom scatters as σ² χ²_ν/ν, be it an Allan
variance or a spectral density.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import product

from imu_bench.metrology.curve import Floats
import numpy as np
import numpy.typing as npt
import scipy

Bools = npt.NDArray[np.bool_]

MODEL_ERROR = 0.01
"""
Relative error of the model granted to every variance.  No sensor is a sum of power laws to
better than a percent; without it the shortest averaging times, millions of degrees of freedom
each, would decide alone.
"""

_PASSES = 8
"""Scoring passes; the squares then move by less than a thousandth of their error."""


@lru_cache(maxsize=64)
def subsets(count: int, largest: int) -> Bools:
    """Return every non-empty subset of `count` terms with at most `largest` of them."""
    masks = np.array(list(product((False, True), repeat=count)), dtype=np.bool_)
    sizes = masks.sum(axis=1)
    chosen: Bools = masks[(sizes > 0) & (sizes <= largest)]
    return chosen


def scored(
    data: Floats,
    basis: Floats,
    masks: Bools,
    degrees_of: Callable[[Floats], Floats],
    first: Floats,
) -> Floats:
    """Solve the likelihood equations of σ² χ²_ν/ν for σ² = Σ θ_j basis_j, by Fisher scoring."""
    count, terms = masks.shape
    products = (basis[:, None, :] * basis[None, :, :]).reshape(terms * terms, -1)
    sums = np.vstack([products, basis * data]).T
    both = masks[:, :, None] & masks[:, None, :]
    diagonal = np.arange(terms)
    model = np.broadcast_to(data, (count, data.size))
    degrees = np.broadcast_to(first, model.shape)
    raw = np.zeros((count, terms))
    for _ in range(_PASSES):
        both_sides = (degrees / model**2) @ sums
        normal = both_sides[:, :-terms].reshape(count, terms, terms)
        right = both_sides[:, -terms:]
        scale = 1.0 / np.sqrt(normal[:, diagonal, diagonal])
        normal = np.where(both, normal * scale[:, :, None] * scale[:, None, :], 0.0)
        # terms outside a subset keep an equation of their own, x = 0; a small ridge keeps
        # columns that look the same solvable
        normal[:, diagonal, diagonal] = 1.0 + 1e-12
        right = np.where(masks, right * scale, 0.0)
        raw = np.linalg.solve(normal, right[..., None])[..., 0] * scale
        squares = np.maximum(raw, 0.0)
        model = np.maximum(squares @ basis, 0.01 * data)
        degrees = degrees_of(squares)
    return raw


def granted(degrees: Floats) -> Floats:
    """Return degrees of freedom that include `MODEL_ERROR`."""
    result: Floats = 2.0 / (2.0 / degrees + MODEL_ERROR**2)
    return result


def minus_two_log_likelihood(
    data: Floats, model: Floats, degrees: Floats, counts: Floats | float = 1.0
) -> Floats:
    """Return −2 ln L of σ² χ²_ν/ν, without its constant."""
    half = 0.5 * degrees
    ratio = data / np.maximum(model, 0.01 * data)
    log_density = half * (np.log(half * ratio) - ratio) - scipy.special.gammaln(half)
    return np.asarray(-2.0 * (log_density * counts).sum(axis=-1), np.float64)
