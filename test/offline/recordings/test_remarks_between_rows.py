# SPDX-License-Identifier: Apache-2.0
"""Lines between the rows of a text file that are no samples, and a rate that the user gave."""

from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.recordings import load, open_source, ReadOptions
import numpy as np
import pytest

UNITS = 'linear_acceleration=m/s^2'


def read(path):
    options = ReadOptions(rate_hz=5.0, columns='ax,ay,az', units=UNITS)
    source = open_source(path, options)
    return load(source, source.topics[0]), source.problems


def rows(n=400):
    found = np.random.default_rng(1).normal([0.0, 0.0, 9.81], 0.01, (n, 3))
    return [f'{x:.5f},{y:.5f},{z:.5f}' for x, y, z in found]


@pytest.mark.parametrize('remark', ['2021-03-04 12:00:01', '12:00:01,500', 'Thu Mar  4 2021'])
def test_lines_that_alternate_with_a_date_keep_the_rate(tmp_path, remark):
    path = tmp_path / 'log.txt'
    path.write_text(''.join(f'{remark}\n{row}\n' for row in rows()))
    recording, _ = read(path)
    assert len(recording) == 400
    assert np.unique(np.diff(recording.samples.stamps)).tolist() == [200_000_000]
    health = analyse(recording).health
    assert health.missing == 0
    assert health.rate.value == pytest.approx(5.0)


def test_a_damaged_row_is_a_lost_sample(tmp_path):
    path = tmp_path / 'log.txt'
    lines = rows()
    lines[100], lines[200] = '0.1,#,9.8', '0.1,0.2'
    path.write_text('\n'.join(lines) + '\n')
    recording, problems = read(path)
    assert len(recording) == 398 and analyse(recording).health.missing == 2
    assert '2 lines' in problems[0]


def test_a_rate_that_was_typed_has_no_interval(tmp_path):
    path = tmp_path / 'log.txt'
    path.write_text('\n'.join(rows()) + '\n')
    rate = analyse(read(path)[0]).health.rate
    assert rate.value == pytest.approx(5.0) and rate.low is None and rate.high is None
    assert 'given' in rate.method
