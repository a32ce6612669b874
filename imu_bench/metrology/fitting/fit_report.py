# SPDX-License-Identifier: Apache-2.0
"""From a choice of noise terms to estimates with intervals, bounds, and how long to record."""

from __future__ import annotations

from dataclasses import replace
import math

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.correlation_time import slope
from imu_bench.metrology.fitting.fit_range import Range
from imu_bench.metrology.fitting.low_pass import WEAKEST
from imu_bench.metrology.fitting.model_choice import choose
from imu_bench.metrology.fitting.model_fit import degrees_of_freedom, Fitted
from imu_bench.metrology.fitting.noise_model import (
    coefficient_unit,
    density_basis,
    GaussMarkov,
    NoiseModel,
    TERM_NAMES,
    TERMS,
)
from imu_bench.metrology.fitting.uncertainty import respond, Response
import numpy as np
import scipy

_WIDEST = 20.0
"""Logarithm of cutoff over sample rate beyond which nobody reads an end of an interval."""

METHOD = 'weighted fit of the Allan variance'


class Report:
    """Turns a choice of noise terms into a noise model."""

    def __init__(self, chosen: Range, unit: str, confidence: float) -> None:
        self.chosen, self.unit, self.confidence = chosen, unit, confidence
        self.problem = chosen.problem
        self.choice = choose(chosen.problem, chosen.solutions)
        self._answers: dict[bytes, dict[str, Response]] = {}

    def model(self, reported: str = TERMS) -> NoiseModel:
        """Return the noise model; the terms that are not to be reported without estimates."""
        problem, best = self.problem, self.choice.best
        found = {term: self._estimate(term, reported) for term in TERMS}
        fitted = {
            t: problem.scale * math.sqrt(square)
            for t, square, on in zip(problem.terms, best.squares, best.mask, strict=True)
            if on and t != 'G'
        }
        return NoiseModel(
            unit=self.unit,
            Q=found['Q'],
            N=found['N'],
            B=found['B'],
            K=found['K'],
            R=found['R'],
            gauss_markov=self._gauss_markov(),
            low_pass=problem.low_pass,
            bandwidth=self._bandwidth(),
            fitted=fitted,
            method=METHOD,
            tau_low=float(problem.tau[0]),
            tau_high=float(problem.tau[-1]),
            chi2=self.chosen.chi2,
            flags=self._flags(),
        )

    def _estimate(self, term: str, reported: str) -> Estimate:
        at = self.problem.terms.find(term) if term in reported else -1
        unit = coefficient_unit(self.unit, term)
        if at < 0 and term in reported and term == 'Q' and self.problem.low_pass is not None:
            return self._hidden(unit)
        if at < 0:
            return Estimate.not_observable(unit, 'not asked for', confidence=self.confidence)
        estimate = self._observed(at) if self.choice.certain(at) else self._bound(at)
        return estimate.scaled(self.problem.scale, unit)

    def _hidden(self, unit: str) -> Estimate:
        """Return quantisation noise behind a filter: no more than all of the first variance."""
        problem = self.problem
        return Estimate.not_observable(
            unit,
            'the low-pass filter of the sensor bends the start of the curve, where it would show',
            high=problem.scale * float(problem.tau[0] * np.sqrt(problem.variance[0] / 3.0)),
            confidence=self.confidence,
            method=METHOD,
        )

    def _gauss_markov(self) -> GaussMarkov | None:
        """Return the Gauss-Markov process, if it was a candidate and no rival does without."""
        problem, time = self.problem, self.problem.correlation_time
        at = problem.terms.find('G')
        if time is None or at < 0 or not self.choice.certain(at):
            return None
        best = self.choice.best
        extra = slope(problem, time, float(best.squares[at]))
        answers = respond(problem, best, extra=extra, widening=self.chosen.widening)
        unit = coefficient_unit(self.unit, 'G')
        value = float(best.squares[at])
        low, high = answers['G'].interval(self.confidence)
        q_c = self._root(value, [low], [high]).scaled(problem.scale, unit)
        # the further column is linear in ln T_c
        reach = float(scipy.special.ndtri(0.5 + 0.5 * self.confidence)) * answers['T'].spread(0.0)
        ratio = math.exp(min(reach, 20.0))
        return GaussMarkov(
            q_c, Estimate(time, time / ratio, time * ratio, 's', self.confidence, method=METHOD)
        )

    def _bandwidth(self) -> Estimate | None:
        """Return the cutoff of the filter; its interval covers what each likely kind says."""
        low_pass = self.problem.low_pass
        if low_pass is None or self.chosen.started:
            return None
        models = [(self.problem, self.choice.best)]
        models += [(r.problem, r.solutions[r.solutions.likeliest]) for r in self.chosen.alike]
        reach = float(scipy.special.ndtri(0.5 + 0.5 * self.confidence))
        cutoffs = []
        for problem, fitted in models:
            answer = respond(problem, fitted, widening=self.chosen.widening).get('F')
            if problem.low_pass is None or answer is None:
                return None
            # the further column is linear in `LowPass.warped`
            far = reach * answer.spread(0.0)
            warped = problem.low_pass.warped
            ends = (max(warped - far, -_WIDEST), min(warped + far, max(warped, WEAKEST)))
            cutoffs += [replace(problem.low_pass, warped=end).cutoff for end in ends]
        return Estimate(
            low_pass.cutoff, min(cutoffs), max(cutoffs), 'Hz', self.confidence, method=METHOD
        )

    def _observed(self, at: int) -> Estimate:
        """Return a term that every rival contains; the interval covers what each of them says."""
        choice = self.choice
        intervals = [
            self._response(fitted, at).interval(self.confidence)
            for fitted in (choice.best, *choice.rivals, *choice.supersets)
        ]
        chosen, term = self.chosen, self.problem.terms[at]
        answers = [
            respond(r.problem, r.solutions[r.solutions.likeliest], widening=chosen.widening)
            for r in chosen.alike
        ]
        if chosen.further is not None:
            extra, widening = chosen.further, chosen.widening
            answers.append(respond(self.problem, choice.best, extra=extra, widening=widening))
        intervals += [a[term].interval(self.confidence) for a in answers if term in a]
        lows, highs = zip(*intervals, strict=True)
        return self._root(float(choice.best.squares[at]), list(lows), list(highs))

    def _root(self, square: float, lows: list[float], highs: list[float]) -> Estimate:
        """Return the estimate of a coefficient from its square and bounds of it."""
        low, high = min([square, *lows]), max([square, *highs])
        return Estimate(
            math.sqrt(square),
            math.sqrt(low),
            math.sqrt(high),
            '1',
            self.confidence,
            method=METHOD,
        )

    def _bound(self, at: int) -> Estimate:
        """Return a term that the data do not support: its bound, and what would show it."""
        choice = self.choice
        designed = self._designed(at)
        answer = self._response(designed, at)
        bound = answer.upper_bound(self.confidence)
        largest = choice.largest[at]
        if largest is not None:
            bound = max(bound, self._response(largest, at).upper_bound(self.confidence))
        time = duration(self._seconds(designed, at, bound, answer.spread(bound)))
        reason = (
            f'{self._why(at)}; if it is as large as the bound, record about {time} for '
            f'{100 * TARGET:.0f} %'
        )
        return Estimate.not_observable(
            '1', reason, high=math.sqrt(bound), confidence=self.confidence, method=METHOD
        )

    def _designed(self, at: int) -> Fitted:
        """Return the best subset joined by a term, weighted for as much of it as could hide."""
        # Weights for noise without the term would look for it in the wrong place: a random walk
        # shows in the longest averaging times, which white noise alone makes worthless.
        best = self.choice.best
        mask = best.mask.copy()
        mask[at] = True
        plain = self._response(Fitted(mask, best.squares, best.degrees), at)
        value = max(plain.value, 0.0)
        squares = best.squares.copy()
        squares[at] = value + 2.0 * plain.spread(value)
        return Fitted(mask, squares, degrees_of_freedom(self.problem, squares[None])[0])

    def _response(self, fitted: Fitted, at: int) -> Response:
        key = fitted.mask.tobytes() + fitted.squares.tobytes()
        if key not in self._answers:
            self._answers[key] = respond(self.problem, fitted, widening=self.chosen.widening)
        return self._answers[key][self.problem.terms[at]]

    def _why(self, at: int) -> str:
        """Return why a term is not observable."""
        problem, choice = self.problem, self.choice
        record, name = duration(problem.record), TERM_NAMES[problem.terms[at]]
        models = (choice.best, *choice.rivals)
        if not any(fitted.mask[at] for fitted in models):
            return f'{name} does not rise above the scatter of the other noise in {record}'
        others = [
            TERM_NAMES[t]
            for fitted in models if not fitted.mask[at]
            for i, t in enumerate(problem.terms) if fitted.mask[i] and not choice.certain(i)
        ]  # fmt: skip
        rivals = ' or '.join(dict.fromkeys(others)) or 'the scatter of the other noise'
        return f'{record} do not tell {name} from {rivals}'

    def _seconds(self, fitted: Fitted, at: int, square: float, spread: float) -> float:
        """Return the length of a record that shows a term of this square to 10 %."""
        problem = self.problem
        squares = fitted.squares.copy()
        squares[at] = square
        keep = fitted.mask & np.array([t != 'G' for t in problem.terms])
        letters = ''.join(t for t, on in zip(problem.terms, keep, strict=True) if on)
        period = float(problem.tau[0] / problem.m[0])
        return seconds_needed(
            letters, squares[keep], problem.terms[at], period, problem.record, spread
        )

    def _flags(self) -> tuple[str, ...]:
        """Return what a reader of the model should know."""
        flags = []
        low_pass = self.problem.low_pass
        if low_pass is not None:
            flags.append(
                f'white noise through a low-pass filter of about {low_pass.cutoff:.2g} Hz: it '
                'bends the start of the curve, not N'
            )
        if low_pass is not None and low_pass.floor:
            flags.append(
                f'{100.0 * low_pass.floor:.2g} % of the white noise joins behind the filter, as '
                'that of rounding does'
            )
        if self.chosen.started and low_pass is not None:
            flags.append(
                f'averaging times below {self.chosen.started:.3g} s are left out: there the '
                'curve depends on the kind of filter'
            )
        elif self.chosen.started:
            flags.append(
                f'averaging times below {self.chosen.started:.3g} s are left out: there the '
                'curve follows no sum of noise terms (low-pass filter or vibration)'
            )
        if self.chosen.bump:
            first, last = self.chosen.bump
            flags.append(
                f'a bump between averaging times of {first:.3g} and {last:.3g} s is left out: '
                'something periodic (vibration, or a temperature that cycles)'
            )
        if self.chosen.widening > 1.0:
            flags.append(
                'the noise terms do not describe this curve (mean squared residual '
                f'{self.chosen.chi2:.1f}): vibration, temperature or movement; intervals are '
                'widened'
            )
        best = self.choice.best
        for at in np.flatnonzero(best.mask):
            term, square = self.problem.terms[at], float(best.squares[at])
            if term == 'G' or not self.choice.certain(int(at)):
                continue
            spread = self._response(best, int(at)).spread(square)
            known = 0.5 * spread / square
            if known > TARGET:
                time = duration(self._seconds(best, int(at), square, spread))
                flags.append(
                    f'{term} is known to {100 * known:.0f} %: record about {time} for '
                    f'{100 * TARGET:.0f} %'
                )
        return tuple(flags)


