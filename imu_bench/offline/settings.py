# SPDX-License-Identifier: Apache-2.0
"""What the user may ask of an analysis."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import CONFIDENCE


@dataclass(frozen=True)
class Settings:
    """
    What the user may ask of an analysis.

    Attributes
    ----------
    taus : tuple of float
        Averaging times in s; logarithmically spaced ones if empty.
    start_s, end_s : float or None
        Part to analyse, in s after the first sample.
    window_ns : tuple of int or None
        Part to analyse by stamps, both included: exactly the samples of a live window.
    confidence : float
        Level of every interval.
    reference : str
        Sensor that ratios refer to.

    Raises
    ------
    RecordingError
        If a number makes no sense.
    """

    taus: tuple[float, ...] = ()
    start_s: float | None = None
    end_s: float | None = None
    window_ns: tuple[int, int] | None = None
    confidence: float = CONFIDENCE
    reference: str = ''

    def __post_init__(self) -> None:
        for tau in self.taus:
            if not (math.isfinite(tau) and tau > 0.0):
                raise RecordingError(f'--tau {tau:g}: an averaging time must be above 0 s')
        start, end = self.start_s or 0.0, self.end_s
        if end is not None and not start < end:
            raise RecordingError(
                f'--start {start:g} --end {end:g}: the end must be after the start'
            )

    def to_json(self) -> dict[str, Any]:
        """Return the settings as they stand in the JSON document."""
        return {
            'taus': list(self.taus),
            'start_s': self.start_s,
            'end_s': self.end_s,
            'window_ns': None if self.window_ns is None else list(self.window_ns),
            'confidence': self.confidence,
            'reference': self.reference,
        }
