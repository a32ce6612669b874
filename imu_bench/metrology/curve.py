# SPDX-License-Identifier: Apache-2.0
"""A deviation against averaging time, with its uncertainty: what the Allan family returns."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.metrology.estimate import CONFIDENCE, Estimate
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

NOISE_NAMES = {
    2: 'white phase',
    1: 'flicker phase',
    0: 'white',
    -1: 'flicker',
    -2: 'random walk',
    -3: 'flicker walk',
    -4: 'random run',
}
"""
Names of the power laws S_y(f) ~ f^alpha (NIST SP 1065), as seen in rate data:
alpha 2 is quantisation, 0 is angle or velocity random walk, -1 bias instability,
-2 rate random walk.
"""


@dataclass(frozen=True, eq=False)
class DeviationCurve:
    """
    One deviation of one axis against averaging time.  All arrays have shape (k,).

    Attributes
    ----------
    kind : str
        'oadev', 'adev', 'mdev', 'tdev', 'hdev', 'ohdev' or 'totdev'.
    unit : str
        Unit of the deviation.
    period : float
        Sample period tau0 in s.
    samples : int
        Samples that went in, gaps not counted.
    span : int
        Length of the true time grid in samples, gaps counted.
    m : ndarray of int64
        Averaging factor; ``tau = m * period``.
    tau, deviation, low, high : ndarray of float64
        Averaging time in s, deviation, and its interval at `confidence`.
    edf : ndarray of float64
        Equivalent chi-squared degrees of freedom of the deviation squared.
    terms : ndarray of int64
        Complete differences that went into each point.
    alpha : ndarray of int64
        Power-law exponent identified at each point (`NOISE_NAMES`).
    confidence : float
        Level of `low` and `high`.
    omitted : tuple of (float, str)
        Averaging times asked for that the data cannot give, each with the reason.
    min_share : float
        Least share of its samples that an average had to have: 1 if only complete ones count.
    """

    kind: str
    unit: str
    period: float
    samples: int
    span: int
    m: Integers
    tau: Floats
    deviation: Floats
    low: Floats
    high: Floats
    edf: Floats
    terms: Integers
    alpha: Integers
    confidence: float = CONFIDENCE
    omitted: tuple[tuple[float, str], ...] = ()
    min_share: float = 1.0

    def __len__(self) -> int:
        return int(self.m.size)

    @property
    def noise(self) -> list[str]:
        """Names of the noise identified at each point."""
        return [NOISE_NAMES[int(a)] for a in self.alpha]

    def at(self, index: int) -> Estimate:
        """Return one point as an estimate."""
        return Estimate(
            float(self.deviation[index]),
            float(self.low[index]),
            float(self.high[index]),
            self.unit,
            self.confidence,
            method=self.kind,
        )
