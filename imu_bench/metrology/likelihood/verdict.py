# SPDX-License-Identifier: Apache-2.0
"""
What holds of a noise model when the likelihood of the samples has been heard.

The fit of the Allan deviation is the finer of the two where the noise is a sum of its terms.
Where it is not, the fit still finds such a sum: then what the likelihood says counts.
"""

from __future__ import annotations

from dataclasses import replace
import math

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.model_choice import EQUIVALENT
from imu_bench.metrology.fitting.noise_model import NoiseModel, TERM_NAMES
from imu_bench.metrology.likelihood.candidates import Candidate, STEEPEST
from imu_bench.metrology.likelihood.choice import Choice, like_free, named, not_told
from imu_bench.metrology.likelihood.events import Event
from imu_bench.metrology.whittle import disagreements
import numpy as np

CLOSE = 0.1
"""How far an exponent may be from 1 for B to need no word of it: B is the same to 10 % then."""

SEEN = 0.1
"""Part of the record up to which averaging times count as seen: ten averages, 5 differences."""

FALLING = 0.5
"""Share of white noise in the variance above which a curve falls more steeply than τ^(−1/4)."""


def judged(
    model: NoiseModel, choice: Choice, spectral: NoiseModel, curve: DeviationCurve
) -> NoiseModel:
    """
    Return the model that holds.

    Parameters
    ----------
    model : NoiseModel
        The fit of the Allan deviation.
    choice, spectral : Choice, NoiseModel
        What the likelihood says, and its coefficients.
    curve : DeviationCurve
        What `model` was fitted to.
    """
    if not choice.speaks:
        return floor_seen(model, curve)
    why = _against(model, choice, spectral, curve)
    found = _replaced(model, choice, spectral, curve, why) if why else model
    found = _doubted(found, choice, spectral)
    if choice.events:
        found = _withheld(found, 'BKR', '; '.join(event_text(e) for e in choice.events))
    return floor_seen(found, curve)


def event_text(event: Event, unit: str = '') -> str:
    """
    Return an event in words.

    Examples
    --------
    >>> event_text(Event('cycle', 3e-5, 900.0, 50.0), 'rad/s')
    'the bias cycles: period 900 s, amplitude 3e-05 rad/s'
    """
    size = f'{event.size:.2g} {unit}'.strip()
    if event.kind == 'step':
        return f'the bias steps by {size} at {event.time:.4g} s'
    if event.kind == 'settling':
        return f'the bias settles by {size}, time constant {event.time:.3g} s'
    return f'the bias cycles: period {event.time:.3g} s, amplitude {size}'


def floor_seen(model: NoiseModel, curve: DeviationCurve) -> NoiseModel:
    """Return a model that claims B only where its curve levels out in what was seen of it."""
    white = model.fitted.get('N', 0.0)
    if model.B.value is None or not len(curve):
        return model
    longest = SEEN * curve.span * curve.period
    tau = np.append(curve.tau[curve.tau < longest], longest)
    if np.any(white**2 / tau <= FALLING * model.deviation(tau) ** 2):
        return model
    reason = (
        f'no floor was seen: the deviation still falls at {longest:.3g} s, a tenth of the record'
    )
    return _withheld(model, 'B', reason)


def _against(
    model: NoiseModel, choice: Choice, spectral: NoiseModel, curve: DeviationCurve
) -> str:
    """Return why the fit of the Allan deviation does not hold; empty if it does."""
    best = choice.best.terms
    if choice.events:
        return 'the bias does more than noise does'
    if choice.refutes_filter:
        return f'{named(choice.best)} describes the spectrum better than a filter'
    if set(best) & set('GF') and choice.without('GF') > EQUIVALENT:
        return f'{named(choice.best)} describes the spectrum better than any sum of power laws'
    if model.gauss_markov is not None and 'G' not in best:
        return 'the spectrum needs no Gauss-Markov process'
    unsure = [t for t in 'BK' if model.coefficients[t].observable and t not in best]
    if unsure:
        return f'the spectrum does without {" and ".join(TERM_NAMES[t] for t in unsure)}'
    if spectral.N.value is not None and (
        model.N.value is None or disagreements(model, spectral, terms='N')
    ):
        return 'the two disagree on the white noise'
    trimmed = model.low_pass is None and model.tau_low > 1.01 * float(curve.tau[0])
    return 'the start of the curve follows no sum of noise terms' if trimmed else ''


