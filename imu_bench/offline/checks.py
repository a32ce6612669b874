# SPDX-License-Identifier: Apache-2.0
"""What else is known about one axis: how far its coefficients can be believed, and its drift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from imu_bench.errors import DataError
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.fitting.noise_model import NoiseModel
from imu_bench.metrology.normality import Normality, normality
from imu_bench.offline import drift, second_opinion, steadiness
from imu_bench.offline.blocks import averages
from imu_bench.offline.gauss_markov_result import Drift
from imu_bench.offline.metrology_json import normality_from_json, normality_to_json
from imu_bench.offline.second_opinion import SecondOpinion
from imu_bench.offline.steadiness import Steadiness
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_BLOCKS = 1 << 18
"""
Averages that the spectrum and the drift are measured on, at most.  Fewer would widen the
interval of N beyond 0.3 %; more add nothing to B and K, which are in the slow part.
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
    """
    What qualifies the metrics of one axis.

    Attributes
    ----------
    second : SecondOpinion or None
        The coefficients by two other methods, and where they contradict the model.
    drift : Drift or None
        Gauss-Markov models of the bias, and how a filter tracks it.
    steadiness : Steadiness or None
        Whether the noise stayed the same over the recording.
    normality : Normality or None
        How far the noise is from normal; None where there are too few samples.

    All are None in a document of an older version.
    """

    second: SecondOpinion | None = None
    drift: Drift | None = None
    steadiness: Steadiness | None = None
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
            document['normality'] = normality_to_json(self.normality)
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


def examine(signal: Signal, curve: DeviationCurve, model: NoiseModel, confidence: float) -> Checks:
    """
    Return what qualifies the metrics of one axis that is not constant.

    Parameters
    ----------
    signal : Signal
    curve : DeviationCurve
        Its Allan deviation.
    model : NoiseModel
        Fitted to that.
    confidence : float
        Level of every interval.
    """
    size = -(-signal.placed.size // _BLOCKS)
    blocks = averages(signal.placed, signal.rate_hz, size, signal.valid)
    return Checks(
        second_opinion.ask(model, curve, blocks, confidence),
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
