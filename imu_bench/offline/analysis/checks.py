# SPDX-License-Identifier: Apache-2.0
"""What else is known about one axis: how far its coefficients can be believed, and its drift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any, NamedTuple

from imu_bench.errors import DataError
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import NoiseModel
from imu_bench.metrology.fitting.tangent import tangent_fit
from imu_bench.metrology.likelihood.choice import Choice, choose, SPECTRAL
from imu_bench.metrology.likelihood.filters import refuted
from imu_bench.metrology.normality import Normality, normality
from imu_bench.metrology.stretches import longest
from imu_bench.metrology.whittle import disagreements
from imu_bench.offline.analysis import drift, steadiness
from imu_bench.offline.analysis.blocks import averages, Blocks
from imu_bench.offline.analysis.drift import Drift
from imu_bench.offline.analysis.json_forms import normality_from_json
from imu_bench.offline.analysis.steadiness import Steadiness
from imu_bench.offline.analysis.typed import plain
import numpy as np
import numpy.typing as npt

METHODS = ('whittle', 'tangent')
"""Names of the methods: in the JSON document ``coefficients_<name>``."""

_TOP = 2.0
"""Shortest averaging time in blocks: above a quarter of their rate averages fold noise back."""

_TOP_FILTERED = 4.0
"""
The same behind a low-pass filter.  Averages of white noise are white because what folds back
makes up for what they take; a filter leaves less to fold back, 1 % of N up to a quarter of their
rate, 0.2 % up to an eighth.
"""


@dataclass(frozen=True)
class SecondOpinion:
    """
    Coefficients by other methods than the fit of the Allan deviation.

    Attributes
    ----------
    disputed : str
        The letters of those coefficients.
    """

    coefficients: Mapping[str, Mapping[str, Estimate]]  # by the names in `METHODS`, then by letter
    # one sentence for each coefficient on which the spectrum contradicts the fit
    disagreements: tuple[str, ...] = ()

    @property
    def disputed(self) -> str:
        """The letters of the coefficients in dispute."""
        return ''.join(sentence[0] for sentence in self.disagreements)

    def to_json(self) -> dict[str, Any]:
        """Return the members that an axis of the JSON document gets."""
        document: dict[str, Any] = {
            f'coefficients_{name}': plain(found) for name, found in self.coefficients.items()
        }
        return document | {'disagreements': list(self.disagreements)}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> SecondOpinion | None:
        """Return what `to_json` put into an axis; None if there is nothing of it."""
        found = {
            name: {term: Estimate.from_json(e) for term, e in given.items()}
            for name in METHODS
            if (given := document.get(f'coefficients_{name}')) is not None
        }
        return cls(found, tuple(document.get('disagreements', ()))) if found else None


def hear(
    model: NoiseModel, signal: Signal, blocks: Blocks, confidence: float
) -> tuple[Choice, NoiseModel] | None:
    """
    Return what the likelihood of the samples says, and its coefficients.

    It looks at the whole band of the longest piece without a gap, and tries models of its own.
    None of too few values.

    What a filter takes is no matter of the slow noise: behind one that the fit found, the band
    ends where it begins, unless the samples say that it is none.
    """
    low_pass = model.low_pass
    no_filter = low_pass is not None and refuted(_longest(signal), signal.rate_hz, low_pass)
    if no_filter:
        low_pass, blocks = None, _averages(signal, _FINE)
    piece = longest(blocks.valid)
    highest = math.inf
    if blocks.size > 1:
        top = _TOP if low_pass is None else _TOP_FILTERED
        highest = 0.5 * blocks.rate_hz / top
    if low_pass is not None:
        highest = min(highest, 0.5 / model.tau_flat)
    heard = choose(
        blocks.values[piece],
        blocks.rate_hz,
        unit=model.unit,
        confidence=confidence,
        highest=highest,
        size=blocks.size,
    )
    if heard is None:
        return None
    share = (piece.stop - piece.start) / np.count_nonzero(blocks.valid)
    return replace(heard[0], share=share, refutes_filter=no_filter), heard[1]


def _longest(signal: Signal) -> Floats:
    """Return the samples of the longest piece without a gap."""
    return signal.placed if signal.valid is None else signal.placed[longest(signal.valid)]


def second_opinion(
    fit: NoiseModel, spectral: NoiseModel | None, curve: DeviationCurve
) -> SecondOpinion:
    """Return the coefficients by the likelihood and by the slope-tangent method."""
    found = {
        'whittle': _nothing(fit) if spectral is None else spectral.coefficients,
        'tangent': tangent_fit(curve).coefficients,
    }
    contradicted = () if spectral is None else disagreements(fit, spectral, terms=SPECTRAL)
    return SecondOpinion(found, contradicted)


def _nothing(fit: NoiseModel) -> dict[str, Estimate]:
    """Return coefficients of which nothing is known, in the units of a fit."""
    reason = 'too few samples in one piece for a spectrum'
    return {t: Estimate.not_observable(e.unit, reason) for t, e in fit.coefficients.items()}


Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_BLOCKS = 1 << 18
"""
Averages that the spectrum and the drift are measured on, at most.  Fewer would widen the
interval of N beyond 0.3 %; more add nothing to B and K, which are in the slow part.
"""

_FINE = 1 << 21
"""
The same where noise with a memory may be as fast as the samples: 5.8 h at 100 Hz as they are.
"""

_PARTS, _PART = 64, 4096
"""Stretches of samples in which the distribution is looked at, spread over the recording."""


class Signal(NamedTuple):
    """One axis on the regular time grid; `valid` is None where no sample is missing."""

    placed: Floats
    valid: Bools | None
    rate_hz: float
    unit: str
    start_s: float


@dataclass(frozen=True, eq=False)
class Checks:
    """What qualifies the metrics of one axis."""

    # the coefficients by two other methods, and where they contradict the model
    second: SecondOpinion | None = None
    drift: Drift | None = None  # Gauss-Markov models of the bias, and how a filter tracks it
    steadiness: Steadiness | None = None  # whether the noise stayed the same over the recording
    # how far the noise is from normal; None where there are too few samples
    normality: Normality | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the members that an axis of the JSON document gets."""
        document: dict[str, Any] = {}
        if self.second is not None:
            document |= self.second.to_json()
        if self.drift is not None:
            document |= self.drift.to_json()
        if self.steadiness is not None:
            document['stationarity'] = self.steadiness.to_json()
        if self.normality is not None:
            document['normality'] = plain(self.normality)
        return document

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Checks:
        """Return what `to_json` put into an axis."""
        steady, shape = document.get('stationarity'), document.get('normality')
        return cls(
            SecondOpinion.from_json(document),
            Drift.from_json(document),
            None if steady is None else Steadiness.from_json(steady),
            None if shape is None else normality_from_json(shape),
        )


