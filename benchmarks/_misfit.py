# SPDX-License-Identifier: Apache-2.0
"""
Records of noise that is no sum of power laws, each with what is true of it.

Nothing here comes from `imu_bench.simulation`: stationary noise is made by circulant embedding,
the square root of a spectrum times complex white noise, transformed back, and the part that the
period does not close over is thrown away.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import fft, signal

Floats = npt.NDArray[np.float64]
Generator = np.random.Generator

RATE_HZ = 100.0
WHITE = 1e-4
"""N of every record in rad/s/√Hz, that of an MPU-9250 and its like."""

FLICKER = 2e-5
WALK = 2e-6


def embedded(
    density: Callable[[Floats], Floats], n: int, rate_hz: float, rng: Generator
) -> Floats:
    """
    Return n samples of stationary noise of a two-sided density in Hz.

    The period is four records, so that what the record sees of it hardly repeats; the mean of
    the period, of which no record knows, is left out.
    """
    size = fft.next_fast_len(4 * n, real=True)
    frequency = np.arange(1, size // 2 + 1) * (rate_hz / size)
    parts = rng.standard_normal((2, frequency.size))
    wave = np.sqrt(density(frequency) * rate_hz * size / 2.0) * (parts[0] + 1j * parts[1])
    if size % 2 == 0:
        wave[-1] = np.sqrt(2.0) * wave[-1].real
    spectrum = np.concatenate([[0.0], wave])
    made: Floats = fft.irfft(spectrum, size)[:n]
    return made


def white(n: int, rng: Generator, strength: float = WHITE) -> Floats:
    """Return white noise of density N²."""
    made: Floats = strength * np.sqrt(RATE_HZ) * rng.standard_normal(n)
    return made


def flicker(n: int, rng: Generator, strength: float = FLICKER, exponent: float = 1.0) -> Floats:
    """Return noise of density B²/(2πf)^a: IEEE Std 952-1997 for a = 1."""
    return embedded(lambda f: strength**2 * (2.0 * np.pi * f) ** -exponent, n, RATE_HZ, rng)


def walk(n: int, rng: Generator, strength: float = WALK) -> Floats:
    """Return a random walk of rate."""
    made: Floats = np.cumsum(strength / np.sqrt(RATE_HZ) * rng.standard_normal(n))
    return made


def markov(n: int, rng: Generator, sigma: float, time: float) -> Floats:
    """Return a Gauss-Markov process: its sampled autocovariance, σ² e^(−t/T), embedded."""
    size = fft.next_fast_len(n + int(25.0 * time * RATE_HZ), real=True)
    lag = np.minimum(np.arange(size), size - np.arange(size)) / RATE_HZ
    eigenvalues = np.maximum(fft.rfft(sigma**2 * np.exp(-lag / time)).real, 0.0)
    made: Floats = fft.irfft(np.sqrt(eigenvalues) * fft.rfft(rng.standard_normal(size)), size)[:n]
    return made


def resonant(n: int, rng: Generator, cutoff: float = 15.0, quality: float = 2.0) -> Floats:
    """Return white noise behind a resonant filter of second order (bilinear transform)."""
    w = np.tan(np.pi * cutoff / RATE_HZ)
    a = np.array([1.0 + w / quality + w**2, 2.0 * (w**2 - 1.0), 1.0 - w / quality + w**2])
    made: Floats = signal.lfilter(w**2 * np.array([1.0, 2.0, 1.0]), a, white(n + 500, rng))[500:]
    return made


def step(n: int, rng: Generator, size: float) -> Floats:
    """Return one step of the bias, in the middle three fifths of the record."""
    made = np.zeros(n)
    made[int(n * rng.uniform(0.2, 0.8)) :] = size
    return made


def wave(n: int, rng: Generator, amplitude: float, frequency: float) -> Floats:
    """Return a sine of any phase."""
    time = np.arange(n) / RATE_HZ
    made: Floats = amplitude * np.sin(2.0 * np.pi * (frequency * time + rng.uniform()))
    return made


def warm_up(n: int, rng: Generator, size: float, time: float) -> Floats:
    """Return a bias that settles, from a start that is off by `size` on either side."""
    made: Floats = rng.choice([-size, size]) * np.exp(-np.arange(n) / (time * RATE_HZ))
    return made


@dataclass(frozen=True)
class Scenario:
    """
    One kind of record.

    Attributes
    ----------
    make : callable
        Returns the samples, for their number and a generator.
    truth : mapping of str to float
        N, and what else is there of Q, B and K.
    odd : bool
        Whether the long-term part is none of a noise, so that the result has to say so.
    places : callable or None
        Returns when the samples are, in periods, for their number and a generator.
    jittered : bool
        Whether none is lost, although their times are not regular.
    min_share : float
        As of `analyze --min-share`.
    vague : str
        Letters of terms that the noise may be called with some right.
    family : bool
        Whether the noise is a sum of power laws.
    filtered : bool
        Whether a filter is there.
    """

    make: Callable[[int, Generator], Floats]
    truth: Mapping[str, float] = field(default_factory=lambda: {'N': WHITE})
    odd: bool = False
    places: Callable[[int, Generator], Floats | npt.NDArray[np.int64]] | None = None
    jittered: bool = False
    min_share: float = 1.0
    vague: str = ''
    family: bool = False
    filtered: bool = False


def _with(make: Callable[[int, Generator], Floats]) -> Callable[[int, Generator], Floats]:
    return lambda n, rng: white(n, rng) + make(n, rng)


def _outliers(n: int, rng: Generator) -> Floats:
    made = np.zeros(n)
    at = rng.random(n) < 1e-3
    made[at] = 20.0 * WHITE * np.sqrt(RATE_HZ) * rng.choice([-1.0, 1.0], int(at.sum()))
    return made


def _at_random(n: int, rng: Generator) -> npt.NDArray[np.int64]:
    """Return the places of samples of which one in twenty is lost."""
    places = np.arange(n)
    return places[rng.random(n) > 0.05]


def _hole(n: int, rng: Generator) -> npt.NDArray[np.int64]:
    """Return the places of two halves with a hole of ten times their length between them."""
    del rng
    places = np.arange(n)
    return places + 10 * n * (places >= n // 2)


def _jittered(n: int, rng: Generator) -> Floats:
    """Return times that scatter by a fifth of a period; no clock stamps backwards."""
    made: Floats = np.sort(np.arange(n) + 0.2 * rng.standard_normal(n))
    return made


def _duty(n: int, rng: Generator) -> npt.NDArray[np.int64]:
    """Return the places of six stretches, with 59 times their length between them."""
    del rng
    stretch = n // 6
    places = np.arange(6 * stretch)
    return places + 59 * stretch * (places // stretch)


SCENARIOS: Mapping[str, Scenario] = {
    'white': Scenario(white, family=True),
    'white, flicker': Scenario(_with(flicker), {'N': WHITE, 'B': FLICKER}, family=True),
    'white, random walk': Scenario(_with(walk), {'N': WHITE, 'K': WALK}, family=True),
    'white, flicker, random walk': Scenario(
        lambda n, rng: white(n, rng) + flicker(n, rng) + walk(n, rng),
        {'N': WHITE, 'B': FLICKER, 'K': WALK},
        family=True,
    ),
    'Gauss-Markov 100 s': Scenario(_with(lambda n, rng: markov(n, rng, 5e-5, 100.0))),
    'flicker, Gauss-Markov 30 s': Scenario(
        lambda n, rng: white(n, rng) + flicker(n, rng) + markov(n, rng, 5e-5, 30.0),
        {'N': WHITE, 'B': FLICKER},
    ),
    'AR(1) 0.9': Scenario(_with(lambda n, rng: markov(n, rng, 1e-3, 0.0949))),
    'resonant filter': Scenario(resonant, filtered=True),
    'step': Scenario(_with(lambda n, rng: step(n, rng, 1e-4)), odd=True),
    'cycle of 15 min': Scenario(_with(lambda n, rng: wave(n, rng, 3e-5, 1 / 900.0)), odd=True),
    'tone aliased to 0.03 Hz': Scenario(_with(lambda n, rng: wave(n, rng, 1e-4, 0.03)), odd=True),
    'warm-up': Scenario(_with(lambda n, rng: warm_up(n, rng, 2e-4, 180.0)), odd=True),
    '1/f^0.8': Scenario(_with(lambda n, rng: flicker(n, rng, exponent=0.8)), vague='B'),
    '1/f^1.3': Scenario(_with(lambda n, rng: flicker(n, rng, exponent=1.3)), vague='B'),
    'outliers': Scenario(_with(_outliers)),
    'lost at random': Scenario(white, places=_at_random, min_share=0.9),
    'duty cycle': Scenario(white, places=_duty),
    'hole of ten lengths': Scenario(white, places=_hole),
    'jittered stamps': Scenario(white, places=_jittered, jittered=True),
}
