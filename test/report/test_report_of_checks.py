# SPDX-License-Identifier: Apache-2.0
"""What the report says about other methods, drift and change over the recording."""

from dataclasses import replace

from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.offline.analysis.checks import Checks
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.presentation import analysis_figures, axis_tables, sentences
from imu_bench.offline.presentation.figure import coloured
from imu_bench.offline.presentation.page_figures import draw
from imu_bench.offline.presentation.pages import render_report as render
from imu_bench.offline.presentation.tables import cells
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
    table = axis_tables.other_methods(axes)
    titles = [column.title for column in table.columns]
    assert titles[1:3] == ['N, spectrum (Whittle)', 'N, slope tangent']
    assert len(titles) == 1 + 6
    assert '±' in cells(table)[0][1].text
    assert '±' not in cells(table)[0][2].text


def test_the_drift_is_a_table_and_a_verdict(axes):
    rows = cells(axis_tables.drift(axes))
    names = {row[1].text for row in rows if row[0].text == 'x'}
    assert {'autocorrelation', 'fit of the Allan deviation'} <= names
    assert not any(row[0].text == 'z' for row in rows)
    words = ' '.join(sentences.tracking(axes))
    assert 'x: a Kalman filter' in words
    assert 'innovations are white' in words
    assert axis_tables.drift(axes[2:]) is None


def test_a_change_is_said_and_drawn(axes, result, read_by_bokeh):
    words = sentences.steadiness(axes)
    assert any(line.startswith('y: ') and 'differs by a factor of 1.6' in line for line in words)
    figure = analysis_figures.noise_over_time(axes, result, 'Signal')
    read = read_by_bokeh(draw(figure, coloured([figure])[0]))
    assert read.yaxis[0].axis_label == 'noise in %'
    assert len(read.legend[0].items) == 3


def test_the_tracked_bias_is_drawn_over_its_average(axes, result, read_by_bokeh):
    figure = analysis_figures.tracked_bias(axes, result, 'Signal')
    read = read_by_bokeh(draw(figure, coloured([figure])[0]))
    assert [item.label.value for item in read.legend[0].items] == ['average', 'x']


def test_residuals_and_distribution(axes, result):
    assert any('mean squared residual' in line for line in sentences.fits(axes))
    table = axis_tables.statistics(axes, result.health)
    assert [column.title for column in table.columns[-2:]] == ['Outliers', 'Distribution']
    assert [cell.text for cell in cells(table)[2][-2:]] == ['0', 'normal']


def test_a_result_of_an_older_version_has_a_page_without_them(result):
    old = {
        name: replace(axis, checks=Checks(), outliers=None) for name, axis in result.axes.items()
    }
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
