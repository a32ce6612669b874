# SPDX-License-Identifier: Apache-2.0
"""Quantiles without scipy, against scipy; and that reading a sensor does without it."""

import subprocess
import sys

from imu_bench.acquisition.quantiles import chi_square, student
import pytest
from scipy import stats

DEGREES = [2, 3, 5, 8, 10, 30, 118, 500, 13_000]


@pytest.mark.parametrize('degrees', DEGREES)
@pytest.mark.parametrize('tail', [0.005, 0.025, 0.16])
def test_chi_square_is_that_of_scipy(degrees, tail):
    tolerance = 1e-6 if degrees < 100 else 1e-3
    for probability in (tail, 1 - tail):
        expected = stats.chi2.isf(probability, degrees)
        assert chi_square(degrees, probability) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize('degrees', DEGREES)
@pytest.mark.parametrize('probability', [0.84, 0.975, 0.995])
def test_student_is_that_of_scipy(degrees, probability):
    tolerance = 1e-9 if degrees == 2 else 0.02 if degrees < 8 else 1e-3
    expected = stats.t.ppf(probability, degrees)
    assert student(degrees, probability) == pytest.approx(expected, rel=tolerance)


READING = """
import sys
from imu_bench import bench, drivers
from imu_bench.acquisition import Acquisition
from imu_bench.bus.clock import SystemClock
from imu_bench.acquisition.streams import CountedStream
from imu_bench.samples import Samples
import numpy as np
for name in drivers.names():
    drivers.load(name)
stream = CountedStream(100.0)
for k in range(1, 300):
    stream.push(Samples([k * 10_000_000], temperature=[20.0]))
assert stream.model.rate().observable and stream.meter.jitter().observable
unwanted = 'scipy', 'smbus2', 'serial', 'rosbags', 'imu_bench.simulation'
print([name for name in unwanted if name in sys.modules])
"""


def test_a_process_that_reads_a_sensor_holds_no_scipy():
    done = subprocess.run([sys.executable, '-c', READING], capture_output=True, text=True)
    assert done.stdout.strip() == '[]', done.stdout + done.stderr
