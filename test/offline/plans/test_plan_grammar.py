# SPDX-License-Identifier: Apache-2.0
"""Test plans: found by their file, settings refused by name, results shown everywhere alike."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from imu_bench.config.schema import REQUIRED, Setting
from imu_bench.errors import ConfigError, DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline import plan_runs, plans
from imu_bench.offline.figure_files.plan import write as write_figures
from imu_bench.offline.pipeline import Order
from imu_bench.offline.plans import shown
from imu_bench.offline.plans.plan import AnyPlan, Plan
from imu_bench.offline.plans.result import Column, Image, PlanFigure, PlanResult, Series, Table
from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.report.plan_page import render
from imu_bench.offline.settings import Settings
from imu_bench.offline.workers import Processes
import numpy as np
import pytest

ANGLE = Estimate(0.01, 0.009, 0.011, 'rad')


class Counting(Plan[int]):
    """Counts samples, and wants at least as many as asked."""

    name = 'counting'
    title = 'Counting'
    SETTINGS = (
        Setting('least', 1, 'Fewest samples.', bounds=(1, 10**9)),
        Setting('window', None, 'Not needed.', unit='s', kind='quantity'),
    )

    def measure(self, source: str, recordings: Sequence) -> int:
        found = sum(map(len, recordings))
        if found < self.settings['least']:
            raise RecordingError(f'{found} samples, not {self.settings["least"]}')
        return found

    def conclude(self, measured: Sequence[int]) -> PlanResult:
        rows = tuple((f'run {k}', n) for k, n in enumerate(measured))
        table = Table('Counts', (Column('run'), Column('samples')), rows)
        return PlanResult(self.name, self.title, (f'{len(rows)} runs.',), (table,))


def order():
    return Order(ReadOptions(), Settings())


def csv(path: Path, n: int) -> Path:
    lines = ['t,ax,ay,az'] + [f'{k / 100},0.{k % 7},0.1,9.8' for k in range(n)]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return path


def options():
    return ReadOptions(columns='stamp,ax,ay,az', units='stamp=s,linear_acceleration=m/s²')


def test_every_plan_names_itself_and_says_what_it_is():
    for name in plans.names():
        kind = plans.load(name)
        assert issubclass(kind, AnyPlan)
        assert kind.name == name
        assert kind.title
        assert all(setting.description for setting in kind.SETTINGS)


def test_an_unknown_plan_is_refused_with_those_there_are():
    with pytest.raises(ConfigError, match='did you mean static'):
        plans.load('statc')


@pytest.mark.parametrize(
    ('given', 'text'),
    [
        ({'lest': '1'}, '--set lest: plan counting has no such setting; it has: least, window'),
        ({'least': 'many'}, "--set least: 'many' is not"),
        ({'least': '0'}, '--set least: 0 is not allowed'),
        ({'window': '3'}, '--set window: '),
        ({'window': '3 kg'}, "unknown unit 'kg'"),
    ],
)
def test_a_setting_that_is_not_allowed_is_refused_by_name(given, text):
    with pytest.raises(ConfigError) as caught:
        Counting(given)
    assert text in str(caught.value)


def test_settings_are_read_in_their_units():
    plan = Counting({'window': '2 min', 'least': '5'})
    assert plan.settings == {'least': 5, 'window': (120.0,)}
    assert plan.stated()['window'] == {'value': 120.0, 'unit': 's'}


def test_a_setting_that_must_be_given_is_asked_for():
    class Asking(Counting):
        SETTINGS = (Setting('angles', REQUIRED, 'Angles that were set.', allowed=()),)

    with pytest.raises(ConfigError, match='needs --set angles=…: Angles that were set'):
        Asking()


class TestRuns:
    def test_one_bad_recording_does_not_stop_the_others(self, tmp_path):
        paths = [csv(tmp_path / f'{n}.csv', n) for n in (300, 20, 400)]
        told = []
        job = plan_runs.Job(paths, Order(options(), Settings()), failed=told.append)
        result = plan_runs.run(Counting({'least': '100'}), job)
        assert [row[1] for row in result.tables[0].rows] == [300, 400]
        assert [Path(failure.source).name for failure in result.failures] == ['20.csv']
        assert told == list(result.failures)
        assert '20 samples, not 100' in told[0].error
        assert result.settings['least'] == 100

    def test_nothing_measured_is_an_error(self, tmp_path):
        job = plan_runs.Job([csv(tmp_path / 'a.csv', 5)], Order(options(), Settings()))
        with pytest.raises(RecordingError, match='none of the recordings could be measured'):
            plan_runs.run(Counting({'least': '100'}), job)

    def test_processes_give_the_same_in_the_same_order(self, tmp_path):
        paths = [csv(tmp_path / f'{n}.csv', n) for n in (900, 100, 500)]
        here = plan_runs.run(Counting(), plan_runs.Job(paths, Order(options(), Settings())))
        with Processes(2) as team:
            job = plan_runs.Job(paths, Order(options(), Settings()), team)
            # a class of a test file cannot be sent to a process: plans of the package can
            plan = plans.load('static')()
            there = plan_runs.run(plan, job)
        assert [row[1] for row in here.tables[0].rows] == [900, 100, 500]
        assert list(there.values) == ['900', '100', '500']


class TestResult:
    table = Table(
        'Angles <b>', (Column('step'), Column('angle', '°'), Column('verdict')),
        ((1, ANGLE, 'fine'), (2, None, ''), (3, Estimate.not_observable('rad', 'too short'), 'x')),
        'A note.',
    )  # fmt: skip
    figures = (
        PlanFigure(
            'Bars', 'condition', 'RR in dB',
            (
                Series('x', np.arange(2.0), np.array([1.0, 2.0]), np.array([0.5, 1.5]),
                       np.array([1.5, 2.5]), 'bars'),
                Series('y', np.arange(2.0), np.array([2.0, 1.0]), kind='bars'),
            ),
            categories=('SC1', 'SC2'),
        ),
        PlanFigure(
            'Spectrogram', 'time in s', 'frequency in Hz',
            image=Image(np.arange(6.0).reshape(2, 3), (0.0, 3.0), (0.0, 2.0), 'dB'),
        ),
        PlanFigure(
            'Lines', 'time in s', 'angle in °',
            (
                Series('set', np.arange(3.0), np.arange(3.0), kind='step', dashed=True),
                Series('measured', np.arange(3.0), np.arange(3.0), np.zeros(3), np.full(3, 3.0)),
                Series('dots', np.arange(3.0), np.arange(3.0), np.zeros(3), np.full(3, 3.0),
                       'points'),
            ),
        ),
    )  # fmt: skip
    result = PlanResult('tilt', 'Tilt', ('It <i>holds</i>.',), (table,), figures)

    def test_a_row_of_another_length_or_a_nan_is_refused(self):
        with pytest.raises(DataError, match='a row of 1 cells, not 2'):
            Table('T', (Column('a'), Column('b')), ((1,),))
        with pytest.raises(DataError, match='cannot hold nan'):
            Table('T', (Column('a'),), ((float('nan'),),))

    def test_cells_are_in_the_unit_of_their_column(self):
        rows = shown.cells(self.table)
        assert [cell.text for cell in rows[0]] == ['1', '0.573 ± 0.057', 'fine']
        assert [cell.text for cell in rows[2]] == ['3', '–', 'x']
        assert rows[2][1].note == 'too short'
        assert shown.words(self.table) == [True, False, True]

    def test_the_page_escapes_and_holds_every_figure(self):
        page = render(self.result)
        assert 'Angles &lt;b&gt;' in page
        assert 'It &lt;i&gt;holds&lt;/i&gt;.' in page
        assert page.count('<script type="application/json" class="figure">') == 3
        assert 'http://' not in page.split('<script>')[0]

    def test_settings_stand_in_units_that_people_use(self):
        turn = {'value': 2.0 * np.pi, 'unit': 'rad'}
        page = render(replace(self.result, settings={'turn': turn, 'axis': 'x', 'none': None}))
        assert '<dt>turn</dt><dd>360 °</dd>' in page
        assert '<dt>axis</dt><dd>x</dd>' in page
        assert '<dt>none</dt>' not in page

    def test_figures_are_written_in_three_formats(self, tmp_path):
        files = write_figures(self.result, tmp_path / 'f')
        assert sorted(file.name for file in files)[0] == 'tilt-Bars.pdf'
        assert len(files) == 9
        assert all(file.stat().st_size > 2000 for file in files)

    def test_the_document_keeps_estimates(self):
        document = self.result.to_json()
        assert document['schema'] == 'imu_bench.plan/1'
        assert document['tables'][0]['rows'][0][1] == ANGLE.to_json()
