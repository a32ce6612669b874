# SPDX-License-Identifier: Apache-2.0
"""Figures as files: every format, everything that was measured, whatever a sensor is called."""

from dataclasses import replace
from importlib import util
from xml.etree import ElementTree

from imu_bench.errors import ConfigError
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.presentation import analysis_figures, require_matplotlib
from imu_bench.offline.presentation.figure_files import draw, look, SUFFIXES, write
from imu_bench.offline.whole_files import file_names
import matplotlib as mpl
from matplotlib.text import Text
import numpy as np
import pytest

PARTS = ('allan', 'spectrum', 'time', 'histogram')
QUANTITIES = ('linear_acceleration', 'angular_velocity')


@pytest.fixture(scope='module')
def full(recording_of, noise):
    return analyse(recording_of(noise(1, n=4_000)))


def together(recordings, labels):
    """Return the Allan deviations of all gyroscopes in one figure."""
    return dict(analysis_figures.of_all(recordings, labels, 'angular_velocity'))['allan']


def only(recording, *names, **changes):
    """Return a recording of these axes: drawing takes time, and others go the same way."""
    return replace(recording, axes={name: recording.axes[name] for name in names}, **changes)


@pytest.fixture(scope='module')
def gyro(full):
    return only(full, 'angular_velocity.x', topic='/bench/$evil_$x/imu/data_raw')


@pytest.fixture(scope='module')
def written(full, gyro, tmp_path_factory):
    folder = tmp_path_factory.mktemp('out') / 'figures'
    return folder, write(Analysis((only(full, 'linear_acceleration.z'), gyro)), folder)


@pytest.fixture(scope='module')
def again(gyro, tmp_path_factory):
    """The files of one sensor once more, and the style of the caller before and after."""
    before = dict(mpl.rcParams)
    files = write(Analysis((gyro,)), tmp_path_factory.mktemp('again') / 'figures')
    return files, before, dict(mpl.rcParams)


@pytest.mark.slow
def test_every_figure_in_every_format(written):
    folder, files = written
    names = {f'chip-linear_acceleration-{part}' for part in PARTS}
    names |= {f'evil_x-angular_velocity-{part}' for part in PARTS}
    names |= {f'comparison-{quantity}-{part}' for quantity in QUANTITIES for part in PARTS[:2]}
    expected = {f'{name}.{suffix}' for name in names for suffix in SUFFIXES}
    assert {path.name for path in files} == expected
    assert {path.name for path in folder.iterdir()} == expected


@pytest.mark.slow
def test_the_files_are_what_they_say(written):
    for path in written[1]:
        start = path.read_bytes()[:8]
        if path.suffix == '.png':
            assert start == b'\x89PNG\r\n\x1a\n'
        elif path.suffix == '.pdf':
            assert start.startswith(b'%PDF-')
        else:
            assert ElementTree.parse(path).getroot().tag.endswith('svg')


@pytest.mark.slow
def test_the_same_results_give_the_same_files(written, again):
    folder, files = written[0], again[0]
    assert len(files) == len(PARTS) * len(SUFFIXES)
    for path in files:
        assert path.read_bytes() == (folder / path.name).read_bytes(), path.name


def test_the_allan_figure_holds_the_measured_curve(full):
    axes = full.of('angular_velocity')
    with look():
        ax = draw(analysis_figures.allan(axes, 'Gyroscope')).axes[0]
    curve = next(line for line in ax.get_lines() if line.get_label() == 'x')
    np.testing.assert_allclose(curve.get_xdata(), axes[0].allan.tau)
    ratio = np.asarray(curve.get_ydata()) / axes[0].allan.deviation
    assert np.ptp(ratio) < 1e-9 * ratio[0]
    assert ax.get_xscale() == ax.get_yscale() == 'log'
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ['x', 'y', 'z', 'fit', 'its terms', '95 % interval']
    assert 'm°/s' in ax.get_ylabel()


def test_the_legend_of_all_sensors_has_a_dollar_sign_as_it_is(full):
    with look():
        ax = draw(together([full, full], ['a$b$', 'c'])).axes[0]
        ax.figure.canvas.draw()
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ['a$b$', 'c', 'x', 'y', 'z']


@pytest.mark.slow
def test_the_style_of_the_caller_is_left_alone(again):
    _, before, after = again
    assert after == before


@pytest.mark.slow
def test_letters_can_be_read_in_a_column(full):
    """Of 8 cm and of 16 cm: no letter below 5 points, none above 12; nothing is cut off."""
    with look():
        figure = draw(together([full], ['sensor']))
        figure.canvas.draw()
    width = 2.54 * figure.get_figwidth()
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert texts
    for text in texts:
        assert text.get_fontsize() * 8.0 / width >= 5.0
        assert text.get_fontsize() * 16.0 / width <= 12.5
    box = figure.get_tightbbox()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.get_figwidth()
    assert box.y1 <= figure.get_figheight()


def test_legends_cover_no_data(full):
    with look():
        figures = [
            draw(analysis_figures.allan(full.of(QUANTITIES[1]), 'Gyroscope')),
            draw(analysis_figures.histogram(full.of(QUANTITIES[0]), 'Accelerometer')),
        ]
    for figure in figures:
        figure.canvas.draw()
        ax = figure.axes[0]
        assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1 - 1.0


def test_sensors_and_axes_differ_in_more_than_colour(full):
    with look():
        ax = draw(together([full, full], ['a', 'b'])).axes[0]
        single = draw(analysis_figures.allan(full.of('angular_velocity'), 'Gyroscope')).axes[0]
    looks = {(line.get_marker(), line.get_linestyle()) for line in ax.get_lines()}
    assert len(looks) == 6
    named = [line for line in single.get_lines() if line.get_label() in 'xyz']
    assert len({line.get_marker() for line in named}) == 3


@pytest.mark.slow
def test_an_axis_without_noise_does_not_break_it(full, tmp_path):
    result = only(full, 'linear_acceleration.z', 'angular_velocity.x')
    axes = {
        name: replace(axis, psd=None, histogram=None, envelope=None)
        if name != 'angular_velocity.x'
        else replace(axis, allan=None, histogram=None)
        for name, axis in result.axes.items()
    }
    files = write(Analysis((replace(result, axes=axes),)), tmp_path / 'f')
    assert {path.stem for path in files} == {
        'chip-linear_acceleration-allan',
        'chip-angular_velocity-spectrum',
        'chip-angular_velocity-time',
    }


def test_names_are_unique_and_safe():
    names = file_names(['../../etc/passwd', 'a/b', 'a:b', '', '…', 'comparison', 'comparison'])
    assert len(set(names)) == len(names)
    assert all('/' not in name and not name.startswith('.') for name in names)


def test_without_matplotlib_one_line_says_what_to_do(monkeypatch):
    monkeypatch.setattr(util, 'find_spec', lambda name: None)
    with pytest.raises(ConfigError, match='pip install matplotlib'):
        require_matplotlib()
