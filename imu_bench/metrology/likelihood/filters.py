# SPDX-License-Identifier: Apache-2.0
"""
Whether it is a filter that bends a spectrum: white noise behind one against what has none.

Where the deviation curve is fitted behind a filter, its very start may have been left out as that
of a filter of unknown kind.  There, at the highest frequencies, the two differ: a filter leaves
nothing, and beside a correlated noise the white noise stays.
"""

from __future__ import annotations

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.filter_fit import ROUNDED
from imu_bench.metrology.fitting.low_pass import KINDS, LowPass
from imu_bench.metrology.fitting.model_choice import EQUIVALENT
from imu_bench.metrology.fitting.model_fit import PENALTY, TINY
from imu_bench.metrology.likelihood.candidates import likelihoods, rows, scored
from imu_bench.metrology.likelihood.cosines import Bins, Cosines
from imu_bench.metrology.statistics import resolution
import numpy as np

MOST = 1 << 18, 1 << 21
"""
Samples that are looked at: 44 min at 100 Hz show most filters by hundreds in −2 ln L.  One that
they do not show is asked for once more, of 5.8 h.
"""

FEWEST = 1024
"""Samples from which on it is asked at all."""

BESIDE = ('N', '', 'B', 'K', 'NB', 'NK')
"""What may be there besides; N is what joins behind the filter, as rounding does."""

COARSE = 1.5
"""
What joins behind a filter over step²/12, at most, where the values show the steps.

The variance of the error of rounding is step²/12 (1 ± (12/π²) e^(−2π²σ²)), σ in steps, by where
the mean lies (the first term of the Fourier series of the error): 26 % more at σ = 0.28.
"""

_REACH, _STEPS = 1.6, (0.4, 0.1, 0.025)


def refuted(values: Floats, rate_hz: float, low_pass: LowPass) -> bool:
    """
    Return whether the spectrum does without the filter that a curve was fitted with.

    That is where a sum without one describes the spectrum up to half the rate, and is likelier
    than any with white noise behind a filter of `KINDS`.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples without gaps, as they are: averages have lost what tells the two apart.
    rate_hz : float
        Samples per second.
    low_pass : LowPass
        The filter that was fitted.
    """
    if values.size < FEWEST or not float(np.std(values[: MOST[0]])) > 0.0:
        return False
    sizes = dict.fromkeys(min(most, values.size) for most in MOST)
    return all(_needless(values[:size], rate_hz, low_pass) for size in sizes)


def _needless(part: Floats, rate_hz: float, low_pass: LowPass) -> bool:
    scale = float(np.std(part))
    bins = Cosines.of(part / scale, rate_hz).binned(0.5 * rate_hz)
    without = likelihoods(bins)[0]
    if not without.describes(bins):
        return False
    step = resolution(part) / scale
    rounding = COARSE * step**2 / 12.0 / rate_hz
    return without.score + EQUIVALENT < _behind(bins, low_pass, rounding)


def _behind(bins: Bins, low_pass: LowPass, rounding: float) -> float:
    """Return the score of the likeliest sum with white noise behind a filter."""
    found = []
    for kind in KINDS:
        at, reach = low_pass.warped, _REACH
        for step in _STEPS:
            cutoffs = np.arange(at - reach, at + reach + 0.5 * step, step).tolist()
            filters = [LowPass(w, kind, low_pass.period) for w in cutoffs]
            scores = _scores(bins, filters, rounding)
            at, reach = cutoffs[int(np.argmin(scores))], step
            found.append(float(scores.min()))
    return min(found)


def _scores(bins: Bins, filters: list[LowPass], rounding: float) -> Floats:
    """Return the best score behind each filter, of which no more joins than by rounding."""
    plain = dict(zip('NBK', rows(bins.frequency, 'NBK', 0.0), strict=True))
    basis = np.zeros((len(filters), len(BESIDE), 3, bins.frequency.size))
    for at, low_pass in enumerate(filters):
        basis[at, :, 0] = low_pass.gain(bins.frequency) * plain['N']
        for row, terms in enumerate(BESIDE):
            for column, term in enumerate(terms, 1):
                basis[at, row, column] = plain[term]
    squares, misfit = scored(bins, basis.reshape(-1, *basis.shape[2:]))
    squares, misfit = squares.reshape(basis.shape[:3]), misfit.reshape(basis.shape[:2])
    present = np.array([[column <= len(terms) for column in range(3)] for terms in BESIDE])
    joins = np.array(['N' in terms for terms in BESIDE])
    share = np.where(joins, squares[..., 1] / np.maximum(squares[..., :2].sum(axis=-1), TINY), 0.0)
    most = np.array([ROUNDED * f.cutoff * f.period for f in filters])[:, None]
    few = (share <= most) | (squares[..., 1] <= rounding)
    possible = np.all((squares > 0.0) | ~present, axis=-1) & few
    # the cutoff is a parameter, too
    score = misfit + PENALTY * (present.sum(axis=1) + 1.0)
    return np.asarray(np.where(possible, score, np.inf).min(axis=1), np.float64)
