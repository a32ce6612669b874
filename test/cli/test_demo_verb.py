# SPDX-License-Identifier: Apache-2.0
"""What a demo says of its bench before it begins."""

from imu_bench.cli.demo import kinds
from imu_bench.config import BenchConfig, SensorConfig
import pytest


@pytest.mark.parametrize(
    ('backends', 'said'),
    [
        (['emulated', 'emulated'], '2 emulated sensors'),
        (['emulated'], '1 emulated sensor'),
        (['recorded', 'emulated', 'emulated'], '3 sensors (1 recorded, 2 emulated)'),
    ],
)
def test_what_stands_behind_the_sensors_is_said(backends, said):
    sensors = tuple(SensorConfig(f's{k}', 'mpu9250', kind) for k, kind in enumerate(backends))
    assert kinds(BenchConfig(name='small', sensors=sensors)) == said