def _replaced(
    model: NoiseModel, choice: Choice, spectral: NoiseModel, curve: DeviationCurve, why: str
) -> NoiseModel:
    instead = (
        f'coefficients from the likelihood of the spectrum up to {choice.highest:.3g} Hz, not '
        f'from the fit of the Allan deviation: {why}'
    )
    flags = [instead]
    if spectral.gauss_markov is not None and (time := spectral.gauss_markov.T_c.value):
        flags.append(f'a Gauss-Markov process with T_c = {time:.2g} s is part of the model')
    if 'F' in choice.best.terms:
        flags.append(f'the slow noise follows 1/f^{choice.best.shape:.2f}, which no B describes')
    if not choice.described:
        flags.append('no model that was tried describes this spectrum')
    low_pass = None if choice.refutes_filter else model.low_pass
    whole = model.low_pass is None and model.tau_low <= 1.01 * float(curve.tau[0])
    quantised = whole and model.Q.observable and model.chi2 <= _SOUND
    return replace(
        spectral,
        Q=model.Q if quantised or not model.Q.observable else _blank(model.Q, why),
        R=model.R,
        low_pass=low_pass,
        bandwidth=None if low_pass is None else model.bandwidth,
        fitted={**spectral.fitted, **{t: model.fitted[t] for t in 'R' if t in model.fitted}},
        flags=tuple(flags),
    )


def _doubted(model: NoiseModel, choice: Choice, spectral: NoiseModel) -> NoiseModel:
    """Return a model that knows of others that describe the spectrum about as well."""
    # What a power law of another exponent than 1 would make of N and B is within their intervals,
    # and a random walk that could well be something else is not claimed.
    free = like_free(choice.candidates)
    if free and model.N.observable and spectral.N.observable:
        model = replace(model, N=_covering(model.N, spectral.N.low, spectral.N.high))
    if free and model.B.observable and choice.levels is not None:
        model = replace(model, B=_covering(model.B, *choice.levels))
    if set(choice.best.terms) & set('GF'):
        return model
    best, flags = choice.best, []
    # the steepest of them is a random walk as far as a record can tell
    rivals = [c for c in free if c.score - best.score <= EQUIVALENT and c.shape < STEEPEST]
    if rivals:
        flags.append(
            f'{named(rivals[0])} describes the slow noise as well: its coefficients may be none'
        )
    elif model.B.observable and (exponent := choice.exponent) is not None:
        low, high = exponent.low or 0.0, exponent.high or math.inf
        if not 1.0 - CLOSE < low < high < 1.0 + CLOSE:
            not_one = '' if low <= 1.0 <= high else ', which it is not'
            flags.append(f'B takes the slow noise, of 1/f^{exponent}, for 1/f{not_one}')
    others = not_told(choice)
    apart = [c for c in others if _apart(c, best)]
    if apart:
        model = _withheld(model, 'K', f'{TERM_NAMES["K"]} is not told from {named(apart[0])}')
    elif others and model.K.observable:
        flags.append(
            f'K is not told from {named(others[0])}: what it makes of longer times is open'
        )
    return replace(model, flags=(*model.flags, *flags))


def _apart(other: Candidate, best: Candidate) -> bool:
    """Return whether a model that fits as well as a random walk is something else than one."""
    if 'F' in other.terms:
        return other.misfit <= best.misfit and other.shape < STEEPEST
    return other.score - best.score <= EQUIVALENT


def _covering(estimate: Estimate, low: float | None, high: float | None) -> Estimate:
    """Return an estimate whose interval holds another one."""
    lows = [end for end in (estimate.low, low) if end is not None]
    highs = [end for end in (estimate.high, high) if end is not None]
    return replace(estimate, low=min(lows), high=max(highs))


_SOUND = 1.5


def _blank(estimate: Estimate, reason: str) -> Estimate:
    return Estimate.not_observable(
        estimate.unit,
        reason,
        high=estimate.high,
        confidence=estimate.confidence,
        method=estimate.method,
    )


def _withheld(model: NoiseModel, letters: str, reason: str) -> NoiseModel:
    for letter in letters:
        found = model.coefficients[letter]
        if found.observable:
            # a field of its own name for each letter
            model = replace(model, **{letter: _blank(found, reason)})  # type: ignore[arg-type]
    return model