NO_CHECKS = Checks()
"""Of an axis without any noise."""


def slow_part(signal: Signal) -> Blocks:
    """Return the averages that the spectrum and the drift are measured on."""
    return _averages(signal, _BLOCKS)


def _averages(signal: Signal, most: int) -> Blocks:
    size = -(-signal.placed.size // most)
    return averages(signal.placed, signal.rate_hz, size, signal.valid)


def examine(
    signal: Signal,
    blocks: Blocks,
    curve: DeviationCurve,
    fit: NoiseModel,
    heard: tuple[Choice, NoiseModel] | None,
    model: NoiseModel,
    confidence: float,
) -> Checks:
    """Return what qualifies the metrics of one axis that is not constant."""
    return Checks(
        second_opinion(fit, None if heard is None else heard[1], curve),
        drift.measure(model, curve, blocks, confidence),
        steadiness.examine(
            signal.placed,
            signal.rate_hz,
            signal.unit,
            valid=signal.valid,
            start_s=signal.start_s,
            confidence=confidence,
        ),
        _normality(signal, confidence),
    )


def _normality(signal: Signal, confidence: float) -> Normality | None:
    try:
        return normality(_stretches(signal), confidence)
    except DataError:
        # too few samples to tell, or all of those looked at are equal
        return None


def _stretches(signal: Signal) -> Floats:
    """Return the samples of stretches spread over the recording; all of a short one."""
    placed, valid = signal.placed, signal.valid
    if placed.size <= _PARTS * _PART:
        return placed if valid is None else placed[valid]
    starts = np.linspace(0, placed.size - _PART, _PARTS).astype(np.int64).tolist()
    parts = [slice(start, start + _PART) for start in starts]
    return np.concatenate(
        [placed[part] if valid is None else placed[part][valid[part]] for part in parts]
    )
