# SPDX-License-Identifier: Apache-2.0
"""Figures are what Bokeh would have made of them."""

from dataclasses import replace
import re
from types import SimpleNamespace

from bokeh.models import Column, GlyphRenderer, HoverTool
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.presentation import analysis_figures as figures
from imu_bench.offline.presentation import page_figures
from imu_bench.offline.presentation.bokeh_models import columns, document, glyph, Model
from imu_bench.offline.presentation.figure import (
    AXIS_COLOURS,
    coloured,
    Figure,
    Image,
    SENSOR_COLOURS,
    Series,
    series_colours,
)
from imu_bench.samples import Samples
import numpy as np
import pytest


@pytest.fixture(scope='module')
def result(recorded):
    rng = np.random.default_rng(7)
    n = 12_000
    stamps = np.arange(n) * 10_000_000 + rng.integers(0, 100_000, n)
    gyro = rng.normal(0.0, 1e-3, (n, 3))
    gyro[:, 0] += 0.02 * np.sin(2 * np.pi * 12.5 * np.arange(n) / 100.0)
    gyro[6000:6500, 2] += 0.3
    return analyse(recorded(Samples(stamps, angular_velocity=gyro)))


def drawn(figure):
    """Return a figure as the page has it."""
    return page_figures.draw(figure, coloured([figure])[0])


@pytest.fixture(scope='module')
def axes(result):
    return result.of('angular_velocity')


@pytest.mark.slow
@pytest.mark.parametrize(
    ('draw', 'kinds'),
    [
        (figures.allan, {'VArea', 'Line', 'Scatter', 'Text'}),
        (figures.spectrum, {'Line', 'Scatter', 'Text'}),
        (figures.histogram, {'Quad', 'Line'}),
    ],
)
def test_figures_of_axes(axes, read_by_bokeh, draw, kinds):
    figure = read_by_bokeh(drawn(draw(axes, 'Signal')))
    assert {type(one.glyph).__name__ for one in figure.renderers} == kinds
    _columns_are_there(figure.renderers)


def test_strips_share_their_time(axes, result, read_by_bokeh):
    column = read_by_bokeh(drawn(figures.time_series(axes, result, 'Signal')))
    assert isinstance(column, Column)
    assert len({strip.x_range.id for strip in column.children}) == 1
    assert [strip.xaxis[0].visible for strip in column.children] == [False, False, True]
    shades = column.children[0].center[2:]
    assert [0 < shade.left < shade.right <= 120 for shade in shades] == [True]


def test_figures_of_a_recording(axes, result, read_by_bokeh):
    _columns_are_there(read_by_bokeh(drawn(figures.intervals(result))).renderers)
    changing = drawn(figures.noise_over_time(axes, result, 'Signal'))
    _columns_are_there(read_by_bokeh(changing).renderers)


def test_figures_of_several(result, read_by_bokeh):
    other = replace(result, topic='/other')
    arguments = ([result, other], ['one', 'other'], 'angular_velocity')
    described = dict(figures.of_all(*arguments))
    assert list(described) == ['allan', 'spectrum']
    for figure in described.values():
        found = read_by_bokeh(drawn(figure))
        assert [item.label.value for item in found.legend[0].items] == ['one', 'other']
        _columns_are_there(found.renderers)


def test_small_figures_of_each_axis_show_every_sensor_on_the_same_scale(result, read_by_bokeh):
    recordings = [result, replace(result, topic='/other')]
    together = dict(figures.of_all(recordings, ['one', 'other'], 'angular_velocity'))['allan']
    small = figures.of_each_axis(together)
    assert [figure.title for figure in small] == ['x', 'y', 'z']
    for figure, axis in zip(small, recordings[0].of('angular_velocity'), strict=True):
        assert [series.name for series in figure.series] == ['one', 'other']
        factor = figure.series[0].y / axis.allan.deviation
        assert factor == pytest.approx(factor[0])
        found = read_by_bokeh(drawn(figure))
        assert not found.legend and (found.y_range.start, found.y_range.end) == together.view
        assert all(renderer.visible for renderer in found.renderers)
        _columns_are_there(found.renderers)


