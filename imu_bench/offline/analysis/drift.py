# SPDX-License-Identifier: Apache-2.0
"""
The slow part of the noise of one axis: Gauss-Markov models, and a Kalman filter that tracks it.

Shabulinzenze 2020 (Tampere University MSc thesis), sections 3.2, 3.3 and 5.1.3, with the limits
that the methods have: what the data do not show is not observable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any

from imu_bench.metrology import coefficients
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import (
    coefficient_unit,
    FLICKER_FLOOR,
    GaussMarkov,
    GM_PEAK,
    NoiseModel,
    TERMS,
)
from imu_bench.metrology.markov import decay, gauss_markov, kalman
from imu_bench.metrology.markov.decay import Decay
from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.offline.analysis.blocks import Blocks
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


_LEVELS = (2000, 16_000, 128_000)
"""Blocks of a record in which a decay is looked for, from slow to fast."""

_LONGEST = 0.06
"""Longest lag over the record; beyond a twentieth no correlation time is accepted."""

_CORRELATED = 4.0
"""Correlation of neighbouring blocks, in its deviations 1/√n in white noise, that is no chance."""

_PER_TIME, _FEWEST_PER_TIME = 20.0, 4.0
"""Blocks per correlation time that the filter gets, and needs."""

_TRACKED = ('allan_fit', 'autocorrelation', 'bias_instability')
"""Models for the filter, the best first."""

_ABOVE = 1.5
_CURVE = ('m', 'tau', 'deviation', 'low', 'high', 'edf', 'terms', 'alpha')

_NOT_NEEDED = 'the fit of the whole Allan deviation does not need one'
_WAVE = 'the curve peaks at {:.3g} s, but its fit needs no process: the wave of a tone or filter'

_MOST_BLOCKS = 1 << 17
_POINTS = 500


def measure(model: NoiseModel, curve: DeviationCurve, blocks: Blocks, confidence: float) -> Drift:
    """Return Gauss-Markov models of the bias and how well a filter tracks it."""
    unit, span = model.unit, curve.span * curve.period
    found_decay, correlation = _decay(blocks, unit, confidence)
    models = {'autocorrelation': DriftModel.of_decay(found_decay, unit)}
    white = model.fitted.get('N', 0.0)
    peak = gauss_markov.from_allan(_above_white(curve, white), white=white, confidence=confidence)
    slow = models['autocorrelation'].process or model.B.value or model.K.value
    if model.gauss_markov or slow or peak.T_c.value:
        whole = model
        if not model.gauss_markov:
            whole = coefficients.fit(curve, confidence=confidence, terms=TERMS + 'G')
        if whole.gauss_markov:
            white = whole.fitted.get('N', white)
            alone = _above_white(curve, white)
            peak = gauss_markov.from_allan(alone, white=white, confidence=confidence)
        elif peak.T_c.value:
            peak = _absent(model, METHODS['allan_peak'], _WAVE.format(1.89 * peak.T_c.value))
        found = whole.gauss_markov or _absent(model, METHODS['allan_fit'], _NOT_NEEDED)
        models['allan_fit'] = DriftModel.of_allan(found, unit, span)
    models['allan_peak'] = DriftModel.of_allan(peak, unit, span)
    if model.B.value:
        flat = _middle_of_flat(model, curve)
        models['bias_instability'] = DriftModel.of_bias_instability(model.B, flat)
    return Drift(models, _track(models, white, blocks, unit, confidence), _shown(correlation))


def _absent(model: NoiseModel, method: str, reason: str) -> GaussMarkov:
    return GaussMarkov(
        Estimate.not_observable(coefficient_unit(model.unit, 'G'), reason, method=method),
        Estimate.not_observable('s', reason, method=method),
    )


def _above_white(curve: DeviationCurve, white: float) -> DeviationCurve:
    """Return the part of a curve where something else adds half as much as the white noise."""
    there = curve.deviation**2 > _ABOVE * white**2 / curve.tau
    parts = {name: getattr(curve, name)[there] for name in _CURVE}
    return replace(curve, **parts)


def _decay(
    blocks: Blocks, unit: str, confidence: float
) -> tuple[decay.Decay, decay.Autocorrelation | None]:
    """Return the first decay found and where; slow ones first, where white noise is lowest."""
    # Without a decay the autocorrelation is that of the slowest averages.
    reasons = []
    slowest = None
    for level in _LEVELS:
        size = max(1, blocks.values.size // level)
        coarse = blocks.coarser(size)
        piece = coarse.longest_piece()
        if piece.size < 2:
            break
        longest = _LONGEST * piece.size / coarse.rate_hz
        correlation = decay.autocorrelation(piece, coarse.rate_hz, longest_s=longest, unit=unit)
        slowest = slowest or correlation
        found = decay.from_autocorrelation(correlation, confidence=confidence)
        if found.process is None:
            reasons.append(found.T_c.reason)
        elif correlation.value[1] > _CORRELATED / math.sqrt(piece.size) * correlation.value[0]:
            return found, correlation
        else:
            reasons.append('neighbouring averages are no more correlated than by chance')
        if size == 1:
            break
    reason = reasons[0] if reasons else 'no two averages without a gap between them'
    return _no_decay(reason, unit, confidence), slowest


def _shown(found: decay.Autocorrelation | None) -> Correlation | None:
    """Return what a figure can hold; a constant has no autocorrelation."""
    if found is None or found.value[0] <= 0.0:
        return None
    at = np.unique(np.linspace(0, found.lag.size - 1, _POINTS).astype(np.int64))
    return Correlation(found.lag[at], found.value[at] / found.value[0])


def _no_decay(reason: str, unit: str, confidence: float) -> decay.Decay:
    def blank(of: str) -> Estimate:
        return Estimate.not_observable(of, reason, confidence=confidence, method='autocorrelation')

    return decay.Decay(blank(unit), blank('s'), blank(unit), 1.0)


def _middle_of_flat(model: NoiseModel, curve: DeviationCurve) -> float:
    """Return the averaging time in s in the middle of where flicker noise is the largest term."""
    floor = (FLICKER_FLOOR * (model.B.value or 0.0)) ** 2
    white, walk = model.fitted.get('N', 0.0), model.fitted.get('K', 0.0)
    first = max(white**2 / floor, float(curve.tau[0]))
    last = float(curve.tau[-1])
    if walk > 0.0:
        last = min(last, 3.0 * floor / walk**2)
    return math.sqrt(first * max(last, first))


def _track(
    models: dict[str, DriftModel], white: float, blocks: Blocks, unit: str, confidence: float
) -> Tracking | None:
    seen = [(name, models[name].process) for name in _TRACKED if name in models]
    # what is forgotten within a few blocks is the filter of the sensor, and hides no bias
    source, process = next(
        ((n, p) for n, p in seen if p and p.correlation_time * blocks.rate_hz >= _FEWEST_PER_TIME),
        ('', None),
    )
    if process is None or white <= 0.0:
        return None
    size = max(
        1,
        round(process.correlation_time * blocks.rate_hz / _PER_TIME),
        math.ceil(blocks.values.size / _MOST_BLOCKS),
    )
    coarse = blocks.coarser(size)
    if process.correlation_time * coarse.rate_hz < _FEWEST_PER_TIME or not coarse.valid.any():
        return None
    rate = coarse.rate_hz
    tracked = kalman.track(
        coarse.values, rate, process, kalman.white_sigma(white, rate), valid=coarse.valid
    )
    window = _best_window(white, process)
    error = kalman.rmse(tracked, coarse.values, rate, window, unit=unit, confidence=confidence)
    settled = float(np.median(tracked.deviation[coarse.valid]))
    check = tracked.whiteness
    return Tracking(
        source=source,
        block_s=1.0 / rate,
        window_s=window,
        deviation=Estimate(settled, None, None, unit, confidence, method='claimed by the filter'),
        rmse=error,
        variance=check.variance,
        p_fast=check.fast,
        p_slow=check.slow,
        white=check.white,
        trace=_trace(coarse, tracked, window),
    )


def _best_window(white: float, process: Process) -> float:
    """Return the length in s of the moving average with the smallest error."""
    # Over w the white noise leaves N²/w and a bias that walks with q_c leaves q_c² w/12 (mean
    # square distance of a centred average of a random walk from its middle): least at √12 N/q_c.
    return min(math.sqrt(12.0) * white / process.q_c, 4.0 * process.correlation_time)


def _trace(coarse: Blocks, tracked: kalman.Track, window_s: float) -> Trace:
    smooth = kalman.moving_average(coarse.values, coarse.rate_hz, window_s, coarse.valid)
    at = np.unique(np.linspace(0, smooth.size - 1, _POINTS).astype(np.int64))
    measured = np.where(coarse.valid[at], smooth[at], np.nan)
    time = np.asarray((at + 0.5) / coarse.rate_hz, np.float64)
    return Trace(time, measured, tracked.bias[at], tracked.deviation[at])
