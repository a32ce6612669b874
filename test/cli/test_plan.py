# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze --plan`: what it prints and writes, and bad input in one line."""

import json

import numpy as np
import pytest


@pytest.mark.slow
@pytest.mark.usefixtures('only_svg')
def test_static_in_the_terminal_and_in_files(imu_bench, write_csv, tmp_path):
    document, page, figures = tmp_path / 'p.json', tmp_path / 'p.html', tmp_path / 'figures'
    code, out, err = imu_bench(
        'analyze', '--plan', 'static', write_csv(), '--json', document, '--html', page,
        '--figures', figures,
    )  # fmt: skip
    assert (code, err) == (0, '')
    table = 'stationary data (Shabulinzenze 2020, table 5.1)'
    assert out.index('Static comparison') < out.index(table)
    found = json.loads(document.read_text(encoding='utf-8'))
    assert found['schema'] == 'imu_bench.plan/1'
    assert found['plan'] == 'static'
    assert 'table 5.2' in page.read_text(encoding='utf-8')
    assert list(figures.glob('*.svg'))


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (('--plan', 'statics'), '--plan statics: did you mean static?'),
        (('--plan', 'static', '--set', 'x'), '--set x: write it as NAME=VALUE'),
        (('--plan', 'static', '--set', 'x=1'), 'plan static has no such setting'),
        (('--plan', 'static', '--set', 'bandwidth=1 m'), "'m'"),
        (('--plan', 'static', '--reference', 'me'), '--reference me: not among the sensors'),
    ],
)
def test_bad_input_is_one_line(imu_bench, write_csv, arguments, text):
    code, _, err = imu_bench('analyze', *arguments, write_csv())
    assert code == 1
    assert len(err.splitlines()) == 1
    assert text in err


def test_a_recording_that_fails_is_one_line(imu_bench, write_csv):
    code, _, err = imu_bench('analyze', '--plan', 'inclination', write_csv())
    assert code == 1
    assert len(err.splitlines()) == 1


@pytest.fixture
def two_streams(tmp_path):
    """Return files of an accelerometer and of a gyroscope whose names do not say so."""
    files, rng = [], np.random.default_rng(7)
    for name, quantity in (('left', 'linear_acceleration'), ('right', 'angular_velocity')):
        table = np.column_stack([np.arange(3000) / 100, rng.normal(size=(3000, 3))])
        header = 'stamp_s,' + ','.join(f'{quantity}.{axis}' for axis in 'xyz')
        files.append(tmp_path / f'{name}.csv')
        np.savetxt(files[-1], table, delimiter=',', header=header, comments='')
    return files


@pytest.mark.slow
def test_a_named_pair_is_one_sensor_of_the_plan(imu_bench, two_streams, tmp_path):
    sensors = {}
    for name, given in (('alone', ()), ('paired', ('--pair', 'left.csv', 'right.csv'))):
        document = tmp_path / f'{name}.json'
        code, _, err = imu_bench(
            'analyze', *two_streams, '--plan', 'static', *given, '--json', document
        )
        assert (code, err) == (0, '')
        sensors[name] = list(json.loads(document.read_text(encoding='utf-8'))['values'])
    assert [len(found) for found in sensors.values()] == [2, 1]


@pytest.mark.parametrize(
    ('plan', 'pair', 'text'),
    [
        ('static', ('left.csv', 'middle.csv'), "no stream is called 'middle.csv'"),
        ('inclination', ('left.csv', 'right.csv'), 'plan inclination measures every stream by'),
    ],
)
def test_a_pair_that_cannot_be_is_one_line(imu_bench, two_streams, plan, pair, text):
    code, _, err = imu_bench('analyze', *two_streams, '--plan', plan, '--pair', *pair)
    assert (code, len(err.splitlines())) == (1, 1)
    assert text in err


LOUDEST = '''
"""Which axis is the loudest."""

import numpy as np

from imu_bench.offline.plans.plan import NoisePlan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Column, Table


class Loudest(NoisePlan):
    name = 'loudest'
    title = 'The loudest axis'

    def conclude(self, measured):
        axes = [axis for recording in measured for axis in recording.axes.values()]
        rows = tuple((axis.name, axis.statistics['std']) for axis in axes)
        sizes = np.array([axis.statistics['std'].value for axis in axes])
        bars = Series('σ', np.arange(len(axes)), sizes, kind='bars')
        return PlanResult(
            self.name, self.title, (f'Of {len(axes)} axes.',),
            (Table('All axes', (Column('axis'), Column('σ')), rows),),
            (Figure('All', 'axis', 'σ in SI', (bars,), categories=tuple(r[0] for r in rows)),),
        )
'''


def test_a_new_plan_is_one_folder(imu_bench, write_csv, tmp_path, monkeypatch, figures_in):
    """It is found, run, shown in the terminal and on a page, and written."""
    from imu_bench.offline import plans

    folder = tmp_path / 'plans' / 'loudest'
    folder.mkdir(parents=True)
    (folder / '__init__.py').write_text(LOUDEST, encoding='utf-8')
    monkeypatch.setattr(plans, '__path__', [*plans.__path__, str(folder.parent)])
    document, page = tmp_path / 'p.json', tmp_path / 'p.html'
    code, out, err = imu_bench(
        'analyze', write_csv(), '--plan', 'loudest', '--json', document, '--html', page
    )
    assert (code, err) == (0, '')
    assert 'Of 6 axes.' in out
    assert 'linear_acceleration.z' in out
    assert len(json.loads(document.read_text('utf-8'))['tables'][0]['rows']) == 6
    assert len(figures_in(page.read_text('utf-8'))) == 1
