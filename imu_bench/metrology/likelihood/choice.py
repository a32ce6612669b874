# SPDX-License-Identifier: Apache-2.0
"""The model of the noise that a record supports best, and what in it is no noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.fitting.model_choice import EQUIVALENT, WIDER
from imu_bench.metrology.fitting.noise_model import (
    coefficient_unit,
    GaussMarkov,
    NoiseModel,
    TERM_NAMES,
    TERMS,
)
from imu_bench.metrology.likelihood import events
from imu_bench.metrology.likelihood.candidates import Candidate, likelihoods
from imu_bench.metrology.likelihood.cosines import Bins, Cosines
from imu_bench.metrology.likelihood.events import Event
from imu_bench.metrology.whittle import Binned, estimate, response
import numpy as np
import scipy

METHOD = 'likelihood of the cosine transform'

SPECTRAL = 'NBK'
"""The coefficients that the slow part of a spectrum shows."""

SPEAKS = 0.5
"""Part of the values that a piece without gaps has to hold to speak for all of them."""

FEWEST = 64
"""Values that a choice needs."""

LEAST_BAND = 128
"""Terms that are left below the highest frequency, at least."""

NARROWER = 4.0
"""Factor by which the highest frequency comes down until a model describes the rest."""

AS_WELL = 1.0
"""What a model that fits as well may lack in −2 ln L: one parameter gains as much by chance."""

_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Choice:
    """What the likelihood says of a record."""

    candidates: tuple[Candidate, ...]  # every model that was tried, the likeliest first
    events: tuple[Event, ...]  # steps and cycles, which were taken off before
    highest: float  # frequency in Hz up to which the models were compared
    described: bool  # whether the likeliest one describes the spectrum up to there
    # whether that frequency had to come down, since nothing described what is above
    lowered: bool = False
    # whether the spectrum does without the filter of the fitted curve
    refutes_filter: bool = False
    # part of the recorded values that were looked at: those of one piece without gaps
    share: float = 1.0
    # exponent of the noise beside white noise, where one can be fitted
    exponent: Estimate | None = None
    # strength of that noise read as flicker noise, from one end to the other of where it is above
    # white noise: the same number at both if the exponent is 1
    levels: tuple[float, float] | None = None

    @property
    def speaks(self) -> bool:
        """Whether the piece that was looked at can speak for the whole record."""
        return self.share >= SPEAKS

    @property
    def best(self) -> Candidate:
        """The likeliest model."""
        return self.candidates[0]

    def without(self, letters: str) -> float:
        """Return how much worse the best model without any of these terms scores."""
        scores = [c.score for c in self.candidates if not set(letters) & set(c.terms)]
        return min(scores, default=math.inf) - self.best.score

    @property
    def words(self) -> tuple[str, str]:
        """Which models were tried, and why one was taken, in two lines."""
        tried = ', '.join(
            f'{named(c)} {c.score - self.best.score:+.1f}'
            for c in self.candidates[:_TOLD]
            if math.isfinite(c.score)
        )
        first = (
            f'models tried up to {self.highest:.3g} Hz, −2 ln L with its penalties over the best: '
            f'{tried}'
        )
        if len(self.candidates) < 2 or not math.isfinite(self.candidates[1].score):
            return first, f'taken: {named(self.best)}, no other describes the spectrum at all'
        gap = self.candidates[1].score - self.best.score
        odds = (
            'as good as equal to'
            if gap < EQUIVALENT
            else f'{math.exp(min(0.5 * gap, 50)):.2g} times as likely as'
        )
        return first, f'taken: {named(self.best)}, {odds} {named(self.candidates[1])}'


_TOLD = 5


def not_told(choice: Choice) -> list[Candidate]:
    """
    Return the models without a random walk that fit as well as the best one, the likeliest first.

    A parameter more is not held against them: this is about what is not there, not about what is.
    """
    most = choice.best.misfit + AS_WELL
    return [
        c
        for c in choice.candidates
        if set(c.terms) & set('GF') and 'K' not in c.terms and _holds(c) and c.misfit <= most
    ]


def walks(choices: Sequence[Choice]) -> bool:
    """
    Return whether records of one noise together tell a random walk from all that is none.

    Records are independent, so that their −2 ln L add up.  Each may have a correlation time or an
    exponent of its own, so that a process is found rather too often than too seldom.
    """

    def misfit(choice: Choice, walk: bool) -> float:
        return min(
            (
                c.misfit
                for c in choice.candidates
                if ('K' in c.terms) == walk and bool(set(c.terms) & set('GF')) != walk
            ),
            default=math.inf,
        )

    return sum(misfit(c, False) for c in choices) > sum(misfit(c, True) for c in choices) + AS_WELL


def _holds(one: Candidate) -> bool:
    return math.isfinite(one.score)


def like_free(models: Sequence[Candidate]) -> list[Candidate]:
    """Return the models with a free exponent that fit a little better than chance would."""
    best = models[0]
    return [c for c in models[1:] if 'F' in c.terms and c.score - best.score <= WIDER]


def named(one: Candidate) -> str:
    """Return a model in letters, with its correlation time or exponent."""
    shape = {'G': f'({one.shape:.3g} s)', 'F': f'(1/f^{one.shape:.2f})'}
    return ' + '.join(t + shape.get(t, '') for t in one.terms)


def choose(
    values: Floats,
    rate_hz: float,
    *,
    unit: str = '1',
    confidence: float = CONFIDENCE,
    highest: float = math.inf,
    size: int = 1,
) -> tuple[Choice, NoiseModel] | None:
    """
    Return what the likelihood says, and the coefficients of the model that it prefers.

    None of too few values, or of a constant.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Without gaps.
    highest : float
        Frequency in Hz above which nothing is looked at.
    size : int
        Samples of which each value is the average.

    Notes
    -----
    Where no model describes the spectrum up to there (resonance, vibration), the frequencies come
    down until one does, so that what happens above does not bend N, B or K.

    Examples
    --------
    >>> found, model = choose(np.random.default_rng(1).standard_normal(20_000), 100.0)
    >>> found.best.terms, round(model.N.value, 2), found.events
    ('N', 0.1, ())
    """
    scale = float(np.std(values)) if values.size else 0.0
    if values.size < FEWEST or not scale > 1e-12 * float(np.max(np.abs(values))):
        return None
    cosines = Cosines.of(values / scale, rate_hz, size)
    whole = min(highest, 0.5 * rate_hz)
    top, lowered = whole, False
    while True:
        bins = cosines.binned(top)
        found, rest, models = events.find(cosines, likelihoods(bins), top)
        bins = rest.binned(top)
        described = models[0].describes(bins)
        enough = 2.0 * cosines.span * top / NARROWER >= LEAST_BAND
        if (described and not lowered) or not enough:
            break
        top /= NARROWER
        # what bent the part that is left out fades slowly: once more
        lowered = not described
    if found:
        models = likelihoods(bins)
    # a straight line is what the coefficient R is for
    sized = tuple(replace(e, size=e.size * scale) for e in found if e.kind != 'line')
    model = _model(bins, models, scale, unit, confidence)
    exponent, levels = _slope(bins, models, scale, confidence)
    heard = Choice(
        tuple(models),
        sized,
        top,
        described,
        lowered=top < whole,
        exponent=exponent,
        levels=levels,
    )
    return heard, model


def _model(
    bins: Bins, models: list[Candidate], scale: float, unit: str, confidence: float
) -> NoiseModel:
    best = models[0]
    near = [c for c in models[1:] if c.score - best.score <= EQUIVALENT]
    free = [c for c in like_free(models) if c not in near]
    found = {}
    for term in TERMS:
        own = coefficient_unit(unit, term)
        if term not in SPECTRAL:
            found[term] = Estimate.not_observable(
                own,
                'the slow part of a spectrum does not show it',
                confidence=confidence,
                method=METHOD,
            )
            continue
        bent = free if term == 'N' else []
        value = _coefficient(bins, best, [*near, *bent], term, confidence)
        found[term] = value.scaled(scale, own)
    process = None
    if 'G' in best.terms:
        process = _process(bins, best, scale, unit, confidence)
    return NoiseModel(
        unit=unit,
        Q=found['Q'],
        N=found['N'],
        B=found['B'],
        K=found['K'],
        R=found['R'],
        gauss_markov=process,
        fitted={t: scale * v for t, v in best.values.items() if t in TERMS},
        method=METHOD,
        tau_low=0.5 / float(bins.frequency[-1]),
        tau_high=0.5 * bins.span,
        chi2=1.0,
    )


def _coefficient(
    bins: Bins, best: Candidate, near: list[Candidate], term: str, confidence: float
) -> Estimate:
    """Return one coefficient; its interval covers what models say that are as good as the best."""
    own = _of_candidate(bins, best, term, confidence)
    others = [_of_candidate(bins, c, term, confidence) for c in near if term in c.terms]
    rivals = [c for c in near if term not in c.terms]
    if own.value is None or rivals:
        high = max(e.high or 0.0 for e in (own, *others))
        reason = own.reason or f'{TERM_NAMES[term]} is not told from {named(rivals[0])}'
        return Estimate.not_observable(
            '1', reason, high=high, confidence=confidence, method=METHOD
        )
    shown = [e for e in (own, *others) if e.value is not None]
    lows, highs = (
        [end for e in shown if (end := getattr(e, name)) is not None] for name in ('low', 'high')
    )
    return Estimate(own.value, min(lows), max(highs), '1', confidence, method=METHOD)


def _of_candidate(bins: Bins, one: Candidate, term: str, confidence: float) -> Estimate:
    binned, squares, letters = _binned(bins, one, term)
    found = estimate(binned, squares, letters.index(term), term, confidence)
    return replace(found, method=METHOD)


def _binned(bins: Bins, one: Candidate, term: str = '') -> tuple[Binned, Floats, str]:
    """Return a fit with a term that it may not have, and its shape as one more column."""
    letters = one.terms if term in one.terms else one.terms + term
    squares = np.array([one.values.get(t, 0.0) ** 2 for t in letters])
    basis = one.rows(bins.frequency, letters, one.shape)
    if one.shape:
        step = math.exp(_STEP)
        [(shaped, square)] = (
            pair for pair in zip(one.terms, one.squares, strict=True) if pair[0] in 'GF'
        )
        slower, faster = (
            one.rows(bins.frequency, shaped, shape)[0]
            for shape in (one.shape / step, one.shape * step)
        )
        # by the logarithm of the shape; without power of its own
        basis = np.vstack([basis, square * (faster - slower) / (2.0 * _STEP)])
        squares, letters = np.append(squares, 0.0), letters + 'T'
    return Binned(bins.density, basis, bins.degrees), squares, letters


def _process(
    bins: Bins, best: Candidate, scale: float, unit: str, confidence: float
) -> GaussMarkov:
    binned, squares, letters = _binned(bins, best)
    strength = replace(
        estimate(binned, squares, letters.index('G'), 'G', confidence), method=METHOD
    )
    time = _shape(bins, best, 's', confidence)
    return GaussMarkov(strength.scaled(scale, coefficient_unit(unit, 'G')), time)


def _shape(bins: Bins, one: Candidate, unit: str, confidence: float) -> Estimate:
    """Return the correlation time or exponent of a model."""
    binned, squares, letters = _binned(bins, one)
    spread = response(binned, squares, letters.index('T')).spread(0.0)
    ratio = math.exp(min(float(scipy.special.ndtri(0.5 + 0.5 * confidence)) * spread, 20.0))
    return Estimate(
        one.shape, one.shape / ratio, one.shape * ratio, unit, confidence, method=METHOD
    )


def _slope(
    bins: Bins, models: list[Candidate], scale: float, confidence: float
) -> tuple[Estimate | None, tuple[float, float] | None]:
    """Return `Choice.exponent` and `Choice.levels`."""
    free = next((c for c in models if c.terms == 'NF' and _holds(c)), None)
    if free is None:
        return None, None
    exponent = _shape(bins, free, '1', confidence)
    white, slow = free.squares[:, None] * free.rows(bins.frequency, free.terms, free.shape)
    seen = bins.frequency[slow > white]
    if not seen.size:
        return exponent, None
    # 2 B²/(2πf) of flicker noise
    first, last = (
        scale * free.values['F'] * (2.0 * math.pi * f) ** (0.5 - 0.5 * free.shape)
        for f in (seen[0], seen[-1])
    )
    return exponent, (min(first, last), max(first, last))
