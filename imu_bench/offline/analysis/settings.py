# SPDX-License-Identifier: Apache-2.0
"""What the user may ask of an analysis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import CONFIDENCE
from imu_bench.offline.analysis.typed import fields_of

CONFIDENCE_BOUNDS = (0.5, 0.999)
"""Levels that can be asked for; the same for a bench, in imu_bench.config.bench."""

_LONGEST_S = 1e9
"""No recording lasts 30 years: a larger number is a stamp or a typing error."""


@dataclass(frozen=True)
class Settings:
    """
    What the user may ask of an analysis.

    Raises
    ------
    RecordingError
        If a number makes no sense.
    """

    taus: tuple[float, ...] = ()  # averaging times in s; logarithmically spaced ones if empty
    # start_s, end_s: part to analyse, in s after the first sample
    start_s: float | None = None
    end_s: float | None = None
    # part to analyse by stamps, both included: exactly the samples of a live window
    window_ns: tuple[int, int] | None = None
    confidence: float = CONFIDENCE  # level of every interval
    reference: str = ''  # sensor that ratios refer to
    # least share of its samples that an average of the Allan deviation needs
    min_share: float = 1.0

    def __post_init__(self) -> None:
        for tau in self.taus:
            if not 0.0 < tau <= _LONGEST_S:
                raise RecordingError(
                    f'--tau {tau:g}: an averaging time is above 0 s and at most {_LONGEST_S:g} s'
                )
        for name, second in (('--start', self.start_s), ('--end', self.end_s)):
            if second is not None and not 0.0 <= second <= _LONGEST_S:
                raise RecordingError(
                    f'{name} {second:g}: give seconds after the first sample, 0 or more'
                )
        low, high = CONFIDENCE_BOUNDS
        if not low <= self.confidence <= high:
            raise RecordingError(
                f'--confidence {self.confidence:g}: give a level from {low:g} to {high:g}'
            )
        if not 0.5 <= self.min_share <= 1.0:
            raise RecordingError(f'--min-share {self.min_share:g}: give a share from 0.5 to 1')
        start, end = self.start_s or 0.0, self.end_s
        if end is not None and not start < end:
            raise RecordingError(
                f'--start {start:g} --end {end:g}: the end must be after the start'
            )

    def to_json(self) -> dict[str, Any]:
        """Return the settings as they stand in the JSON document."""
        return fields_of(self)


@dataclass(frozen=True, eq=False)
class Failure:
    """An input that could not be analysed, and why; `foreign` is one that nobody asked for."""

    source: str
    error: str
    foreign: bool = False
