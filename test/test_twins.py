# SPDX-License-Identifier: Apache-2.0
"""Two sensors from one shipped file are two sensors."""

from pathlib import Path

from imu_bench import bench
import pytest

FILES = sorted((Path(__file__).resolve().parent.parent / 'config' / 'sensors').glob('*.yaml'))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_each_has_a_frame_of_its_own(path):
    left, right = (bench.load_sensor(path, name=name) for name in ('left', 'right'))
    assert (left.frame_id, right.frame_id) == ('left_link', 'right_link')
