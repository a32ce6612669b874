# SPDX-License-Identifier: Apache-2.0
"""
Noise coefficients from the spectrum: a second opinion on those from the Allan variance.

The two look at the same data in different ways: a vibration is a line in the spectrum and a bump
in the Allan variance, a filter bends one end of each, a step moves both.  Where the sum of noise
terms is the truth they agree.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.curve import Floats
from imu_bench.metrology.estimate import check_confidence, CONFIDENCE, Estimate
from imu_bench.metrology.fitting.noise_model import (
    coefficient_unit,
    density_basis,
    gauss_markov_density,
    NoiseModel,
    TERM_NAMES,
    TERMS,
)
from imu_bench.metrology.fitting.scoring import granted, minus_two_log_likelihood, scored, subsets
from imu_bench.metrology.fitting.uncertainty import Response, third_cumulant_in, variance_in
from imu_bench.metrology.stretches import longest
import numpy as np
import numpy.typing as npt
import scipy

METHOD = 'Whittle likelihood of the periodogram'

SPECTRAL_TERMS = 'QNBK'
"""The terms with a density; a ramp has none."""

SIGNIFICANCE = 1e-3
"""Largest probability that a term which is reported is a chance of the other noise."""

FEWEST = 64
"""Samples in one piece that a spectrum needs."""

BINS_PER_E = 8
"""Bins per factor e of frequency: finer than any feature of the noise terms."""

NARROWEST = 3
"""Ordinates per bin at least: neighbours are correlated and must not count as independent."""

FIRST = 2
"""First frequency used, in 1/T: the Hann taper spreads the removed mean over 0 and 1."""

HANN_SPREAD = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)
"""
Ordinates of a Hann-tapered periodogram per independent one.  The taper mixes three neighbours
with −1/4, 1/2 and −1/4, so ordinates one and two apart correlate by 2/3 and 1/6.
"""

FALSE_ALARM = 0.01 / 6
"""Largest probability of a contradiction on one axis: 1 % in a recording of six."""

LINE = 20.0
"""Ordinates above this many medians of their bin are lines, not noise: chance 2^-20 each."""


@dataclass(frozen=True, eq=False)
class Binned:
    """A log-binned periodogram: one-sided density, model densities (p, k), degrees of freedom."""

    density: Floats
    basis: Floats
    degrees: Floats


def fit(
    data: npt.ArrayLike,
    rate_hz: float,
    *,
    unit: str = '1',
    confidence: float = CONFIDENCE,
    terms: str = SPECTRAL_TERMS,
    valid: npt.ArrayLike | None = None,
    shortest_tau: float = 0.0,
    correlation_time: float | None = None,
) -> NoiseModel:
    """
    Return Q, N, B and K by maximum Whittle likelihood.

    All terms asked for are fitted together, none is chosen: intervals are those of a model that
    holds them all, and a term that may be a chance of the others is not observable.

    Parameters
    ----------
    data : array_like, shape (n,)
        Rate samples.
    rate_hz : float
        Sample rate in Hz.
    unit : str
        Unit of the samples.
    confidence : float
        Level of the intervals.
    terms : str
        Terms to fit, letters of 'QNBK'.
    valid : array_like of bool, shape (n,), optional
        False where a sample is missing; the longest piece without gaps is used.
    shortest_tau : float
        Frequencies above 1/(2 shortest_tau) are left out, to look at what an Allan variance
        from this averaging time in s on looks at (`NoiseModel.tau_flat`).
    correlation_time : float, optional
        Fit one Gauss-Markov process of this T_c in s besides, so that a bias with a memory is
        not taken for one of the terms.

    Notes
    -----
    P. Whittle, Arkiv för Matematik 2 (1953) 423: ordinates of the periodogram are independent
    and S(f) χ²_2/2.  Here tapered (Hann), averaged in logarithmic bins, lines left out.
    """
    x = _longest_piece(np.asarray(data, np.float64), valid)
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise DataError(f'the sample rate must be positive, got {rate_hz} Hz')
    check_confidence(confidence)
    if not terms or len(set(terms)) < len(terms) or set(terms) - set(SPECTRAL_TERMS):
        raise DataError(f'terms must be different letters of {SPECTRAL_TERMS}, got {terms!r}')
    if correlation_time is not None and not correlation_time > 0.0:
        raise DataError(f'correlation time must be positive, got {correlation_time} s')
    scale = float(np.std(x)) if x.size else 0.0
    if x.size < FEWEST or scale == 0.0:
        reason = (
            f'{x.size} samples in one piece; a spectrum needs {FEWEST}'
            if x.size < FEWEST
            else 'the signal never changes: stuck, or below its own resolution'
        )
        return _model(unit, {}, {}, confidence, reason)
    highest = 0.5 * rate_hz if shortest_tau <= 0.0 else min(0.5 / shortest_tau, 0.5 * rate_hz)
    binned = _binned(x / scale, rate_hz, highest, terms, correlation_time)
    squares = _likeliest(binned)
    found, fitted = {}, {}
    # a process, the last row of the basis, is there for the sake of the terms
    for at, term in enumerate(terms):
        own_unit = coefficient_unit(unit, term)
        found[term] = estimate(binned, squares, at, term, confidence).scaled(scale, own_unit)
        if squares[at] > 0.0:
            fitted[term] = scale * math.sqrt(squares[at])
    return _model(unit, found, fitted, confidence, 'not asked for, or without a spectrum (R)')


def disagreements(
    first: NoiseModel, second: NoiseModel, *, false_alarm: float = FALSE_ALARM, terms: str = TERMS
) -> tuple[str, ...]:
    """
    Return one sentence for each coefficient on which two models contradict each other.

    Parameters
    ----------
    false_alarm : float
        Largest probability of any sentence where both describe the noise; shared by all
        coefficients that can be compared.
    terms : str
        Coefficients that are compared.

    Notes
    -----
    Two values contradict each other when the logarithm of their ratio is beyond its own
    uncertainty: half intervals add as squares, as those of independent estimates do.  One of the
    two may rest on a small part of the data (the longest piece without gaps), so that intervals
    which just do not overlap are nothing rare.  A value and an upper bound contradict each other
    when the value is above the bound, both at that level.
    """
    compared = [
        (t, a, b)
        for t in terms
        for a, b in [(first.coefficients[t], second.coefficients[t])]
        if _comparable(a, b)
    ]
    found = []
    for term, a, b in compared:
        if _contradict(a, b, false_alarm / len(compared)):
            found.append(
                f'{term} from the {first.method} is {_said(a)}, from the {second.method} '
                f'{_said(b)} {a.unit}: the data hold more than this noise (vibration, steps, '
                'temperature), look at the spectrum'
            )
    return tuple(found)


def _comparable(a: Estimate, b: Estimate) -> bool:
    bounded = None not in (a.low, a.high, b.low, b.high)
    return bounded and not (a.value is None and b.value is None)


def _contradict(a: Estimate, b: Estimate, false_alarm: float) -> bool:
    """Return whether two estimates differ by more than chance gives with this probability."""
    small, large = sorted((a, b), key=lambda e: e.value or 0.0)
    reach = -float(scipy.special.ndtri(0.5 * false_alarm))
    if not large.value or not large.low or not small.high:
        return False
    down = math.log(large.value / large.low) / _deviations(large)
    if not small.value:
        # the square of a bound grows as its deviation
        bound = small.high * math.sqrt(max(reach / _deviations(small), 1.0))
        return math.log(large.value / bound) > reach * down
    up = math.log(small.high / small.value) / _deviations(small)
    return math.log(large.value / small.value) > reach * math.hypot(up, down)


def _deviations(estimate: Estimate) -> float:
    """Return half the width of an interval in standard deviations."""
    return -float(scipy.special.ndtri(0.5 * (1.0 - estimate.confidence)))


def _said(estimate: Estimate) -> str:
    if estimate.value is None:
        return f'below {estimate.high:.3g}'
    return f'{estimate.low:.3g} to {estimate.high:.3g}'


def _longest_piece(x: Floats, valid: npt.ArrayLike | None) -> Floats:
    if x.ndim != 1:
        raise DataError(f'one axis at a time: data have {x.ndim} dimensions instead of 1')
    good = np.ones(x.size, np.bool_) if valid is None else np.asarray(valid, np.bool_)
    if good.shape != x.shape:
        raise DataError(f'valid has shape {good.shape}, data {x.shape}')
    piece = x[longest(good)]
    if not np.all(np.isfinite(piece)):
        raise DataError('data hold NaN or infinite samples; mark them in valid')
    return piece


def _basis(
    frequency: Floats, rate_hz: float, terms: str, correlation_time: float | None
) -> Floats:
    powers = density_basis(frequency, 1.0 / rate_hz, terms)
    if correlation_time is None:
        return powers
    return np.vstack([powers, gauss_markov_density(frequency, correlation_time)])


def _binned(
    x: Floats, rate_hz: float, highest: float, terms: str, correlation_time: float | None
) -> Binned:
    n = x.size
    # periodic Hann: its transform is exactly three lines
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi / n * np.arange(n))
    transform = scipy.fft.rfft((x - x.mean()) * taper)
    power = np.abs(transform) ** 2 * (2.0 / (rate_hz * float(taper @ taper)))
    frequency = np.arange(power.size) * (rate_hz / n)
    # Nyquist has one degree of freedom instead of two
    last = min(int(highest * n / rate_hz), (n - 1) // 2)
    used = slice(FIRST, max(last + 1, FIRST + 1))
    power, frequency = power[used], frequency[used]
    count = max(int(BINS_PER_E * math.log(frequency[-1] / frequency[0])), 1)
    grid = np.geomspace(frequency[0], frequency[-1], count + 1)[1:-1]
    starts = [0]
    for start in np.searchsorted(frequency, grid):
        if start - starts[-1] >= NARROWEST:
            starts.append(int(start))
    parts = zip(starts, [*starts[1:], frequency.size], strict=True)
    rows = [
        _bin(power[a:b], _basis(frequency[a:b], rate_hz, terms, correlation_time))
        for a, b in parts
    ]
    density, basis, degrees = zip(*rows, strict=True)
    return Binned(np.array(density), np.array(basis).T, np.array(degrees))


def _bin(power: Floats, densities: Floats) -> tuple[float, Floats, float]:
    """Return the mean of the ordinates that are noise, that of the models, and the freedom."""
    noise = power <= LINE * np.median(power) if power.size >= 8 else np.ones(power.size, bool)
    count = np.count_nonzero(noise)
    return (
        float(power[noise].mean()),
        densities[:, noise].mean(axis=1),
        max(2.0 * count / HANN_SPREAD, 1.0),
    )


def _likeliest(binned: Binned) -> Floats:
    """Return the non-negative squares of largest likelihood."""
    masks = subsets(len(binned.basis), len(binned.basis))
    degrees = granted(binned.degrees)
    raw = scored(
        binned.density,
        binned.basis,
        masks,
        lambda squares: np.broadcast_to(degrees, (len(squares), degrees.size)),
        degrees,
    )
    squares = np.maximum(raw, 0.0)
    misfit = minus_two_log_likelihood(binned.density, squares @ binned.basis, degrees)
    # the optimum under the bounds is that of the subset that it leaves positive
    positive = np.all((raw > 0.0) | ~masks, axis=1)
    return np.asarray(squares[int(np.argmin(np.where(positive, misfit, np.inf)))], np.float64)


def estimate(binned: Binned, squares: Floats, at: int, term: str, confidence: float) -> Estimate:
    """Return one coefficient, or its bound if it may be a chance of the other noise."""
    answer = response(binned, squares, at)
    value = float(squares[at])
    if value <= 0.0 or answer.significance() > SIGNIFICANCE:
        # weighted for as much of the term as could hide, see fit_report
        designed = squares.copy()
        designed[at] = max(answer.value, 0.0) + 2.0 * answer.spread(value)
        answer = response(binned, designed, at)
        return Estimate.not_observable(
            '1',
            f'{TERM_NAMES[term]} does not rise above the scatter of the spectrum',
            high=math.sqrt(answer.upper_bound(confidence)),
            confidence=confidence,
            method=METHOD,
        )
    low, high = answer.interval(confidence)
    return Estimate(
        math.sqrt(value),
        math.sqrt(min(low, value)),
        math.sqrt(max(high, value)),
        '1',
        confidence,
        method=METHOD,
    )


def response(binned: Binned, squares: Floats, at: int) -> Response:
    """Return how the estimate of one square answers to noise."""
    model = squares @ binned.basis
    weights = granted(binned.degrees) / model**2
    scale = 1.0 / np.sqrt(binned.basis**2 @ weights)
    columns = binned.basis * scale[:, None]
    normal = (columns * weights) @ columns.T + 1e-12 * np.eye(len(columns))
    row = (np.linalg.solve(normal, columns * weights) * scale[:, None])[[at]]
    own = binned.basis[[at]]
    others, own = (model - squares[at] * own) * row, own * row
    return Response(
        float((row @ binned.density)[0]),
        variance_in(others, own, 2.0 / binned.degrees)[0],
        third_cumulant_in(others, own, 8.0 / binned.degrees**2)[0],
    )


def _model(
    unit: str,
    found: dict[str, Estimate],
    fitted: dict[str, float],
    confidence: float,
    reason: str,
) -> NoiseModel:
    estimates = {
        t: found.get(t)
        or Estimate.not_observable(
            coefficient_unit(unit, t), reason, confidence=confidence, method=METHOD
        )
        for t in TERMS
    }
    return NoiseModel(
        unit=unit,
        Q=estimates['Q'],
        N=estimates['N'],
        B=estimates['B'],
        K=estimates['K'],
        R=estimates['R'],
        fitted=fitted,
        method=METHOD,
        flags=() if found else (reason,),
    )
