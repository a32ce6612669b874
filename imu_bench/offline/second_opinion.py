# SPDX-License-Identifier: Apache-2.0
"""The noise coefficients by two other methods, and where they contradict the fitted curve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imu_bench.metrology import whittle
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import NoiseModel, TERMS
from imu_bench.metrology.fitting.tangent import tangent_fit
from imu_bench.offline.blocks import Blocks
import numpy as np

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
    coefficients : mapping of str to mapping of str to Estimate
        By the names in `METHODS`, then by letter.
    disagreements : tuple of str
        One sentence for each coefficient on which the spectrum contradicts the fit.
    disputed : str
        The letters of those coefficients.
    """

    coefficients: Mapping[str, Mapping[str, Estimate]]
    disagreements: tuple[str, ...] = ()

    @property
    def disputed(self) -> str:
        """The letters of the coefficients in dispute."""
        return ''.join(sentence[0] for sentence in self.disagreements)

    def to_json(self) -> dict[str, Any]:
        """Return the members that an axis of the JSON document gets."""
        document: dict[str, Any] = {
            f'coefficients_{name}': {term: e.to_json() for term, e in found.items()}
            for name, found in self.coefficients.items()
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


def ask(
    model: NoiseModel, curve: DeviationCurve, blocks: Blocks, confidence: float
) -> SecondOpinion:
    """
    Return the coefficients by the Whittle likelihood and by the slope-tangent method.

    Parameters
    ----------
    model : NoiseModel
        Fitted to the Allan deviation.
    curve : DeviationCurve
        That deviation.
    blocks : Blocks
        The signal.
    confidence : float
        Level of the intervals.

    Notes
    -----
    The spectrum is asked for the terms that the fit found, with its Gauss-Markov process if it
    has one.  A ramp has no spectrum: where the fit found one, the straight line is taken off
    first.
    """
    terms = ''.join(t for t in whittle.SPECTRAL_TERMS if t in model.fitted) or 'N'
    values = blocks.values
    if 'R' in model.fitted:
        values = values - _line(blocks)
    top = _TOP if model.low_pass is None else _TOP_FILTERED
    shortest = model.tau_flat if blocks.size == 1 else max(model.tau_flat, top / blocks.rate_hz)
    process = model.gauss_markov
    spectral = whittle.fit(
        values,
        blocks.rate_hz,
        unit=model.unit,
        confidence=confidence,
        terms=terms,
        valid=blocks.valid,
        shortest_tau=shortest,
        correlation_time=None if process is None else process.T_c.value,
    )
    # quantisation noise is in the fast part, which averages do not have
    compared = TERMS if blocks.size == 1 else TERMS.replace('Q', '')
    contradicted = whittle.disagreements(model, spectral, terms=compared)
    return SecondOpinion(
        {'whittle': spectral.coefficients, 'tangent': tangent_fit(curve).coefficients},
        contradicted,
    )


def _line(blocks: Blocks) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the straight line through the blocks, by least squares."""
    time = np.arange(blocks.values.size, dtype=np.float64)
    time -= time[blocks.valid].mean()
    there = blocks.values[blocks.valid]
    along = time[blocks.valid]
    slope = float(along @ (there - there.mean())) / max(float(along @ along), 1e-300)
    return np.asarray(slope * time)
