# SPDX-License-Identifier: Apache-2.0
"""
Noise coefficients Q, N, B, K and R of one axis, each with its uncertainty, from a deviation curve.

The default fit uses the whole curve: see `model_fit` for the method, `uncertainty` for the
intervals.  The slope-tangent method is there by name, for comparison.
"""

from __future__ import annotations

from functools import cached_property
import math
from typing import Literal

from imu_bench.errors import DataError
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import check_confidence, CONFIDENCE, Estimate
from imu_bench.metrology.fitting.correlation_time import likeliest, processes
from imu_bench.metrology.fitting.filter_fit import candidates
from imu_bench.metrology.fitting.fit_range import choose_range, Range, START_MISFIT
from imu_bench.metrology.fitting.fit_report import METHOD, Report
from imu_bench.metrology.fitting.low_pass import LowPass
from imu_bench.metrology.fitting.model_choice import fit_subsets
from imu_bench.metrology.fitting.model_fit import prepare, Problem
from imu_bench.metrology.fitting.noise_model import coefficient_unit, NoiseModel, TERMS
from imu_bench.metrology.fitting.screening import glance
from imu_bench.metrology.fitting.tangent import tangent_fit
from imu_bench.metrology.fitting.transfer import overlapped_degrees
import numpy as np
import numpy.typing as npt

__all__ = ['NoiseModel', 'fit', 'noise_density', 'tangent_fit']

KINDS = ('oadev', 'adev', 'totdev')
"""Deviations whose expectation is the Allan variance."""

FEWEST = 3
"""Points that a fit needs."""

EARLY = 300
"""
Part of a curve, as a multiple of its first averaging time, where a filter is looked for beside a
Gauss-Markov process: there the process still rises like a random walk.  Its shortest correlation
time is `noise_fit.SHORTEST` samples, a filter's longest 80 (`filter_fit.LOWEST`).
"""

ROUNDING = 1e-12
"""Deviation over the highest of the curve below which it is rounding of the phase."""


def fit(
    curve: DeviationCurve, *, confidence: float = CONFIDENCE, terms: str = TERMS
) -> NoiseModel:
    """
    Return the noise coefficients of a curve, each with its interval.

    Terms that the curve does not support are not observable: with an upper bound, and the
    length of a record that would show a term as large as the bound to 10 %.  White noise may
    have passed the low-pass filter that every sensor has: where one bends the start of the
    curve, its cutoff is fitted too, and N is that of the noise at low frequencies.

    Parameters
    ----------
    curve : DeviationCurve
        'oadev', 'adev' or 'totdev'.
    confidence : float
        Level of intervals; a bound is the upper end of one.
    terms : str
        Candidate terms, letters of 'QNBKR'; with 'G' also one Gauss-Markov process, whose
        correlation time is searched (some 20 ms).

    Raises
    ------
    DataError
        If the curve is of another kind, or a term or the confidence makes no sense.

    Notes
    -----
    Model: IEEE Std 952-1997 annex C.  Method: non-negative least squares with weights from the
    model, iterated; the terms chosen by likelihood and tested against the scatter the others
    cause.  Why lines of fixed slope cannot do: Guerrier, Molinari and Stebler, IEEE Signal
    Process. Lett. 23(5) (2016), doi 10.1109/LSP.2016.2541867.

    Examples
    --------
    >>> from imu_bench.metrology import allan
    >>> x = np.random.default_rng(1).standard_normal(100_000)
    >>> model = fit(allan.deviation(x, 100.0, unit='rad/s'))
    >>> model.terms, round(model.N.value, 2), model.N.unit
    ('N', 0.1, 'rad/s/√Hz')
    >>> model.K.observable, model.K.high < 0.01
    (False, True)
    """
    _check(curve, confidence, terms)
    fits = CurveFits(curve, confidence, terms.replace('G', ''))
    if fits.none is not None:
        return fits.none
    process = fits.with_process if 'G' in terms else None
    return fits.model(fits.powers if process is None else process)


