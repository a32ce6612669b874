# SPDX-License-Identifier: Apache-2.0
"""Test plans: found by their file, settings refused by name, results shown everywhere alike."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from imu_bench.config.schema import REQUIRED, Setting
from imu_bench.errors import ConfigError, DataError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline import plans
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.plans import recorded
from imu_bench.offline.plans.plan import AnyPlan, Plan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation import tables
from imu_bench.offline.presentation.figure import Figure, Image, Series
from imu_bench.offline.presentation.figure_files import write_plan as write_figures
from imu_bench.offline.presentation.pages import render_plan as render
from imu_bench.offline.presentation.tables import Column, Table
from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.running import plan_runs
from imu_bench.offline.running.pipeline import Order
from imu_bench.offline.running.workers import Processes
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


def csv(path: Path, n: int, moved: float = 0.0) -> Path:
    """Write noise, with a push of so many m/s² in the middle."""
    rows = np.empty((n, 4))
    rows[:, 0] = np.arange(n) / 100
    rows[:, 1:] = np.random.default_rng(n).normal([0.3, 0.1, 9.8], 0.02, (n, 3))
    rows[n // 3 : n // 2, 1] += moved
    np.savetxt(path, rows, fmt='%.6f', delimiter=',', header='t,ax,ay,az', comments='')
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
    def test_when_how_long_and_how_well_is_said(self, tmp_path):
        paths = [csv(tmp_path / f'{n}.csv', n) for n in (300, 601)]
        lines = paths[1].read_text(encoding='utf-8').splitlines()
        paths[1].write_text('\n'.join([*lines[:200], *lines[260:], '']), encoding='utf-8')
        job = plan_runs.Job(paths, Order(options(), Settings()))
        result = plan_runs.run_plan(Counting(), job)
        assert [round(each.duration_s, 6) for each in result.recorded] == [2.99, 6.0]
        assert [each.missing for each in result.recorded] == [0, 60]
        assert [f.code for f in result.findings if f.severity != 'info'] == ['gaps']
        said = recorded.sentence(result.recorded)
        assert said == (
            '2 streams of 2 recordings, 2.99 s to 6.00 s each; health: 1 with a severe finding.'
        )
        page = render(replace(result, document='A. Book, 1999')).replace('\u00a0', ' ')
        assert said in page
        assert 'After A. Book, 1999.' in page
        assert result.to_json()['recorded'][1]['severity'] == 'severe'

    def test_a_motion_that_the_test_brings_is_no_doubt(self, tmp_path):
        path = csv(tmp_path / 'moved.csv', 600, moved=4.0)
        result = plan_runs.run_plan(
            Counting(), plan_runs.Job([path], Order(options(), Settings()))
        )
        assert [f for f in result.findings if f.severity != 'info'] == []
        noise = plan_runs.run_plan(
            plans.load('static')(), plan_runs.Job([path], Order(options(), Settings()))
        )
        assert 'motion' in [f.code for f in noise.findings]

    def test_one_bad_recording_does_not_stop_the_others(self, tmp_path):
        paths = [csv(tmp_path / f'{n}.csv', n) for n in (300, 20, 400)]
        told = []
        job = plan_runs.Job(paths, Order(options(), Settings()), failed=told.append)
        result = plan_runs.run_plan(Counting({'least': '100'}), job)
        assert [row[1] for row in result.tables[0].rows] == [300, 400]
        assert [Path(failure.source).name for failure in result.failures] == ['20.csv']
        assert told == list(result.failures)
        assert '20 samples, not 100' in told[0].error
        assert result.settings['least'] == 100

    def test_nothing_measured_is_an_error(self, tmp_path):
        job = plan_runs.Job([csv(tmp_path / 'a.csv', 5)], Order(options(), Settings()))
        with pytest.raises(RecordingError, match='none of the recordings could be measured'):
            plan_runs.run_plan(Counting({'least': '100'}), job)

    def test_processes_give_the_same_in_the_same_order(self, tmp_path):
        paths = [csv(tmp_path / f'{n}.csv', n) for n in (900, 100, 500)]
        here = plan_runs.run_plan(Counting(), plan_runs.Job(paths, Order(options(), Settings())))
        with Processes(2) as team:
            job = plan_runs.Job(paths, Order(options(), Settings()), team)
            # a class of a test file cannot be sent to a process: plans of the package can
            plan = plans.load('static')()
            there = plan_runs.run_plan(plan, job)
        assert [row[1] for row in here.tables[0].rows] == [900, 100, 500]
        assert list(there.values) == ['900', '100', '500']


class TestResult:
    table = Table(
        'Angles <b>', (Column('step'), Column('angle', '°'), Column('verdict')),
        ((1, ANGLE, 'fine'), (2, None, ''), (3, Estimate.not_observable('rad', 'too short'), 'x')),
        'A note.',
    )  # fmt: skip
    figures = (
        Figure(
            'Bars', 'condition', 'RR in dB',
            (
                Series('x', np.arange(2.0), np.array([1.0, 2.0]), np.array([0.5, 1.5]),
                       np.array([1.5, 2.5]), 'bars'),
                Series('y', np.arange(2.0), np.array([2.0, 1.0]), kind='bars'),
            ),
            categories=('SC1', 'SC2'),
        ),
        Figure(
            'Spectrogram', 'time in s', 'frequency in Hz',
            image=Image(np.arange(6.0).reshape(2, 3), (0.0, 3.0), (0.0, 2.0), 'dB'),
        ),
        Figure(
            'Lines', 'time in s', 'angle in °',
            (
                Series('set', np.arange(3.0), np.arange(3.0), kind='step', dash='dashed'),
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
        rows = tables.cells(self.table)
        assert [cell.text for cell in rows[0]] == ['1', '0.573 ± 0.057', 'fine']
        assert [cell.text for cell in rows[2]] == ['3', '–', 'x']
        assert rows[2][1].note == 'too short'
        assert tables.words(self.table) == [True, False, True]

    def test_the_page_escapes_and_holds_every_figure(self, figures_in):
        page = render(self.result)
        assert 'Angles &lt;b&gt;' in page
        assert 'It &lt;i&gt;holds&lt;/i&gt;.' in page
        assert len(figures_in(page)) == 3
        assert 'http://' not in page.split('<script>')[0]

    def test_settings_stand_in_units_that_people_use(self):
        turn = {'value': 2.0 * np.pi, 'unit': 'rad'}
        density = {'value': [0.961704], 'unit': '(m/s²)²/Hz'}
        settings = {'turn': turn, 'density': density, 'axis': 'x', 'none': None}
        page = render(replace(self.result, settings=settings))
        assert '<dt>density</dt><dd>0.01 g²/Hz</dd>' in page
        assert '<dt>turn</dt><dd>360 °</dd>' in page
        assert '<dt>axis</dt><dd>x</dd>' in page
        assert '<dt>none</dt>' not in page

    @pytest.mark.slow
    def test_figures_are_written_in_three_formats(self, tmp_path):
        files = write_figures(self.result, tmp_path / 'f')
        assert sorted(file.name for file in files)[0] == 'tilt-Bars.pdf'
        assert len(files) == 9
        assert all(file.stat().st_size > 2000 for file in files)

    def test_the_document_keeps_estimates(self):
        document = self.result.to_json()
        assert document['schema'] == 'imu_bench.plan/1'
        assert document['tables'][0]['rows'][0][1] == ANGLE.to_json()