def duration(seconds: float) -> str:
    """Return a duration in words."""
    return 'more than 2800 h' if math.isinf(seconds) else f'{seconds / 3600.0:.2g} h'


TARGET = 0.1
"""Relative standard deviation of a coefficient that counts as known."""

LONGEST = 1e7
"""Records beyond this many seconds (116 days) are not worth a number."""

_POINTS = 240


def seconds_needed(
    terms: str, squares: Floats, term: str, period: float, record: float, deviation: float
) -> float:
    """
    Return the length of a record in s that gives a coefficient to `TARGET`; inf beyond `LONGEST`.

    The best possible error of a record of length T follows from the Fisher information of its
    spectrum between 1/T and half the sample rate (P. Whittle 1953): every resolved frequency
    tells each share of the density with the scatter of an exponential variable.  The error
    reached in the present record over its best possible one is taken to stay as it is.

    Parameters
    ----------
    terms : str
        Terms of the model, of 'QNBKR', with `term` among them.
    squares : ndarray, shape (len(terms),)
        Squared coefficients.
    term : str
        The coefficient in question.
    period, record : float
        Sample period and length of the present record in s.
    deviation : float
        Standard deviation of the square of `term` in the present record.
    """
    square = float(squares[terms.index(term)])
    relative = deviation / (2.0 * square)
    if relative <= TARGET:
        return record
    if term == 'R':
        return _for_ramp(terms, squares, relative, record)
    random = [i for i, t in enumerate(terms) if t != 'R']
    letters = ''.join(terms[i] for i in random)
    shares = _shares(letters, squares[random], period, max(LONGEST, 10.0 * record))
    lengths, best = _best_errors(*shares, letters.index(term), record)
    reached = np.interp(math.log(record), np.log(lengths), np.log(best))
    wanted = math.log(TARGET / relative) + reached
    falling = np.minimum.accumulate(np.log(best))
    if falling[-1] > wanted:
        return math.inf
    return float(math.exp(np.interp(-wanted, -falling, np.log(lengths))))


