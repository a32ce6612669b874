# SPDX-License-Identifier: Apache-2.0
"""Gauss-Markov models of the drift of one axis, how a filter tracks it, and their JSON form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import (
    coefficient_unit,
    FLICKER_FLOOR,
    GaussMarkov,
    GM_PEAK,
)
from imu_bench.metrology.markov.decay import Decay
from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.offline.analysis.typed import fields_of, plain
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]

METHODS = {
    'allan_fit': 'fit of the Allan deviation',
    'autocorrelation': 'autocorrelation',
    'allan_peak': 'peak of the Allan deviation',
    'bias_instability': 'equivalent of B',
}
"""Where a process comes from, by its name in the JSON document."""

_INNOVATIONS = ('variance', 'p_fast', 'p_slow', 'white')


@dataclass(frozen=True)
class DriftModel:
    """A first-order Gauss-Markov process as estimates."""

    T_c: Estimate  # correlation time in s
    sigma: Estimate  # standard deviation, in the unit of the signal
    q_c: Estimate  # strength of the driving noise, sigma √(2/T_c)

    @property
    def process(self) -> Process | None:
        """The process, or None where the data do not show one."""
        if not self.T_c.value or not self.sigma.value:
            return None
        return Process(self.sigma.value, self.T_c.value)

    @classmethod
    def of_decay(cls, decay: Decay, unit: str) -> DriftModel:
        """Return the model of an autocorrelation; the errors of its two numbers add as squares."""
        sigma, time = decay.sigma, decay.T_c
        strength_unit = coefficient_unit(unit, 'G')
        if not sigma.value or not time.value or not sigma.high or not time.high:
            reason = sigma.reason or time.reason
            blank = Estimate.not_observable(strength_unit, reason, method='autocorrelation')
            return cls(time, sigma, blank)
        strength = Process(sigma.value, time.value).q_c
        factor = math.exp(
            math.hypot(math.log(sigma.high / sigma.value), 0.5 * math.log(time.high / time.value))
        )
        found = Estimate(
            strength, strength / factor, strength * factor, strength_unit, sigma.confidence,
            method=sigma.method,
        )  # fmt: skip
        return cls(time, sigma, found)

    @classmethod
    def of_allan(cls, found: GaussMarkov, unit: str, span_s: float) -> DriftModel:
        """
        Return the model of an Allan deviation over span_s seconds.

        Its height fixes sigma = q_c √(T_c/2); q_c and T_c trade off against one another, so the
        low end of one goes with the high end of the other.  No record tells sigma better than
        to √(T_c/2T), the scatter of the root mean square of the process itself.
        """
        time, strength = found.T_c, found.q_c
        if not time.value or not strength.value:
            reason = strength.reason or time.reason
            return cls(time, Estimate.not_observable(unit, reason, method=time.method), strength)
        value = strength.value * math.sqrt(0.5 * time.value)
        z = float(scipy.special.ndtri(0.5 + 0.5 * strength.confidence))
        factor = math.exp(z * math.sqrt(0.5 * time.value / span_s))
        low, high = value / factor, value * factor
        if strength.low and strength.high and time.low and time.high:
            low = min(low, strength.low * math.sqrt(0.5 * time.high))
            high = max(high, strength.high * math.sqrt(0.5 * time.low))
        return cls(
            time,
            Estimate(value, low, high, unit, strength.confidence, method=strength.method),
            strength,
        )

    @classmethod
    def of_bias_instability(cls, B: Estimate, flat_tau: float) -> DriftModel:
        """
        Return the process whose Allan deviation touches the floor of flicker noise.

        A single process replaces flicker noise near one averaging time only: its peak, 0.437
        q_c √T_c at 1.89 T_c, is laid on the floor 0.664 B (both IEEE Std 952-1997 annex C) in
        the middle of the flat part, so sigma = 0.664 B / (0.437 √2) = 1.07 B.
        """
        time = Estimate(flat_tau / 1.89, None, None, 's', B.confidence, method='middle of B')
        share = FLICKER_FLOOR / GM_PEAK
        sigma = B.scaled(share / math.sqrt(2.0), B.unit)
        strength = B.scaled(share / math.sqrt(time.value or 1.0), coefficient_unit(B.unit, 'G'))
        return cls(time, sigma, strength)

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> DriftModel:
        """Return the model that `to_json` wrote."""
        return cls(**{name: Estimate.from_json(e) for name, e in document.items()})


@dataclass(frozen=True, eq=False)
class Trace:
    """
    The tracked bias for a figure: time in s, measured average, tracked value, its deviation.

    All arrays have shape (k,).
    """

    time: Floats
    measured: Floats
    bias: Floats
    deviation: Floats


@dataclass(frozen=True, eq=False)
class Tracking:
    """How a Kalman filter with a Gauss-Markov model follows the bias."""

    source: str  # which model it used, one of `METHODS`
    block_s: float  # the filter runs on averages over this time
    window_s: float  # moving average that the tracked bias is compared with
    # what the filter claims for its error once settled, in the unit of the signal
    deviation: Estimate
    rmse: Estimate  # RMS difference between the tracked bias and the moving average
    variance: float  # mean square of the normalised innovations; 1 for the right noise levels
    # p_fast, p_slow: probability of correlations this large in white innovations, between blocks
    # and between averages of a quarter of the correlation time
    p_fast: float
    p_slow: float
    white: bool  # whether the innovations are white: the model then describes all there is
    trace: Trace | None = None  # for the report, not in the JSON document

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object."""
        innovations = {name: getattr(self, name) for name in _INNOVATIONS}
        return fields_of(self, but=(*_INNOVATIONS, 'trace')) | {'innovations': innovations}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Tracking:
        """Return the tracking that `to_json` wrote, without the trace."""
        return cls(
            source=document['source'],
            block_s=document['block_s'],
            window_s=document['window_s'],
            deviation=Estimate.from_json(document['deviation']),
            rmse=Estimate.from_json(document['rmse']),
            **document['innovations'],
        )


@dataclass(frozen=True, eq=False)
class Correlation:
    """Autocorrelation of averages about their mean, for a figure: lag in s, share of lag zero."""

    lag: Floats
    value: Floats


@dataclass(frozen=True, eq=False)
class Drift:
    """The slow part of the noise of one axis."""

    models: Mapping[str, DriftModel]  # by the names in `METHODS`; those that were looked for
    tracking: Tracking | None = None  # None where there is no bias to track
    correlation: Correlation | None = None  # for the report, not in the JSON document

    def to_json(self) -> dict[str, Any]:
        """Return the members that an axis of the JSON document gets."""
        return {
            'gauss_markov': plain(self.models),
            'bias_tracking': plain(self.tracking),
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Drift | None:
        """Return what `to_json` put into an axis; None if there is nothing of it."""
        if 'gauss_markov' not in document:
            return None
        models = {n: DriftModel.from_json(d) for n, d in document['gauss_markov'].items()}
        tracked = document.get('bias_tracking')
        return cls(models, None if tracked is None else Tracking.from_json(tracked))
