# SPDX-License-Identifier: Apache-2.0
"""
What moves a bias and is no noise: a step, a slow cycle, a warm-up, a straight line.

Either has the power of a random walk or of a bump in the spectrum, but its phases are not those
of noise: as one column more of the likelihood it takes all of that power away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
import math

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.likelihood.candidates import again, Candidate
from imu_bench.metrology.likelihood.cosines import Cosines, SLOWEST
import numpy as np
import scipy

NEEDED = {
    'step': (22.0, 28.0),
    'cycle': (14.0, 22.0),
    'settling': (18.0, 26.0),
    'line': (14.0, 22.0),
}
"""
What each must gain in −2 ln L, a cycle beside 2 ln of the frequencies where it may be: if only
white noise is left without it, and if slow noise is.  Of 420 records of 10 min of white noise,
flicker and random walks 3 had a step, of 100 with one of 10 of its deviations 95.  Of 16 of
flicker with a walk four had one that gained 21 to 23 and left slow noise.
"""

MOST = 4
"""What is taken off one record: a cycle that is no sine has harmonics, and no warm-up is one
exponential."""

LEAST_CYCLES = 1.5
"""Cycles in a record that a wave needs: less of one is not told from a random walk."""

SLOWEST_SETTLING = 0.5
"""Longest time constant of a warm-up over the record; of a longer one it sees a line."""

_EDGE = 4
_SHIFTS = (-0.5, -0.25, 0.0, 0.25, 0.5)


@dataclass(frozen=True)
class Event:
    """A step, a cycle, a warm-up or a straight line."""

    kind: str  # 'step', 'cycle', 'settling' or 'line'
    # height of a step, with its sign, amplitude of a cycle, or what a warm-up is off at the start,
    # in the unit of the values; slope of a line per s
    size: float
    time: float  # of a step in s after the start; period or time constant in s
    gain: float  # what it gains in −2 ln L


def find(
    cosines: Cosines, models: list[Candidate], top: float
) -> tuple[list[Event], Cosines, list[Candidate]]:
    """Return the events of a record, its transform without them, and the models of that."""
    events: list[Event] = []
    while len(events) < MOST:
        slow = cosines.slowest(SLOWEST)
        places = slow.terms.size
        variance = _variance(slow, models[0], top)
        # back to terms of the record itself
        share = math.sqrt((places + 1) / (cosines.terms.size + 1))
        tried = []
        # a model that took it for a noise finds it in the wrong place: without one as well
        plain = [_variance(slow, one, top) for one in models[1:] if one.terms == 'N']
        for event, part in (
            _line(slow, variance),
            *(_step(slow, scatter) for scatter in (variance, *plain)),
            *(_settling(slow, scatter) for scatter in (variance, *plain)),
            *_cycles(slow, variance),
        ):
            if models[0].terms == 'N' and event.gain < 0.5 * _needed(event.kind, places, 'N'):
                continue
            rest = cosines.without(part / share)
            left = again(rest.binned(top), models)
            gain = models[0].score - left[0].score
            if gain >= _needed(event.kind, places, left[0].terms):
                tried.append((gain, replace(event, gain=gain), rest, left))
        if not tried:
            break
        _, event, cosines, models = max(tried, key=lambda one: one[0])
        events.append(event)
    return events, cosines, models


def _needed(kind: str, places: int, left: str) -> float:
    looked = 2.0 * math.log(places) if kind == 'cycle' else 0.0
    return NEEDED[kind][left != 'N'] + looked


def _variance(slow: Cosines, model: Candidate, top: float) -> Floats:
    """Return the variance of each term; beyond the highest frequency without end."""
    frequency = np.arange(1, slow.terms.size + 1) / (2.0 * slow.span)
    variance = model.density(frequency) * 0.5 * slow.rate_hz
    return np.asarray(np.where(frequency <= top, variance, np.inf))


def _line(slow: Cosines, variance: Floats) -> tuple[Event, Floats]:
    """Return the likeliest straight line, and its transform."""
    shape = scipy.fft.dct(np.arange(slow.terms.size + 1) / slow.rate_hz, norm='ortho')[1:]
    power = float(shape @ (shape / variance))
    matched = float(shape @ (slow.terms / variance))
    return Event('line', matched / power, 0.0, matched**2 / power), shape * (matched / power)


def _settling(slow: Cosines, variance: Floats) -> tuple[Event, Floats]:
    """Return the likeliest exponential from the start on, and its transform."""
    n = slow.terms.size + 1
    longest = SLOWEST_SETTLING * n
    times, shapes = _coarse(n)
    power, matched = shapes**2 @ (1.0 / variance), shapes @ (slow.terms / variance)
    best = int(np.argmax(matched**2 / power))
    if matched[best] ** 2 / power[best] >= 0.5 * min(NEEDED['settling']):
        times = np.minimum(times[best] * 2.0 ** np.linspace(-1.0, 1.0, 41), longest)
        shapes = _exponentials(n, times)
        power, matched = shapes**2 @ (1.0 / variance), shapes @ (slow.terms / variance)
        best = int(np.argmax(matched**2 / power))
    size, gain = matched[best] / power[best], matched[best] ** 2 / power[best]
    return Event('settling', float(size), float(times[best]) / slow.rate_hz, float(gain)), (
        shapes[best] * size
    )


@lru_cache(maxsize=2)
def _coarse(n: int) -> tuple[Floats, Floats]:
    """Return time constants by factors of two, in values, and the transforms of what settles."""
    longest = SLOWEST_SETTLING * n
    times = longest * 0.5 ** np.arange(math.log2(longest / _EDGE))
    return times, _exponentials(n, times)


def _exponentials(n: int, times: Floats) -> Floats:
    return np.asarray(
        scipy.fft.dct(np.exp(-(np.arange(n) + 0.5) / times[:, None]), norm='ortho', axis=1)[:, 1:]
    )


def _step(slow: Cosines, variance: Floats) -> tuple[Event, Floats]:
    """Return the likeliest step, and its transform."""
    n = slow.terms.size + 1
    angle = np.arange(1, n) * (np.pi / n)
    # a step at the start of value j has the terms −√(2/n) sin(kjπ/n)/(2 sin(kπ/2n))
    shape = -math.sqrt(2.0 / n) / (2.0 * np.sin(0.5 * angle))
    matched = 0.5 * scipy.fft.dst(slow.terms * shape / variance, type=1)
    weight = shape**2 / variance
    # Σ w sin² = Σ w (1 − cos(2kjπ/n))/2
    turned = scipy.fft.fft(np.concatenate([[0.0], weight])).real[1:]
    power = np.maximum(0.5 * (weight.sum() - turned), 1e-12 * weight.sum())
    score = matched**2 / power
    score[: _EDGE - 1] = score[n - _EDGE :] = 0.0
    at = int(np.argmax(score)) + 1
    size = float(matched[at - 1] / power[at - 1])
    part = size * shape * np.sin(at * angle)
    return Event('step', size, at / slow.rate_hz, float(score[at - 1])), part


def _cycles(slow: Cosines, variance: Floats) -> list[tuple[Event, Floats]]:
    """Return the sines that stand out most, with their transforms."""
    # One against the model, and one against the lowest noise: a model that took the cycle for a
    # noise rises to it.
    n = slow.terms.size + 1
    values = scipy.fft.idct(np.concatenate([[0.0], slow.terms]), norm='ortho')
    taper = np.sin(np.pi * (np.arange(n) + 0.5) / n)
    seen = np.abs(scipy.fft.rfft(values * taper, 2 * n)[1:-1]) ** 2
    seen[: math.ceil(2.0 * LEAST_CYCLES) - 1] = 0.0
    seen[~np.isfinite(variance[: seen.size])] = 0.0
    places = {int(np.argmax(ratio)) + 1 for ratio in (seen / variance[: seen.size], seen)}
    return [_sine(slow, variance, 0.5 * place / n) for place in sorted(places)]


def _sine(slow: Cosines, variance: Floats, coarse: float) -> tuple[Event, Floats]:
    """Return the likeliest sine near a frequency, in cycles per value."""
    n = slow.terms.size + 1
    tried = []
    for shift in _SHIFTS:
        frequency = max(coarse + shift / (2.0 * n), LEAST_CYCLES / n)
        angle = 2.0 * np.pi * frequency * np.arange(n)
        waves = scipy.fft.dct(np.stack([np.cos(angle), np.sin(angle)]), norm='ortho', axis=1)[
            :, 1:
        ]
        weighted = waves / variance
        amplitudes = np.linalg.solve(weighted @ waves.T, weighted @ slow.terms)
        gain = float(amplitudes @ (weighted @ slow.terms))
        tried.append((gain, frequency, amplitudes @ waves, float(np.hypot(*amplitudes))))
    gain, frequency, part, amplitude = max(tried, key=lambda one: one[0])
    return Event('cycle', amplitude, 1.0 / (frequency * slow.rate_hz), gain), part
