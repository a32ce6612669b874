# SPDX-License-Identifier: Apache-2.0
"""The numbers of an export: nominal or conservative, per axis or one for all three."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import json
import math
import unicodedata

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import FLICKER_FLOOR, GaussMarkov
from imu_bench.metrology.spectra.spectrum import two_sided
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.drift import DriftModel, METHODS
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.notation import date, duration, rate_text
from imu_bench.version import __version__
from msg_conversions.quantities import AXES, Quantity

_SPELLED = str.maketrans({
    '²': '^2', '³': '^3', '°': 'deg', 'µ': 'u', '√': 'sqrt', '±': '+-', 'σ': 'sigma', 'τ': 'tau',
    '×': 'x', '–': '-',
})  # fmt: skip

_PROCESSES = ('allan_fit', 'autocorrelation', 'bias_instability')
"""Gauss-Markov models that an export may use, the best first."""

BRIEF_S = 1.0
"""
A noise with a shorter memory is white where N is read: at an averaging time of 1 s, by IEEE Std
952-1997 annex C.  Programs that know white noise and a walk alone are given q_c T_c of it with N.
"""


@dataclass(frozen=True)
class Number:
    """A number in SI, or its upper bound, and in a few words how it was found."""

    value: float
    note: str
    bound: bool = False


@dataclass(frozen=True)
class Bias:
    """How the bias of one axis wanders."""

    strength: float  # driving noise: q_c of a Gauss-Markov process, or K of a random walk; in SI
    correlation_time: float  # T_c in s; infinite for a random walk
    note: str  # how it was found

    @property
    def sigma(self) -> float:
        """Standard deviation of the process; infinite for a random walk."""
        return self.strength * math.sqrt(0.5 * self.correlation_time)

    def transition(self, step: float) -> float:
        """Return e^(−step/T_c)."""
        return math.exp(-step / self.correlation_time)

    def driving_variance(self, step: float) -> float:
        """Return the variance that a step in s adds: exact, K² step for a random walk."""
        if math.isinf(self.correlation_time):
            return self.strength**2 * step
        return -(self.sigma**2) * math.expm1(-2.0 * step / self.correlation_time)


class Numbers:
    """The numbers of one recording."""

    def __init__(self, recording: RecordingResult, conservative: bool = False) -> None:
        self.recording = recording
        self.conservative = conservative

    @property
    def rate(self) -> float:
        """True sample rate in Hz."""
        rate = self.recording.health.rate.value
        if rate is None:
            raise RecordingError(f'{self._where}: the sample rate is not known')
        return rate

    def axes(self, quantity: Quantity) -> list[AxisResult]:
        """Return the axes of a quantity."""
        found = self.recording.of(quantity.name)
        if not found:
            raise RecordingError(f'{self._where}: there is no {quantity.name} in it to export')
        return found

    def white_noise(self, quantity: Quantity) -> Number:
        """
        Return one N for all axes, in unit/√Hz.

        The root of the mean square of the axes, or conservatively the largest upper end.  Noise
        with a memory shorter than `BRIEF_S` is part of it.
        """
        return self._together('N', [(a, _white(a)) for a in self.axes(quantity)])

    def random_walk(self, quantity: Quantity) -> Number:
        """
        Return one K for all axes, in unit/s/√Hz.

        A Gauss-Markov process walks with K = q_c up to its correlation time and less beyond, so
        where the fit holds one of at least `BRIEF_S`, q_c stands in for K.
        """
        return self._together('K', [(a, _walk(a)) for a in self.axes(quantity)])

    def flicker_walk(self, quantity: Quantity) -> float | None:
        """
        Return the K of a random walk that hides no flicker noise, None where none was seen.

        The deviation of white noise, N/√τ, meets the floor f = 0.664 B of flicker noise at
        τ = (N/f)².  A walk K √(τ/3) that meets it there, too, has K = √3 f²/N: shorter averages
        show white noise, longer ones the walk.  IEEE Std 952-1997 annex C for the three terms.
        """
        seen = [(a.model.B, _white(a).value) for a in self.axes(quantity) if a.shows_constants]
        walks = [
            math.sqrt(3.0) * (FLICKER_FLOOR * B.value) ** 2 / white
            for B, white in seen
            if B.value is not None and white
        ]
        return max(walks, default=None)

    def per_axis(self, quantity: Quantity, term: str) -> list[Number]:
        """Return N or K of x, y, z; one that was not recorded has the largest of the others."""
        found = {a.letter: self.axis(a, term) for a in self.axes(quantity)}
        largest = max(number.value for number in found.values())
        other = Number(largest, 'not recorded: the largest of the other axes')
        return [found.get(letter, other) for letter in AXES]

    def bias(self, axis: AxisResult) -> Bias | None:
        """
        Return how the bias of an axis wanders, or None where the recording does not show it.

        Conservatively there is always one: the upper bound of K as a random walk.
        """
        drift = axis.checks.drift
        models = drift.models if drift else {}
        for name in _PROCESSES:
            if name in models and models[name].process:
                return self._process(models[name], METHODS[name])
        K = axis.coefficient('K')
        if K.value is not None or (self.conservative and K.high is not None):
            number = self.axis(axis, 'K')
            return Bias(number.value, math.inf, f'random walk, K: {number.note}')
        return None

    def axis(self, axis: AxisResult, term: str) -> Number:
        """Return N or K of one axis."""
        estimate = _walk(axis) if term == 'K' else _white(axis)
        if self.conservative and estimate.high is not None:
            return Number(estimate.high, _upper(estimate))
        if estimate.value is not None:
            return Number(estimate.value, _measured(axis, term))
        if estimate.high is not None:
            return Number(estimate.high, _upper(estimate), bound=True)
        raise RecordingError(
            f'{self._where}: {term} of {axis.name} has neither a value nor an upper bound '
            f'({estimate.reason}); {_remedy([axis])}'
        )

    def _process(self, model: DriftModel, method: str) -> Bias:
        strength, time = model.q_c, model.T_c
        value = strength.value or 0.0
        if self.conservative and strength.high is not None:
            return Bias(
                strength.high, time.value or 0.0, f'{method}, upper end of the interval of q_c'
            )
        return Bias(value, time.value or 0.0, method)

    def _together(self, term: str, rows: Sequence[tuple[AxisResult, Estimate]]) -> Number:
        bounds = [(e.high, a.letter, e) for a, e in rows if e.high is not None]
        seen = [(e.value, _name(a, term)) for a, e in rows if e.value is not None]
        if seen and not (self.conservative and bounds):
            root = math.sqrt(sum(value**2 for value, _ in seen) / len(seen))
            if len(seen) == 1:
                return Number(root, f'{seen[0][1]} only, the other axes are not observable')
            return Number(root, f'rms of {", ".join(letter for _, letter in seen)}')
        if not bounds:
            raise RecordingError(
                f'{self._where}: {term} has neither a value nor an upper bound on any axis '
                f'({rows[0][1].reason}); {_remedy([axis for axis, _ in rows])}'
            )
        high, letter, estimate = max(bounds, key=lambda row: row[0])
        note = f'{_upper(estimate)}, largest of the axes: {letter}'
        return Number(high, note, bound=estimate.value is None)

    @property
    def _where(self) -> str:
        return f'{self.recording.source}, topic {self.recording.topic}'


def _remedy(axes: Sequence[AxisResult]) -> str:
    if any(axis.shows_constants for axis in axes):
        return 'analyse a longer recording'
    return 'no recording of this sensor will have it'


def _brief(axis: AxisResult) -> GaussMarkov | None:
    """Return the noise with a short memory of an axis, None where there is none."""
    process = axis.model.gauss_markov
    if process is None or process.q_c.value is None or process.T_c.value is None:
        return None
    return process if process.T_c.value < BRIEF_S else None


def _white(axis: AxisResult) -> Estimate:
    """Return N, from the spectrum where the Allan deviation does not show the white noise."""
    estimate = two_sided(axis.white_density) if axis.white_from_spectrum else axis.model.N
    process = _brief(axis)
    if process is None or estimate.value is None:
        return estimate
    time = process.T_c.value or 0.0

    def together(white: float | None, strength: float | None) -> float | None:
        return None if white is None or strength is None else math.hypot(white, strength * time)

    strength = process.q_c
    return replace(
        estimate,
        value=together(estimate.value, strength.value),
        low=together(estimate.low, strength.low),
        high=together(estimate.high, strength.high),
    )


def _walk(axis: AxisResult) -> Estimate:
    return process.q_c if (process := _bias_process(axis)) else axis.coefficient('K')


def _bias_process(axis: AxisResult) -> GaussMarkov | None:
    """Return the Gauss-Markov process that stands in for a walk, None where none does."""
    process = axis.model.gauss_markov
    if axis.model.K.value is not None or process is None or process.q_c.value is None:
        return None
    return None if _brief(axis) or not axis.shows_constants else process


def _name(axis: AxisResult, term: str) -> str:
    word = _measured(axis, term)
    return axis.letter if word == 'measured' else f'{axis.letter} ({word})'


def _measured(axis: AxisResult, term: str) -> str:
    if term == 'K' and _bias_process(axis):
        return 'q_c of a Gauss-Markov process'
    if term == 'N' and _brief(axis) is not None:
        return 'with noise that has a short memory'
    if term == 'N' and axis.white_from_spectrum:
        return 'plateau of the spectrum'
    return 'measured'


def _upper(estimate: Estimate) -> str:
    level = f'{100.0 * estimate.confidence:g} %'
    if estimate.value is None:
        return f'UPPER BOUND at {level}, not observable'
    return f'upper end of the {level} interval'


def plain(words: str) -> str:
    """Return text from a recording in ASCII on one line, which no file format trips over."""
    return words.encode('unicode_escape').decode('ascii')


def spelled(words: str) -> str:
    """
    Return words of ours in ASCII.

    Examples
    --------
    >>> spelled('At rest 8.9 m/s², 0.1 °/s')
    'At rest 8.9 m/s^2, 0.1 deg/s'
    """
    return plain(unicodedata.normalize('NFKC', words.translate(_SPELLED)))


def exponent(value: float) -> str:
    """Return a number that every YAML parser takes for one: with point and sign of exponent."""
    return f'{value:.6e}'


def lines(numbers: Numbers, title: str, *conventions: str) -> list[str]:
    """Return the lines of the heading, without comment signs."""
    recording = numbers.recording
    health = recording.health
    kind = 'conservative' if numbers.conservative else 'nominal'
    length = f'{duration(health.duration_s)} at {numbers.rate:.4f} Hz'
    return [
        *_warnings(recording),
        f'{title}: {kind} values, written by imu-bench {__version__}',
        f'from {plain(recording.source)}, topic {plain(recording.topic)}',
        f'{day}, {length}' if (day := date(recording.start_ns)) else length,
        *(f'{name}: sampled at {rate_text(rate)}' for name, rate in recording.rates.items()),
        *conventions,
    ]


def _warnings(recording: RecordingResult) -> list[str]:
    """Return why nobody should use the numbers."""
    said = (
        ['SIMULATED DATA: these are not the numbers of a real sensor']
        if recording.simulated
        else []
    )
    said += [
        f'NOT TO BE TRUSTED ({found.code}): {spelled(found.text)} {spelled(found.effect)}'
        for found in recording.health.severe
    ]
    return [f'WARNING: {words}' for words in said]


def topic_line(recording: RecordingResult) -> str:
    """Return the topic as a quoted string, with a word where it cannot be one of ROS."""
    quoted = json.dumps(plain(recording.topic))
    if recording.topic.startswith('/'):
        return quoted
    return f'{quoted}  # the recording was no bag: put the topic here'


def notes(found: Sequence[Number]) -> str:
    """Return how the numbers of x, y and z were found, once if in the same way."""
    words = [number.note for number in found]
    if len(set(words)) == 1:
        return words[0]
    return '; '.join(f'{letter}: {note}' for letter, note in zip(AXES, words, strict=True))


def commented(heading: list[str], sign: str = '# ') -> str:
    """Return lines as comments."""
    return ''.join(f'{sign}{line}\n' for line in heading)
