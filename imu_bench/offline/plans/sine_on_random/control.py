# SPDX-License-Identifier: Apache-2.0
"""What the shaker really did: the spectrum of its control accelerometer against the profile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.spectrum import plateau
from imu_bench.metrology.spectra.welch import psd
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Column, Table
from imu_bench.units import STANDARD_GRAVITY
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_POINTS = 600
_TOP = 0.45
"""Of the rate: above it the filter of a converter falls."""

_NOTE = (
    'Level is that of the flat part of the spectrum between the ends of the band, the profile the '
    'one of table III. The sensors see what the shaker does, not what it was told to do.'
)


@dataclass(frozen=True, eq=False)
class Controlled:
    """The test zone of one run as the control accelerometer shows it, along the excited axis."""

    # frequency, density: hz and (m/s²)²/Hz, thinned to what a figure can show
    frequency: Floats
    density: Floats
    level: Estimate  # of the random vibration, m/s²/√Hz


def controlled(
    values: Floats, rate_hz: float, settings: Mapping[str, Any], confidence: float
) -> Controlled:
    """Return the spectrum of the control accelerometer in the test zone."""
    spectrum = psd(values, rate_hz, 'm/s²', confidence=confidence)
    low, high = settings['band']
    level = plateau(spectrum, low_hz=low, high_hz=min(high, _TOP * rate_hz), confidence=confidence)
    # the same number of points in every octave
    at = np.geomspace(1, spectrum.frequency.size, _POINTS).astype(np.int64) - 1
    starts = np.unique(at)
    ends = np.append(starts[1:], spectrum.frequency.size)
    frequency, density = (
        np.add.reduceat(column, starts) / (ends - starts)
        for column in (spectrum.frequency, spectrum.density)
    )
    return Controlled(frequency, density, level)


Runs = Sequence[tuple[str, Controlled]]


def present(runs: Runs, settings: Mapping[str, Any]) -> tuple[list[Table], list[Figure]]:
    """Return table and figures of the runs with a control accelerometer, by their names."""
    if not runs:
        return [], []
    return [_table(runs, settings)], list(_figures(runs, settings))


def _table(runs: Runs, settings: Mapping[str, Any]) -> Table:
    profile = math.sqrt(settings['density'][0])
    rows = tuple(
        (name, found.level, profile, _ratio(found.level, profile)) for name, found in runs
    )
    unit = 'm/s²/√Hz'
    columns = (
        Column('run'), Column('level', unit), Column('profile', unit), Column('ratio', 'dB'),
    )  # fmt: skip
    return Table('Control accelerometer against the profile', columns, rows, _NOTE)


def _ratio(level: Estimate, profile: float) -> Estimate:
    if level.value is None:
        return Estimate.not_observable('dB', level.reason, confidence=level.confidence)
    value, low, high = (
        None if not number else 20.0 * math.log10(number / profile)
        for number in (level.value, level.low, level.high)
    )
    return Estimate(value, low, high, 'dB', level.confidence, method=level.method)


def _figures(runs: Runs, settings: Mapping[str, Any]) -> Iterator[Figure]:
    per_g = STANDARD_GRAVITY**-2
    band = np.array(settings['band'])
    profile = np.full(2, settings['density'][0] * per_g)
    for name, found in runs:
        yield Figure(
            f'{name}: spectrum of the control accelerometer (Capriglione 2021, figure 6)',
            'frequency in Hz',
            'acceleration spectral density in g²/Hz',
            (
                Series('measured', found.frequency, found.density * per_g),
                Series('profile', band, profile, dash='dashed'),
            ),
            log_x=True, log_y=True,
        )  # fmt: skip
