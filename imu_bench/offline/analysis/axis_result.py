# SPDX-License-Identifier: Apache-2.0
"""Everything measured on one axis, and its JSON form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import NoiseModel
from imu_bench.metrology.likelihood.choice import Choice
from imu_bench.metrology.normality import Histogram
from imu_bench.metrology.pooling import Scatter
from imu_bench.metrology.spectra.spectrum import compare_densities, NoiseDensities, two_sided
from imu_bench.offline.analysis.checks import Checks, NO_CHECKS
from imu_bench.offline.analysis.json_forms import (
    choice_from_json,
    choice_to_json,
    curve_from_json,
    curve_to_json,
    model_from_json,
    model_to_json,
    rows_from_json,
)
from imu_bench.offline.analysis.temperature import Effect
from imu_bench.offline.analysis.typed import plain
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

DENSITIES = ('sigma', 'plateau', 'allan')
"""The ways to a noise density, in the order in which they are compared."""

_CUT, _CLEAR = 0.5, 1.5  # of the white noise; of the width of the interval of the mean

_OTHER_NOISE = (
    'the Allan deviation shows no white noise as strong as the plateau of the spectrum: other '
    'noise looks flat there'
)

_DENSITY_FLOATS = ('frequency', 'density')


@dataclass(frozen=True, eq=False)
class Density:
    """One-sided power spectral density, averaged in logarithmic bands for storage and plots."""

    frequency: Floats  # middle of the band in Hz
    density: Floats  # in the square of the unit of the axis per Hz
    # frequency and amplitude of each discrete tone
    tones: tuple[tuple[Estimate, Estimate], ...] = ()

    def to_json(self, unit: str) -> dict[str, Any]:
        """Return the JSON object of the spectrum of a signal in this unit."""
        document: dict[str, Any] = {'sided': 'one', 'unit': f'({unit})²/Hz'}
        document |= {name: getattr(self, name).tolist() for name in _DENSITY_FLOATS}
        tones = [{'frequency': f.to_json(), 'amplitude': a.to_json()} for f, a in self.tones]
        return document | {'tones': tones}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Density:
        """Return the spectrum that `to_json` wrote."""
        tones = tuple(
            (Estimate.from_json(tone['frequency']), Estimate.from_json(tone['amplitude']))
            for tone in document['tones']
        )
        frequency, density = rows_from_json(document, _DENSITY_FLOATS)
        return cls(frequency, density, tones)


@dataclass(frozen=True, eq=False)
class Envelope:
    """A time series for plotting: the extremes of each of a few thousand pieces."""

    time: Floats  # start of each piece in s since the start of the recording
    # low, high: extremes, NaN where nothing was recorded
    low: Floats
    high: Floats


@dataclass(frozen=True, eq=False)
class AxisResult:
    """Everything measured on one axis."""

    # name, unit: for example 'angular_velocity.z' and 'rad/s'
    name: str
    unit: str
    statistics: Mapping[str, Estimate]  # by the names in `STATISTICS`
    # one-sided, in unit/√Hz: √2 N of the fitted model, the same live and offline.  The JSON
    # document has `white_density` under this name, and this one among the methods
    noise_density: Estimate
    # the same quantity in three ways: 'allan' (the one above), 'plateau' of the spectrum, and
    # 'sigma' over the square root of half the sample rate
    noise_density_methods: Mapping[str, Estimate]
    allan: DeviationCurve | None  # overlapping Allan deviation; None for an axis without any noise
    model: NoiseModel  # coefficients Q, N, B, K, R
    psd: Density | None = None  # spectrum; None where the recording is too short
    # how far all this can be believed; empty for an axis without any noise
    checks: Checks = NO_CHECKS
    # the models that were tried, and what in the signal is no noise; None where gaps leave no
    # piece that could tell
    choice: Choice | None = None
    # samples too far out to belong to the noise; the statistics hold them
    outliers: int | None = None
    histogram: Histogram | None = None
    envelope: Envelope | None = None
    # of a sensor pooled from several recordings: how they differ, by coefficient
    between: Mapping[str, Scatter] = field(default_factory=dict)
    temperature: Effect | None = None  # on the bias, where the temperature is known and changed

    @property
    def quantity(self) -> str:
        """Name of the vector quantity, for example 'angular_velocity'."""
        return self.name.rpartition('.')[0]

    @property
    def letter(self) -> str:
        """Axis letter: x, y or z."""
        return self.name.rpartition('.')[2]

    @property
    def white_density(self) -> Estimate:
        """
        One-sided noise density to compare sensors by.

        That of the fit; of the plateau of the spectrum where the fit shows no white noise, or
        shows it behind a high-pass: what is left at long averaging times is no noise of the
        sensor there, however small it is.
        """
        return (
            self.noise_density_methods['plateau']
            if self.white_from_spectrum
            else self.noise_density
        )

    @property
    def white_from_spectrum(self) -> bool:
        """Whether `white_density` is that of the plateau."""
        plateau = self.noise_density_methods.get('plateau')
        if plateau is None or plateau.value is None:
            return False
        return self.noise_density.value is None or not self.shows_constants

    @property
    def shows_constants(self) -> bool:
        """
        Whether the axis shows constant signals, as far as noise can tell.

        Behind a high-pass, as in a piezoelectric sensor, the mean is zero and the Allan deviation
        falls below that of the white noise in the spectrum, to which other noise only adds.  Where
        it comes up to it later, it was a low-pass.
        """
        plateau = self.noise_density_methods.get('plateau')
        if self.allan is None or plateau is None or plateau.value is None:
            return True
        mean = self.statistics['mean']
        if mean.value is not None and mean.low is not None and mean.high is not None:
            clearly_not_zero = abs(mean.value) > _CLEAR * (mean.high - mean.low)
            if clearly_not_zero:
                return True
        root_tau = np.sqrt(self.allan.tau)
        white = plateau.value / (np.sqrt(2.0) * root_tau)
        beyond = slice(int(np.argmax(self.allan.deviation * root_tau)), None)
        return not bool(np.any(self.allan.high[beyond] < _CUT * white[beyond]))

    def coefficient(self, term: str) -> Estimate:
        """
        Return N, B, … of the fit.

        Nothing instead of a tiny number behind a high-pass, nor a bound of N below the density
        that `white_density` gives.
        """
        found: Estimate = getattr(self.model, term)
        if not self.shows_constants:
            return Estimate.not_observable(found.unit, 'not defined: it shows no constant signal')
        if term == 'N' and self.white_from_spectrum and found.high is not None:
            flat = two_sided(self.white_density).low or 0.0
            if found.high < flat:
                return Estimate.not_observable(found.unit, _OTHER_NOISE)
        return found

    @property
    def per_kelvin(self) -> Estimate | None:
        """Change of the bias with the temperature; None where that was not seen to change."""
        found = self.temperature
        return found.coefficient if found is not None and found.telling else None

    @property
    def densities(self) -> NoiseDensities | None:
        """The three noise densities with a verdict, or None where one is missing."""
        found = self.noise_density_methods
        if not all(name in found for name in DENSITIES):
            return None
        return compare_densities(*(found[name] for name in DENSITIES))

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object of one axis."""
        methods = self.noise_density_methods
        document: dict[str, Any] = {'unit': self.unit}
        document |= plain(self.statistics)
        document['noise_density'] = self.white_density.to_json()
        document['noise_density_methods'] = plain(methods)
        document['allan'] = None if self.allan is None else curve_to_json(self.allan)
        document['coefficients'] = {
            n: self.coefficient(n).to_json() for n in self.model.coefficients
        }
        document['model'] = model_to_json(self.model)
        document['model_choice'] = None if self.choice is None else choice_to_json(self.choice)
        document['psd'] = None if self.psd is None else self.psd.to_json(self.unit)
        if (compared := self.densities) is not None:
            document['noise_density_verdict'] = compared.verdict
        if self.outliers is not None:
            document['outliers'] = self.outliers
        if self.temperature is not None:
            document['temperature'] = self.temperature.to_json()
        if self.between:
            document['between_recordings'] = {n: _scatter(s) for n, s in self.between.items()}
        return document | self.checks.to_json()

    @classmethod
    def from_json(cls, name: str, document: Mapping[str, Any]) -> AxisResult:
        """Return the axis that `to_json` wrote."""
        methods = document['noise_density_methods']
        curve, density = document['allan'], document['psd']
        choice, warm = document.get('model_choice'), document.get('temperature')
        return cls(
            name=name,
            unit=document['unit'],
            statistics={n: Estimate.from_json(document[n]) for n in STATISTICS if n in document},
            noise_density=Estimate.from_json(methods.get('allan', document['noise_density'])),
            noise_density_methods={n: Estimate.from_json(e) for n, e in methods.items()},
            allan=None if curve is None else curve_from_json(curve),
            model=model_from_json(document),
            psd=None if density is None else Density.from_json(density),
            checks=Checks.from_json(document),
            choice=None if choice is None else choice_from_json(choice),
            outliers=document.get('outliers'),
            temperature=None if warm is None else Effect.from_json(warm),
            between={
                term: Scatter(
                    records=given['recordings'],
                    **{part: Estimate.from_json(given[part]) for part in _SCATTER},
                )
                for term, given in document.get('between_recordings', {}).items()
            },
        )


_SCATTER = ('mean', 'std', 'excess')


def _scatter(found: Scatter) -> dict[str, Any]:
    parts = {part: getattr(found, part).to_json() for part in _SCATTER}
    return parts | {'recordings': found.records}