def _for_ramp(terms: str, squares: Floats, relative: float, record: float) -> float:
    """Return the length for a ramp: its error falls as T^-1/2, T^-1, T^-3/2 by the noise."""
    present = {t for t, s in zip(terms, squares, strict=True) if s > 0.0}
    power = 0.5 if 'K' in present else 1.0 if 'B' in present else 1.5
    seconds = record * (relative / TARGET) ** (1.0 / power)
    return seconds if seconds <= LONGEST else math.inf


def _shares(
    terms: str, squares: Floats, period: float, longest: float
) -> tuple[Floats, Floats, Floats]:
    """Return frequencies, descending, their widths, and each term's share of the density."""
    log_f = np.linspace(math.log(0.5 / period), -math.log(longest), _POINTS)
    frequency = np.exp(log_f)
    parts = squares[:, None] * density_basis(frequency, period, terms)
    return frequency, frequency * (log_f[0] - log_f[1]), parts / parts.sum(axis=0)


def _best_errors(
    frequency: Floats, width: Floats, shares: Floats, index: int, record: float
) -> tuple[Floats, Floats]:
    """Return record lengths, ascending, and the best relative error of one square in each."""
    products = shares[:, None, :] * shares[None, :, :] * width
    information = np.moveaxis(np.cumsum(products, axis=-1), -1, 0)
    lengths = 1.0 / frequency
    long = lengths >= 0.5 * record
    matrices = information[long] * lengths[long, None, None]
    matrices = matrices + 1e-12 * np.eye(len(shares))
    variance = np.linalg.inv(matrices)[:, index, index]
    return lengths[long], np.sqrt(np.maximum(variance, 1e-300))
