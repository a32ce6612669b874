# SPDX-License-Identifier: Apache-2.0
"""JSON forms of what the metrology core returns: curves, noise models, normality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.low_pass import LowPass
from imu_bench.metrology.fitting.noise_model import GaussMarkov, NoiseModel
from imu_bench.metrology.normality import Histogram, Normality
import numpy as np

_CURVE_FLOATS = ('tau', 'deviation', 'low', 'high', 'edf')
_CURVE_INTEGERS = ('m', 'terms', 'alpha')
_MODEL_PLAIN = ('fitted', 'method', 'tau_low', 'chi2')
_SHAPE = ('distance', 'skewness', 'kurtosis')


def curve_to_json(curve: DeviationCurve) -> dict[str, Any]:
    """Return the JSON object of a deviation curve."""
    document: dict[str, Any] = {
        'kind': curve.kind,
        'unit': curve.unit,
        'confidence': curve.confidence,
        'period': curve.period,
        'samples': curve.samples,
        'span': curve.span,
        'min_share': curve.min_share,
    }
    arrays = (*_CURVE_FLOATS, *_CURVE_INTEGERS)
    document |= {name: getattr(curve, name).tolist() for name in arrays}
    document['noise_type'] = curve.noise
    document['omitted'] = [{'tau': tau, 'reason': reason} for tau, reason in curve.omitted]
    return document


def curve_from_json(document: Mapping[str, Any]) -> DeviationCurve:
    """Return the curve that `curve_to_json` wrote."""
    plain = ('kind', 'unit', 'period', 'samples', 'span', 'confidence')
    fields: dict[str, Any] = {name: document[name] for name in plain}
    fields |= {name: np.array(document[name], dtype=np.float64) for name in _CURVE_FLOATS}
    fields |= {name: np.array(document[name], dtype=np.int64) for name in _CURVE_INTEGERS}
    fields['min_share'] = document.get('min_share', 1.0)
    fields['omitted'] = tuple((row['tau'], row['reason']) for row in document['omitted'])
    return DeviationCurve(**fields)


def model_to_json(model: NoiseModel) -> dict[str, Any]:
    """Return the JSON object of a model, without its coefficients."""
    document: dict[str, Any] = {
        'fitted': dict(model.fitted),
        'method': model.method,
        'tau_low': model.tau_low,
        'tau_high': model.tau_high if np.isfinite(model.tau_high) else None,
        'chi2': model.chi2,
        'flags': list(model.flags),
    }
    if model.gauss_markov is not None:
        process = model.gauss_markov
        document['gauss_markov'] = {'q_c': process.q_c.to_json(), 'T_c': process.T_c.to_json()}
    if model.low_pass is not None:
        document['low_pass'] = asdict(model.low_pass) | {'cutoff_hz': model.low_pass.cutoff}
    return document


def model_from_json(document: Mapping[str, Any]) -> NoiseModel:
    """Return the model of an axis: its coefficients, and what `model_to_json` wrote."""
    model = document['model']
    process = model.get('gauss_markov')
    fields: dict[str, Any] = {name: model[name] for name in _MODEL_PLAIN}
    fields |= {name: Estimate.from_json(e) for name, e in document['coefficients'].items()}
    if process is not None:
        parts = {name: Estimate.from_json(e) for name, e in process.items()}
        fields['gauss_markov'] = GaussMarkov(**parts)
    if (low_pass := model.get('low_pass')) is not None:
        # documents of version 0.1 knew digital filters only, by their order
        kind = low_pass.get('kind') or f'digital {low_pass["order"]}'
        floor = low_pass.get('floor', 0.0)
        fields['low_pass'] = LowPass(low_pass['warped'], kind, low_pass['period'], floor)
    fields['tau_high'] = np.inf if model['tau_high'] is None else model['tau_high']
    return NoiseModel(unit=document['unit'], flags=tuple(model['flags']), **fields)


def histogram_to_json(found: Histogram) -> dict[str, Any]:
    """Return the JSON object of a histogram: ``counts[i]`` between ``edges[i]`` and the next."""
    return {
        'unit': found.unit,
        'edges': found.edges.tolist(),
        'counts': found.count.tolist(),
        'expected': found.expected.tolist(),
        'below': found.below,
        'above': found.above,
    }


def histogram_from_json(document: Mapping[str, Any]) -> Histogram:
    """Return the histogram that `histogram_to_json` wrote."""
    return Histogram(
        np.array(document['edges'], np.float64),
        np.array(document['counts'], np.int64),
        np.array(document['expected'], np.float64),
        document['unit'],
        document['below'],
        document['above'],
    )


def normality_to_json(found: Normality) -> dict[str, Any]:
    """Return the JSON object of a test of normality."""
    return {
        'verdict': found.verdict,
        **{name: getattr(found, name).to_json() for name in _SHAPE},
        'p_value': found.p_value,
        'beyond_three_sigma': found.beyond_three_sigma,
    }


def normality_from_json(document: Mapping[str, Any]) -> Normality:
    """Return what `normality_to_json` wrote."""
    return Normality(
        verdict=document['verdict'],
        **{name: Estimate.from_json(document[name]) for name in _SHAPE},
        p_value=document['p_value'],
        beyond_three_sigma=document['beyond_three_sigma'],
    )
