# SPDX-License-Identifier: Apache-2.0
"""What the report says about other methods, drift and change over the recording."""

from dataclasses import replace

from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.offline.analyse import analyse
from imu_bench.offline.report import checks_figures, checks_text
from imu_bench.offline.report.page import render
from imu_bench.offline.results import Analysis
from imu_bench.samples import Samples
import numpy as np
import pytest

RATE_HZ = 20.0


@pytest.fixture(scope='module')
def result(recorded):
    rng = np.random.default_rng(1)
    n = 60_000
    stamps = 1_700_000_000_000_000_000 + np.arange(n) * int(1e9 / RATE_HZ)
    gyro = rng.normal(0.0, 1e-3, (n, 3))
    gyro[:, 0] += Process(3e-4, 15.0).simulate(n, RATE_HZ, rng)
    gyro[n // 2 :, 1] *= 1.5
    return analyse(recorded(Samples(stamps, angular_velocity=gyro)))


@pytest.fixture(scope='module')
def axes(result):
    return result.of('angular_velocity')


def test_other_methods_stand_beside_one_another(axes):
    columns = checks_text.method_columns(axes)
    assert [c.title for c in columns][:2] == ['N, spectrum (Whittle)', 'N, slope tangent']
    assert len(columns) == 6
    assert '±' in columns[0].cells[0].shown
    assert '±' not in columns[1].cells[0].shown


def test_the_drift_is_a_table_and_a_verdict(axes):
    table = checks_text.drift_table(axes)
    names = {row.name for row in table.rows if row.letter == 'x'}
    assert {'autocorrelation', 'fit of the Allan deviation'} <= names
    assert not any(row.letter == 'z' for row in table.rows)
    words = ' '.join(checks_text.drift_words(axes))
    assert 'x: a Kalman filter' in words
    assert 'innovations are white' in words
    assert checks_text.drift_table(axes[2:]) is None


def test_a_change_is_said_and_drawn(axes, result, read_by_bokeh):
    words = checks_text.steadiness_words(axes)
    assert any(line.startswith('y: ') and 'differs by a factor of 1.6' in line for line in words)
    figure = checks_figures.noise_over_time(axes, result)
    read = read_by_bokeh(figure)
    assert read.yaxis[0].axis_label == 'noise in %'
    assert len(read.legend[0].items) == 3


def test_the_tracked_bias_is_drawn_over_its_average(axes, result, read_by_bokeh):
    figure = checks_figures.tracked_bias(axes, result)
    labels = [item.label.value for item in read_by_bokeh(figure).legend[0].items]
    assert labels == ['x', 'average']


def test_residuals_and_distribution(axes):
    assert any('mean squared residual' in line for line in checks_text.fit_words(axes))
    outliers, shape = checks_text.shape_columns(axes)
    assert outliers.cells[2].shown == '0'
    assert shape.cells[2].shown == 'normal'


def test_a_result_of_an_older_version_has_a_page_without_them(result):
    old = {name: replace(axis, checks=None, outliers=None) for name, axis in result.axes.items()}
    page = render(Analysis((replace(result, axes=old),)))
    assert 'Noise density in three ways' in page
    assert 'Coefficients by other methods' not in page
    assert 'Drift as a Gauss-Markov process' not in page
    assert 'Drift as a Gauss-Markov process' in render(Analysis((result,)))


def test_ready_blocks_are_there_for_what_was_measured(result):
    page = render(Analysis((result,)))
    for name in ('sensor_msgs', 'robot_localization', 'gz-sim', 'kalman'):
        assert f'<summary>{name}</summary>' in page
    # no accelerometer: Kalibr wants both
    assert '<summary>kalibr</summary>' not in page
    assert '&lt;dynamic_bias_stddev&gt;' in page
