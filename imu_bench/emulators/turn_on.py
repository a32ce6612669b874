# SPDX-License-Identifier: Apache-2.0
"""What a sensor shows while it is being turned on."""

from __future__ import annotations

import numpy as np


class TurnOn:
    """Values that rise from nothing over the first samples."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self.state = 0  # how many there were so far

    def filter(self, values: np.ndarray) -> np.ndarray:
        """Return what is shown of values, shape (n, axes)."""
        if self.state >= self._samples:
            return values
        risen = (self.state + np.arange(len(values))) / self._samples
        self.state += len(values)
        return np.asarray(values * np.minimum(risen, 1.0)[:, np.newaxis])
