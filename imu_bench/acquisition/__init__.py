# SPDX-License-Identifier: Apache-2.0
"""
From a driver to samples one can trust: each once, with its time, or counted as lost.

`Acquisition` owns the thread that reads a driver; `ClockModel` says when each
sample was measured; `AcquisitionStats` says how well it goes.
"""

from imu_bench.acquisition.clock_model import ClockModel
from imu_bench.acquisition.device import Device, Tape
from imu_bench.acquisition.stats import AcquisitionStats, Aftermath, FaultWatch
from imu_bench.acquisition.thread import Acquisition

__all__ = [
    'Acquisition',
    'AcquisitionStats',
    'Aftermath',
    'ClockModel',
    'Device',
    'FaultWatch',
    'Tape',
]
