# SPDX-License-Identifier: Apache-2.0
"""
Which noise model describes a deviation curve: power laws, or one Gauss-Markov process more.

The live analysis and the analysis of recordings both ask here, so their numbers are the same.
"""

from __future__ import annotations

from dataclasses import replace

from imu_bench.metrology.coefficients import CurveFits
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import CONFIDENCE
from imu_bench.metrology.fitting.fit_range import Range
from imu_bench.metrology.fitting.noise_model import NoiseModel, TERMS

DOUBTFUL = 1.5
"""Mean squared residual of power laws that one of 50 records of such noise exceeds."""

BETTER = 3.0
"""
Times less residual that a Gauss-Markov process must leave.  With these two limits none of 240
simulated records of power-law noise got one, and 50 of 60 with a strong process did.
"""

SHORTEST = 20.0
"""Shortest correlation time of a bias, in sample periods: a filter's is shorter."""


def fitted(
    curve: DeviationCurve, confidence: float = CONFIDENCE, reported: str = TERMS
) -> NoiseModel:
    """
    Return the noise model of a curve.

    Power laws (`coefficients.fit`, with the low-pass filter of the sensor) wherever they
    describe the curve.  Where they do not and a Gauss-Markov process does, that is part of the
    model: without it a bias with a memory is shared out among Q, N, B and K, and N comes out
    wrong.  A process that would leave no N is not taken.

    Parameters
    ----------
    curve : DeviationCurve
        Allan deviation.
    confidence : float
        Level of the intervals.
    reported : str
        Coefficients whose estimates are wanted, N among them.  Intervals and bounds take most
        of the time; the fit itself does not depend on this.

    Raises
    ------
    DataError
        As `coefficients.fit`.

    Examples
    --------
    >>> from imu_bench.metrology import allan
    >>> import numpy as np
    >>> x = np.random.default_rng(1).standard_normal(10_000)
    >>> fitted(allan.deviation(x, 100.0)).terms
    'N'
    """
    fits = CurveFits(curve, confidence)
    if fits.none is not None:
        return fits.none
    powers = fits.powers
    if powers.chi2 <= DOUBTFUL and not _odd(powers, curve):
        return fits.model(powers, reported)
    chosen = fits.with_process
    if chosen is None or not chosen.described:
        return fits.model(powers, reported)
    # a curve described from an earlier start on is described better at the same residual
    better = 1.0 if chosen.problem.tau[0] < powers.problem.tau[0] else BETTER
    if chosen.chi2 * better > powers.chi2:
        return fits.model(powers, reported)
    whole = fits.model(chosen, reported)
    process = whole.gauss_markov
    if process is None or process.T_c.value is None:
        return fits.model(powers, reported)
    if process.T_c.value < SHORTEST * curve.period or not whole.N.observable:
        return fits.model(powers, reported)
    flag = (
        f'a Gauss-Markov process with T_c = {process.T_c.value:.2g} s is part of the fit: without '
        f'it the noise terms leave {powers.chi2 / whole.chi2:.2g} times the residual'
    )
    return replace(whole, flags=(*whole.flags, flag))


def _odd(powers: Range, curve: DeviationCurve) -> bool:
    """Return whether a start that no filter explains may be the fault of the slower noise."""
    problem, best = powers.problem, powers.solutions.masks[powers.solutions.likeliest]
    left_out = problem.tau[0] > curve.tau[0]
    slower = any(on for t, on in zip(problem.terms, best, strict=True) if t in 'BKR')
    return problem.low_pass is not None and bool(left_out) and slower
