# SPDX-License-Identifier: Apache-2.0
"""JSON forms of what the metrology core returns: curves, noise models, normality."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
import math
from typing import Any

from imu_bench.metrology.curve import DeviationCurve, NOISE_NAMES
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.low_pass import LowPass
from imu_bench.metrology.fitting.noise_model import GaussMarkov, NoiseModel
from imu_bench.metrology.likelihood.candidates import Candidate
from imu_bench.metrology.likelihood.choice import Choice
from imu_bench.metrology.likelihood.events import Event
from imu_bench.metrology.normality import Histogram, Normality
from imu_bench.offline.analysis.typed import fields_of
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_WIDEST = 2.0**63
_CURVE_FLOATS = ('tau', 'deviation', 'low', 'high', 'edf')
_CURVE_INTEGERS = ('m', 'terms', 'alpha')
_MODEL_PLAIN = ('fitted', 'method', 'tau_low', 'chi2')
_LOW_PASS = ('warped', 'kind', 'period', 'floor')
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


def rows_from_json(document: Mapping[str, Any], names: Sequence[str]) -> list[Floats]:
    """Return rows of numbers that belong together, float64; null becomes NaN."""
    rows = [np.array(document[name], dtype=np.float64) for name in names]
    if any(row.shape != (rows[0].size,) for row in rows):
        raise ValueError(f'{", ".join(names)} are not rows of one length')
    return rows


def curve_from_json(document: Mapping[str, Any]) -> DeviationCurve:
    """Return the curve that `curve_to_json` wrote."""
    plain = ('kind', 'unit', 'period', 'samples', 'span', 'confidence', 'min_share')
    fields: dict[str, Any] = {name: document[name] for name in plain}
    rows = rows_from_json(document, (*_CURVE_FLOATS, *_CURVE_INTEGERS))
    fields |= zip((*_CURVE_FLOATS, *_CURVE_INTEGERS), rows, strict=True)
    if not all((np.abs(fields[name]) < _WIDEST).all() for name in _CURVE_INTEGERS):
        raise ValueError(f'one of {", ".join(_CURVE_INTEGERS)} is missing or out of range')
    fields |= {name: fields[name].astype(np.int64) for name in _CURVE_INTEGERS}
    if not set(fields['alpha'].tolist()) <= NOISE_NAMES.keys():
        raise ValueError('a noise type of the curve is unknown')
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
    if model.bandwidth is not None:
        document['bandwidth'] = model.bandwidth.to_json()
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
        fields['low_pass'] = LowPass(*(low_pass[name] for name in _LOW_PASS))
    if (bandwidth := model.get('bandwidth')) is not None:
        fields['bandwidth'] = Estimate.from_json(bandwidth)
    fields['tau_high'] = np.inf if model['tau_high'] is None else model['tau_high']
    return NoiseModel(unit=document['unit'], flags=tuple(model['flags']), **fields)


def choice_to_json(choice: Choice) -> dict[str, Any]:
    """Return the JSON object of every model that was tried, and of what is no noise."""
    return {
        'highest_hz': choice.highest,
        'described': choice.described,
        'lowered': choice.lowered,
        'refutes_filter': choice.refutes_filter,
        'share': choice.share,
        'exponent': None if choice.exponent is None else choice.exponent.to_json(),
        'levels': None if choice.levels is None else list(choice.levels),
        'words': list(choice.words),
        'events': [asdict(event) for event in choice.events],
        'candidates': [
            {
                'terms': one.terms,
                'shape': one.shape,
                'values': one.values,
                'minus_two_log_likelihood': one.misfit,
                'score': one.score if math.isfinite(one.score) else None,
            }
            for one in choice.candidates
        ],
    }


def choice_from_json(document: Mapping[str, Any]) -> Choice:
    """Return what `choice_to_json` wrote."""
    candidates = tuple(
        Candidate(
            one['terms'],
            float(one['shape']),
            np.array([one['values'][t] for t in one['terms']], np.float64) ** 2,
            float(one['minus_two_log_likelihood']),
            math.inf if one['score'] is None else float(one['score']),
        )
        for one in document['candidates']
    )
    events = tuple(Event(**event) for event in document['events'])
    return Choice(
        candidates,
        events,
        float(document['highest_hz']),
        bool(document['described']),
        bool(document['lowered']),
        bool(document.get('refutes_filter', False)),
        float(document['share']),
        None if (found := document.get('exponent')) is None else Estimate.from_json(found),
        None if (ends := document.get('levels')) is None else (float(ends[0]), float(ends[1])),
    )


def histogram_to_json(found: Histogram) -> dict[str, Any]:
    """Return the JSON object of a histogram: ``counts[i]`` between ``edges[i]`` and the next."""
    return fields_of(found, count='counts')


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


def normality_from_json(document: Mapping[str, Any]) -> Normality:
    """Return what `normality_to_json` wrote."""
    return Normality(
        verdict=document['verdict'],
        **{name: Estimate.from_json(document[name]) for name in _SHAPE},
        p_value=document['p_value'],
        beyond_three_sigma=document['beyond_three_sigma'],
    )