def test_figures_of_plans(read_by_bokeh):
    x = np.arange(3.0)
    kinds = ('line', 'step', 'points', 'bars')
    series = tuple(Series(kind, x, x, kind=kind, low=x - 1, high=x + 1) for kind in kinds)
    found = read_by_bokeh(
        page_figures.draw(
            Figure('all', 'sensor', 'level in mg', series, categories=('a', 'b', 'c')),
            SENSOR_COLOURS[:4],
        )
    )
    _columns_are_there(found.renderers)
    assert found.xaxis[0].major_label_overrides == {0: 'a', 1: 'b', 2: 'c'}
    tips = [dict(tool.tooltips) for tool in found.toolbar.tools if isinstance(tool, HoverTool)]
    assert len(tips) == len(kinds)
    assert all(tip['level in mg'] == '@y{%.5g}' and tip['sensor'] == '@category' for tip in tips)
    image = Image(np.array([[1.0, np.nan], [2.0, 3.0]]), (0.0, 1.0), (0.0, 2.0), 'level')
    found = read_by_bokeh(page_figures.draw(Figure('map', 'x', 'y', (), image=image), ()))
    _columns_are_there(found.renderers)
    assert found.right[0].color_mapper is found.renderers[0].glyph.color_mapper


def test_a_long_line_of_a_plan_can_be_pointed_at(read_by_bokeh):
    x = np.arange(1000.0)
    figure = Figure('long', 'time in s', 'speed in m/s', (Series('a', x, x),))
    found = read_by_bokeh(page_figures.draw(figure, ['#123456']))
    (tool,) = [tool for tool in found.toolbar.tools if isinstance(tool, HoverTool)]
    assert tool.formatters == {'@x': 'printf', '@y': 'printf'}
    assert [renderer.glyph.line_color for renderer in tool.renderers] == ['#123456']


def test_every_number_under_the_pointer_is_formatted_and_has_a_unit(axes, result, read_by_bokeh):
    for figure in (
        figures.allan(axes, 'Signal'),
        figures.spectrum(axes, 'Signal'),
        figures.histogram(axes, 'Signal'),
        figures.intervals(result),
    ):
        found = read_by_bokeh(drawn(figure))
        tools = [tool for tool in found.toolbar.tools if isinstance(tool, HoverTool)]
        assert tools
        for tool in tools:
            for name, shown in tool.tooltips:
                assert '{' not in shown or re.search(r' in (%|\S+)|%', name), (name, shown)
            fields = set(re.findall(r'@\w+(?=\{%)', ' '.join(text for _, text in tool.tooltips)))
            assert fields == set(tool.formatters)


def test_a_sensor_has_one_colour_on_a_page():
    first, second, letters, mixed = series_colours(
        [['a', 'b', 'c'], ['c z', 'b z'], ['z', 'x set', 'x'], ['a x', 'a y']]
    )
    assert second == [first[2], first[1]]
    assert letters == [AXIS_COLOURS['z'], AXIS_COLOURS['x'], AXIS_COLOURS['x']]
    assert len(set(mixed)) == 2


def test_numbers_are_in_single_precision(read_by_bokeh):
    line = Series('line', np.array([1.0, 2.0]), np.array([0.1, np.nan]), words=('a', 'b'))
    data = read_by_bokeh(drawn(Figure('', 'x', 'y', (line,)))).renderers[0].data_source.data
    assert data['y'].dtype == np.float32
    assert data['words'] == ['a', 'b']
    assert np.isnan(data['y'][1])


@pytest.mark.parametrize(
    'wrong',
    [Model('NoSuchModel'), Model('Line', no_such_setting=1), Model('LinearAxis', axis_label=3.5)],
)
def test_bokeh_would_complain(read_by_bokeh, wrong):
    with pytest.raises(
        (Exception, AssertionError), match=r'NoSuchModel|no_such_setting|axis_label'
    ):
        read_by_bokeh(wrong)


def test_a_model_used_twice_is_one():
    shared = columns(x=[1.0])
    first = SimpleNamespace(renderer=Model('GlyphRenderer', data_source=shared))
    root = Model('Figure', renderers=[first.renderer, Model('GlyphRenderer', data_source=shared)])
    one, other = document(root, 'p')[1][0]['attributes']['renderers']
    assert other['attributes']['data_source'] == {'id': one['attributes']['data_source']['id']}
    assert glyph('Quad', {'left': 'x'}, bottom=0).settings['bottom'].value == 0


def _columns_are_there(renderers):
    for renderer in renderers:
        assert isinstance(renderer, GlyphRenderer)
        named = renderer.glyph.properties_with_values(include_defaults=True).values()
        fields = {value.field for value in named if hasattr(value, 'field')} | {
            value['field'] for value in named if isinstance(value, dict) and 'field' in value
        }
        assert fields
        assert fields <= set(renderer.data_source.data)
