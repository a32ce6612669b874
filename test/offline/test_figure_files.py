# SPDX-License-Identifier: Apache-2.0
"""Figures as files: every format, everything that was measured, whatever a sensor is called."""

from dataclasses import replace
from importlib import util
from xml.etree import ElementTree

from imu_bench.errors import ConfigError
from imu_bench.offline import figure_files
from imu_bench.offline.analyse import analyse
from imu_bench.offline.figure_files import draw
from imu_bench.offline.figure_files.style import file_names, look, SUFFIXES
from imu_bench.offline.figure_files.write import write
from imu_bench.offline.results import Analysis
import matplotlib as mpl
import numpy as np
import pytest

PARTS = ('allan', 'spectrum', 'time', 'histogram')
QUANTITIES = ('linear_acceleration', 'angular_velocity')


@pytest.fixture(scope='module')
def result(recording_of, noise):
    return analyse(recording_of(noise(1, n=20_000)))


@pytest.fixture(scope='module')
def written(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp('out') / 'figures'
    other = replace(result, topic='/bench/$evil_$x/imu/data_raw')
    return folder, write(Analysis((result, other)), folder)


def test_every_figure_in_every_format(written):
    folder, files = written
    names = {f'{sensor}-{quantity}-{part}' for sensor in ('chip', 'evil_x')
             for quantity in QUANTITIES for part in PARTS}  # fmt: skip
    names |= {f'comparison-{quantity}-{part}' for quantity in QUANTITIES for part in PARTS[:2]}
    expected = {f'{name}.{suffix}' for name in names for suffix in SUFFIXES}
    assert {path.name for path in files} == expected
    assert {path.name for path in folder.iterdir()} == expected


def test_the_files_are_what_they_say(written):
    for path in written[1]:
        start = path.read_bytes()[:8]
        if path.suffix == '.png':
            assert start == b'\x89PNG\r\n\x1a\n'
        elif path.suffix == '.pdf':
            assert start.startswith(b'%PDF-')
        else:
            assert ElementTree.parse(path).getroot().tag.endswith('svg')


def test_the_same_results_give_the_same_files(result, tmp_path):
    first = write(Analysis((result,)), tmp_path / 'a')
    second = write(Analysis((result,)), tmp_path / 'b')
    for one, two in zip(first, second, strict=True):
        assert one.read_bytes() == two.read_bytes(), one.name


def test_the_allan_figure_holds_the_measured_curve(result):
    axes = result.of('angular_velocity')
    with look():
        ax = draw.allan(axes).axes[0]
    curve = next(line for line in ax.get_lines() if line.get_label() == 'x')
    np.testing.assert_allclose(curve.get_xdata(), axes[0].allan.tau)
    ratio = np.asarray(curve.get_ydata()) / axes[0].allan.deviation
    assert np.ptp(ratio) < 1e-9 * ratio[0]
    assert ax.get_xscale() == ax.get_yscale() == 'log'
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ['x', 'y', 'z', '95 % interval', 'fit', 'its terms']
    assert 'm°/s' in ax.get_ylabel()


def test_the_legend_of_all_sensors_has_a_dollar_sign_as_it_is(result):
    with look():
        ax = draw.compare_allan([result, result], ['a$b$', 'c'], 'angular_velocity').axes[0]
        ax.figure.canvas.draw()
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ['a$b$', 'c', 'x', 'y', 'z']


def test_the_style_of_the_caller_is_left_alone(result, tmp_path):
    before = dict(mpl.rcParams)
    write(Analysis((result,)), tmp_path / 'f')
    assert dict(mpl.rcParams) == before


def test_an_axis_without_noise_does_not_break_it(result, tmp_path):
    axes = {
        name: replace(axis, psd=None, histogram=None, envelope=None)
        if name != 'angular_velocity.z'
        else replace(axis, allan=None)
        for name, axis in result.axes.items()
    }
    files = write(Analysis((replace(result, axes=axes),)), tmp_path / 'f')
    assert {path.stem for path in files if 'linear' in path.stem} == {
        'chip-linear_acceleration-allan'
    }


def test_names_are_unique_and_safe():
    names = file_names(['../../etc/passwd', 'a/b', 'a:b', '', '…', 'comparison', 'comparison'])
    assert len(set(names)) == len(names)
    assert all('/' not in name and not name.startswith('.') for name in names)


def test_without_matplotlib_one_line_says_what_to_do(monkeypatch):
    monkeypatch.setattr(util, 'find_spec', lambda name: None)
    with pytest.raises(ConfigError, match='pip install matplotlib'):
        figure_files.require()
