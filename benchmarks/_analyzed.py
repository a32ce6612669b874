# SPDX-License-Identifier: Apache-2.0
"""Made numbers on the way that `imu-bench analyze` goes with those of a recording."""

from __future__ import annotations

from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.recordings import Recording
from imu_bench.samples import Samples
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

AXIS = 'angular_velocity.x'


def recording(samples: Samples) -> Recording:
    """Return samples as a recording of them."""
    return Recording('made', 'imu', samples, None, 'imu', None, len(samples), 0, (), 'header', '')


def analyzed(
    values: Floats,
    rate_hz: float,
    settings: Settings | None = None,
    stamps: Integers | None = None,
) -> RecordingResult:
    """Return the analysis of one axis, `AXIS`, sampled regularly if no stamps are given."""
    if stamps is None:
        stamps = np.rint(np.arange(values.size) * (1e9 / rate_hz)).astype(np.int64)
    # an axis without numbers is one that the sensor does not have
    columns = np.full((values.size, 3), np.nan)
    columns[:, 0] = values
    return analyse(recording(Samples(stamps=stamps, angular_velocity=columns)), settings)
