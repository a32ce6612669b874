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
    """One deviation of one axis against averaging time.  All arrays have shape (k,)."""

    kind: str  # 'oadev', 'adev', 'mdev', 'tdev', 'hdev', 'ohdev' or 'totdev'
    unit: str  # unit of the deviation
    period: float  # sample period tau0 in s
    samples: int  # samples that went in, gaps not counted
    span: int  # length of the true time grid in samples, gaps counted
    m: Integers  # averaging factor; ``tau = m * period``
    # tau, deviation, low, high: averaging time in s, deviation, and its interval at `confidence`
    tau: Floats
    deviation: Floats
    low: Floats
    high: Floats
    edf: Floats  # equivalent chi-squared degrees of freedom of the deviation squared
    terms: Integers  # complete differences that went into each point
    alpha: Integers  # power-law exponent identified at each point (`NOISE_NAMES`)
    confidence: float = CONFIDENCE  # level of `low` and `high`
    # averaging times asked for that the data cannot give, each with the reason
    omitted: tuple[tuple[float, str], ...] = ()
    # least share of its samples that an average had to have: 1 if only complete ones count
    min_share: float = 1.0

    def __len__(self) -> int:
        return int(self.m.size)

    def __repr__(self) -> str:
        ends = f' from {self.tau[0]:.4g} to {self.tau[-1]:.4g} s' if len(self) else ''
        return f'<{self.kind} in {self.unit}: {len(self)} averaging times{ends}>'

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
