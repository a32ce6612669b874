# SPDX-License-Identifier: Apache-2.0
"""A gyroscope whose unit was mistaken is told by the noise of its datasheet."""

from dataclasses import replace

from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.running.analyzing import conclude
import numpy as np
import pytest

SHEET = 0.01 * np.pi / 180.0
"""MPU-9250 (PS-MPU-9250A-01 rev. 1.1, table 1): 0.01 °/s/√Hz, one-sided."""


def codes(recording_of, noise, *, factor, topic='/bench/mpu9250/imu/data_raw', move=False):
    samples = noise(3, n=20_000, angular_velocity=factor * SHEET / np.sqrt(2.0))
    if move:
        turned = np.zeros((20_000, 3))
        turned[5000:15_000] = np.sin(np.arange(10_000) / 30.0)[:, None]
        samples = replace(samples, angular_velocity=samples.angular_velocity + turned)
    found = analyse(recording_of(samples, topic=topic))
    concluded = conclude([found], [], Settings())
    return {f.code: f for f in concluded.recordings[0].health.findings}


@pytest.mark.parametrize(
    ('factor', 'said'),
    [
        (1.0, ''),
        (3.0, ''),
        (57.3, '°/s given as rad/s'),
        (2.5 * 57.3, '°/s given as rad/s'),
        (1 / 57.3, 'rad/s given as °/s'),
    ],
)
def test_told_by_the_noise(recording_of, noise, factor, said):
    found = codes(recording_of, noise, factor=factor)
    assert ('angle_unit' in found) == bool(said)
    if said:
        assert said in found['angle_unit'].text
        assert found['angle_unit'].severity == 'severe'


@pytest.mark.slow
def test_not_judged_without_a_datasheet_or_on_the_move(recording_of, noise):
    assert 'angle_unit' not in codes(recording_of, noise, factor=57.3, topic='/bench/x/imu/data')
    moved = codes(recording_of, noise, factor=57.3, move=True)
    assert 'motion' in moved and 'angle_unit' not in moved
