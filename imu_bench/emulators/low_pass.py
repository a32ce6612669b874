# SPDX-License-Identifier: Apache-2.0
"""The low-pass of a chip, at its output data rate."""

from __future__ import annotations

from typing import Any

from imu_bench.simulation.low_pass import (
    LowPass as Sections,
)
from imu_bench.simulation.low_pass import (
    noise_sections,
    sample_sections,
)
import numpy as np


class LowPass:
    """
    Butterworth, -3 dB at the bandwidth the document prints, settled on the first sample.

    Noise density in the pass band is kept.  What a filter before the sampling, or at a higher
    rate than that of the output, leaves of the noise above half the rate folds back; to noise it
    is that of the simulation.  A filter of the output samples lets nothing of half the rate
    through.  Motion above half the rate has folded back before it comes here, and is not reduced.
    """

    def __init__(
        self, bandwidth_hz: float, rate_hz: float, order: int = 1, *, of_samples: bool = False
    ) -> None:
        self._rate_hz = rate_hz
        widest = rate_hz / 2 if of_samples else rate_hz
        made_by = sample_sections if of_samples else noise_sections
        self._sections = Sections(bandwidth_hz, order, made_by) if bandwidth_hz < widest else None

    @property
    def state(self) -> Any:
        """What is left of the values so far; put back, they follow it again."""
        return None if self._sections is None else self._sections.state

    @state.setter
    def state(self, state: Any) -> None:
        if self._sections is not None:
            self._sections.state = state

    def filter(self, values: np.ndarray) -> np.ndarray:
        """Return filtered values, shape (n, axes); the state goes on to the next block."""
        return values if self._sections is None else self._sections.apply(values, self._rate_hz)
