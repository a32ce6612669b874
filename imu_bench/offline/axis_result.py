# SPDX-License-Identifier: Apache-2.0
"""Everything measured on one axis, and its JSON form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.noise_model import GaussMarkov, NoiseModel
from imu_bench.metrology.normality import Histogram
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

STATISTICS = (
    'mean',
    'std',
    'rms',
    'rms_total',
    'minimum',
    'maximum',
    'peak_to_peak',
    'three_sigma',
)
"""Names of the statistics of an axis in the JSON document."""

_CURVE_FLOATS = ('tau', 'deviation', 'low', 'high', 'edf')
_DENSITY_FLOATS = ('frequency', 'density')
_MODEL_PLAIN = ('fitted', 'method', 'tau_low', 'chi2')
_CURVE_INTEGERS = ('m', 'terms', 'alpha')


@dataclass(frozen=True, eq=False)
class Density:
    """
    One-sided power spectral density, averaged in logarithmic bands for storage and plots.

    Attributes
    ----------
    frequency : ndarray, shape (k,)
        Middle of the band in Hz.
    density : ndarray, shape (k,)
        In the square of the unit of the axis per Hz.
    tones : tuple of (Estimate, Estimate)
        Frequency and amplitude of each discrete tone.
    """

    frequency: Floats
    density: Floats
    tones: tuple[tuple[Estimate, Estimate], ...] = ()


@dataclass(frozen=True, eq=False)
class Envelope:
    """
    A time series for plotting: the smallest and largest value of each of a few thousand pieces.

    Attributes
    ----------
    time : ndarray, shape (k,)
        Start of each piece in s since the start of the recording.
    low, high : ndarray, shape (k,)
        Extremes, NaN where nothing was recorded.
    """

    time: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, eq=False)
class AxisResult:
    """
    Everything measured on one axis.

    Attributes
    ----------
    name, unit : str
        For example 'angular_velocity.z' and 'rad/s'.
    statistics : mapping of str to Estimate
        By the names in `STATISTICS`.
    noise_density : Estimate
        One-sided, in unit/√Hz: √2 N of the fitted model, the same live and offline.
    noise_density_methods : mapping of str to Estimate
        The same quantity in three ways: 'allan' (the one above), 'plateau' of the spectrum, and
        'sigma' over the square root of half the sample rate.
    allan : DeviationCurve or None
        Overlapping Allan deviation; None for an axis without any noise.
    model : NoiseModel
        Coefficients Q, N, B, K, R.
    psd : Density or None
        Spectrum; None where the recording is too short.
    histogram, envelope : for the report, not in the JSON document.
    """

    name: str
    unit: str
    statistics: Mapping[str, Estimate]
    noise_density: Estimate
    noise_density_methods: Mapping[str, Estimate]
    allan: DeviationCurve | None
    model: NoiseModel
    psd: Density | None = None
    histogram: Histogram | None = None
    envelope: Envelope | None = None

    @property
    def quantity(self) -> str:
        """Name of the vector quantity, for example 'angular_velocity'."""
        return self.name.rpartition('.')[0]

    @property
    def letter(self) -> str:
        """Axis letter: x, y or z."""
        return self.name.rpartition('.')[2]

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object of one axis."""
        methods = self.noise_density_methods
        document: dict[str, Any] = {'unit': self.unit}
        document |= {name: value.to_json() for name, value in self.statistics.items()}
        document['noise_density'] = self.noise_density.to_json()
        document['noise_density_methods'] = {n: e.to_json() for n, e in methods.items()}
        document['allan'] = None if self.allan is None else _curve_to_json(self.allan)
        document['coefficients'] = {n: e.to_json() for n, e in self.model.coefficients.items()}
        document['model'] = _model_to_json(self.model)
        document['psd'] = None if self.psd is None else _density_to_json(self.psd, self.unit)
        return document

    @classmethod
    def from_json(cls, name: str, document: Mapping[str, Any]) -> AxisResult:
        """Return the axis that `to_json` wrote."""
        methods = document['noise_density_methods']
        curve, density = document['allan'], document['psd']
        return cls(
            name=name,
            unit=document['unit'],
            statistics={n: Estimate.from_json(document[n]) for n in STATISTICS if n in document},
            noise_density=Estimate.from_json(document['noise_density']),
            noise_density_methods={n: Estimate.from_json(e) for n, e in methods.items()},
            allan=None if curve is None else _curve_from_json(curve),
            model=_model_from_json(document),
            psd=None if density is None else _density_from_json(density),
        )


def _curve_to_json(curve: DeviationCurve) -> dict[str, Any]:
    document: dict[str, Any] = {
        'kind': curve.kind,
        'unit': curve.unit,
        'confidence': curve.confidence,
        'period': curve.period,
        'samples': curve.samples,
        'span': curve.span,
    }
    arrays = (*_CURVE_FLOATS, *_CURVE_INTEGERS)
    document |= {name: getattr(curve, name).tolist() for name in arrays}
    document['noise_type'] = curve.noise
    document['omitted'] = [{'tau': tau, 'reason': reason} for tau, reason in curve.omitted]
    return document


def _curve_from_json(document: Mapping[str, Any]) -> DeviationCurve:
    plain = ('kind', 'unit', 'period', 'samples', 'span', 'confidence')
    fields: dict[str, Any] = {name: document[name] for name in plain}
    fields |= {name: np.array(document[name], dtype=np.float64) for name in _CURVE_FLOATS}
    fields |= {name: np.array(document[name], dtype=np.int64) for name in _CURVE_INTEGERS}
    fields['omitted'] = tuple((row['tau'], row['reason']) for row in document['omitted'])
    return DeviationCurve(**fields)


def _model_to_json(model: NoiseModel) -> dict[str, Any]:
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
    return document


def _model_from_json(document: Mapping[str, Any]) -> NoiseModel:
    model = document['model']
    process = model.get('gauss_markov')
    fields: dict[str, Any] = {name: model[name] for name in _MODEL_PLAIN}
    fields |= {name: Estimate.from_json(e) for name, e in document['coefficients'].items()}
    if process is not None:
        parts = {name: Estimate.from_json(e) for name, e in process.items()}
        fields['gauss_markov'] = GaussMarkov(**parts)
    fields['tau_high'] = np.inf if model['tau_high'] is None else model['tau_high']
    return NoiseModel(unit=document['unit'], flags=tuple(model['flags']), **fields)


def _density_to_json(density: Density, unit: str) -> dict[str, Any]:
    document: dict[str, Any] = {'sided': 'one', 'unit': f'({unit})²/Hz'}
    document |= {name: getattr(density, name).tolist() for name in _DENSITY_FLOATS}
    tones = [{'frequency': f.to_json(), 'amplitude': a.to_json()} for f, a in density.tones]
    return document | {'tones': tones}


def _density_from_json(document: Mapping[str, Any]) -> Density:
    tones = tuple(
        (Estimate.from_json(tone['frequency']), Estimate.from_json(tone['amplitude']))
        for tone in document['tones']
    )
    frequency, density = (np.array(document[n], dtype=np.float64) for n in _DENSITY_FLOATS)
    return Density(frequency, density, tones)