class CurveFits:
    """The fits of one curve: of power laws, and of a Gauss-Markov process besides."""

    def __init__(
        self, curve: DeviationCurve, confidence: float = CONFIDENCE, terms: str = TERMS
    ) -> None:
        _check(curve, confidence, terms)
        self._curve, self._confidence, self._terms = curve, confidence, terms
        self._points = _points(curve)

    @property
    def none(self) -> NoiseModel | None:
        """The model if there are too few points for a fit."""
        count = self._points.size
        return _nothing(self._curve, self._confidence, count) if count < FEWEST else None

    def model(self, chosen: Range, reported: str = TERMS) -> NoiseModel:
        """Return the noise coefficients of a fit; see `Report.model`."""
        return Report(chosen, self._curve.unit, self._confidence).model(reported)

    @cached_property
    def powers(self) -> Range:
        """The fit of power laws."""
        return choose_range(_problem(self._curve, self._points, self._terms))

    @cached_property
    def with_process(self) -> Range | None:
        """
        The fit of the whole curve with a Gauss-Markov process, behind a filter if there is one.

        None where a glance says that no process makes the model describe the curve.
        """
        points, low_pass = self._points, self.powers.problem.low_pass
        if points.size <= FEWEST:
            return None
        if low_pass is None and not self.powers.started:
            return self._behind(None, points)
        problem = _problem(self._curve, points, self._terms)
        for early in candidates(problem.only(problem.m <= EARLY * problem.m[0]))[:1]:
            bent = self._behind(early, points)
            if bent is not None and bent.described and bent.start <= START_MISFIT:
                return bent
        if low_pass is not None:
            points = points[self._curve.tau[points] >= 0.999 * self.powers.problem.tau[0]]
        return self._behind(low_pass, points)

    def _behind(self, low_pass: LowPass | None, points: npt.NDArray[np.intp]) -> Range | None:
        def prepared(time: float | None) -> Problem:
            terms = self._terms if time is None else self._terms + 'G'
            problem = _problem(self._curve, points, terms, time)
            return problem if low_pass is None else problem.behind(low_pass)

        if _hopeless(prepared(None)):
            return None
        problem = likeliest(prepared, self._curve.tau[points])
        return Range(problem, fit_subsets(problem))


def _hopeless(problem: Problem) -> bool:
    """Return whether not even processes of every correlation time describe a curve."""
    columns = np.vstack([problem.basis, processes(problem.tau)])
    return glance(problem, problem.record * problem.share / problem.tau, columns).hopeless


def _points(curve: DeviationCurve) -> npt.NDArray[np.intp]:
    """Return the points that carry information: above zero and above rounding."""
    finite = np.where(np.isfinite(curve.deviation), curve.deviation, 0.0)
    highest = finite.max(initial=0.0)
    return np.flatnonzero((finite > 0.0) & (finite >= ROUNDING * highest))


def _problem(
    curve: DeviationCurve,
    points: npt.NDArray[np.intp],
    terms: str,
    correlation_time: float | None = None,
) -> Problem:
    m, usable = curve.m[points], None
    if curve.kind != 'oadev' or curve.samples < curve.span:
        whole = overlapped_degrees(curve.alpha[points], m, curve.period, curve.samples)
        # what gaps or another estimator cost or gain
        usable = np.clip(curve.edf[points] / whole, 0.02, 2.0)
    return prepare(
        m,
        curve.deviation[points],
        curve.period,
        # a hole tells nothing, however long it is
        curve.samples,
        terms,
        usable=usable,
        correlation_time=correlation_time,
    )


def _check(curve: DeviationCurve, confidence: float, terms: str) -> None:
    if curve.kind not in KINDS:
        raise DataError(
            f'coefficients need an Allan variance ({", ".join(KINDS)}), not {curve.kind}'
        )
    unknown = [t for t in terms if t not in TERMS + 'G']
    if unknown or not terms.strip('G') or len(set(terms)) < len(terms):
        raise DataError(
            f'terms must be different letters of {TERMS}, and G besides, got {terms!r}'
        )
    check_confidence(confidence)


def _nothing(curve: DeviationCurve, confidence: float, points: int) -> NoiseModel:
    """Return the model of a curve that supports no fit."""
    if len(curve) and not np.any(curve.deviation > 0.0):
        reason = 'the signal never changes: stuck, or below its own resolution'
    else:
        reason = f'{points} averaging times; a fit needs {FEWEST}: record longer'
    q, n, b, k, r = (
        Estimate.not_observable(
            coefficient_unit(curve.unit, t), reason, confidence=confidence, method=METHOD
        )
        for t in TERMS
    )
    return NoiseModel(curve.unit, q, n, b, k, r, method=METHOD, flags=(reason,))


def noise_density(model: NoiseModel | Estimate, sided: Literal['one', 'two'] = 'one') -> Estimate:
    """
    Return the noise density of white noise from its coefficient N.

    White noise of the two-sided density N² has the Allan variance N²/τ (IEEE Std 952-1997
    annex C: σ²(τ) = 4 ∫₀^∞ N² sin⁴(πfτ)/(πfτ)² df, and ∫₀^∞ sin⁴x/x² dx = π/4).  The same
    power spread over positive frequencies only has twice the density, 2 N²: so the one-sided
    noise density of a datasheet is √2 N, and a sample taken at rate f_s without a filter has
    the standard deviation √2 N √(f_s/2) = N √f_s.

    Parameters
    ----------
    model : NoiseModel or Estimate
        A model, or its N.
    sided : {'one', 'two'}
        'one' as in datasheets and spectra of real signals, 'two' as in Kalibr and N itself.

    Raises
    ------
    DataError
        If `sided` is something else.

    Examples
    --------
    >>> n = Estimate(1.0, 0.9, 1.1, 'm/s²/√Hz')
    >>> round(noise_density(n).value, 4), noise_density(n, 'two').value
    (1.4142, 1.0)
    """
    if sided not in ('one', 'two'):
        raise DataError(f"sided must be 'one' or 'two', got {sided!r}")
    n = model.N if isinstance(model, NoiseModel) else model
    return n.scaled(math.sqrt(2.0) if sided == 'one' else 1.0, n.unit)
