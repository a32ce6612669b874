# SPDX-License-Identifier: Apache-2.0
"""The first sentences of the report: which sensor is best, and what it cannot do."""

from dataclasses import replace
import re

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis, Failure, RecordingResult
from imu_bench.offline.comparing import sensors
from imu_bench.offline.health import Finding
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation import (
    axis_tables,
    pages,
    sensor_tables,
    sentences,
    uses,
)
from imu_bench.offline.presentation.tables import cells, Column, Table
from imu_bench.samples import Samples
import numpy as np
import pytest

RATE_HZ = 100.0


@pytest.fixture(scope='module')
def analysed(recorded):
    def make(topic, gyro):
        stamps = 1_700_000_000_000_000_000 + np.arange(len(gyro)) * int(1e9 / RATE_HZ)
        return analyse(recorded(Samples(stamps, angular_velocity=gyro), topic=topic))

    return make


@pytest.fixture(scope='module')
def quiet(analysed):
    return analysed('/quiet', np.random.default_rng(1).normal(0.0, 1e-3, (20_000, 3)))


@pytest.fixture(scope='module')
def loud(analysed):
    return analysed('/loud', np.random.default_rng(2).normal(0.0, 3e-3, (20_000, 3)))


@pytest.fixture(scope='module')
def blocking(analysed):
    noise = np.random.default_rng(3).normal(0.0, 1e-4, (20_001, 3))
    slow = np.zeros(3)
    passed = np.empty((20_000, 3))
    for k in range(20_000):  # a high-pass of first order, 1.6 Hz
        slow = 0.9 * (slow + noise[k + 1] - noise[k])
        passed[k] = slow
    return analysed('/blocking', passed)


def said(*recordings, failures=()):
    return ' '.join(sentences.of_all(Analysis(recordings, failures), sensors.compare(recordings)))


@pytest.mark.slow
def test_every_ratio_has_an_interval(analysed, quiet, loud):
    loudest = analysed('/loudest', np.random.default_rng(4).normal(0.0, 9e-3, (20_000, 3)))
    assert re.search(r', loudest 9\.\d+ ± 0\.\d+ times', said(quiet, loud, loudest))


def test_the_sentences_speak_si_where_asked(quiet):
    results = Analysis((quiet,)), sensors.compare((quiet,))
    spoken = ' '.join(sentences.of_all(*results, si=True))
    assert 'rad/s/√Hz' in spoken and '°' not in spoken
    assert '°' in ' '.join(sentences.of_all(*results))


def test_the_best_for_filters_has_its_interval(quiet, loud):
    words = said(quiet, loud)
    best = words.partition('VIO and filters: quiet is best, gyroscope noise of ')[2]
    assert '±' in best.partition(';')[0]
    assert re.match(r'[^;]*; loud has (3\.0|2\.9)\d* ± 0\.\d+ times as much\.', best), best
    assert 'told apart' not in words


def test_two_that_are_alike_are_not_ranked(quiet, loud):
    twin = replace(quiet, topic='/twin')
    assert 'VIO and filters: the data cannot tell the 2 sensors apart' in said(quiet, twin)
    assert 'quiet is best (not told apart from twin)' in said(quiet, twin, loud)


def test_dead_reckoning_is_of_the_worst_axis_after_the_longest_common_time(quiet, loud):
    """White noise n of one axis has an angle off by n √(2t) if the bias is a mean as long."""
    words = said(quiet, loud)
    found = re.search(r'Dead reckoning: quiet is best, angle off by ([\d.]+)[^;]*° after (\S+) ',
                      words + ' ')  # fmt: skip
    assert found, words
    seconds = {'10': 10.0, '1': 60.0}[found[2]]
    expected = np.degrees(1e-3 / np.sqrt(RATE_HZ) * np.sqrt(2.0 * seconds))
    assert float(found[1]) == pytest.approx(expected, rel=0.35)


def test_what_a_severe_finding_casts_doubt_on_is_no_answer(quiet, loud):
    moved = Finding('severe', 'motion', 'It moved.', 'All of it.', 'Record again.')

    def doubted(recording):
        return replace(recording, health=replace(recording.health, findings=(moved,)))

    assert 'loud, gyroscope noise of' in said(doubted(quiet), loud)
    words = said(doubted(quiet), doubted(loud))
    assert 'the data cannot tell: every recording has severe findings (motion)' in words
    assert 'VIO and filters' not in words and 'Dead reckoning' not in words
    page = pages.render_report(Analysis((doubted(quiet), loud)))
    assert '>quiet †<' in page and 'The recording has severe findings' in page


def test_numbers_for_the_filter_are_those_of_the_export(quiet, loud):
    tables = uses.filter_numbers({'quiet': quiet, 'loud': loud})
    # of white noise of 1 mrad/s at 100 Hz: 1e-4 rad/s/√Hz
    (_, white, walk, *_), _ = cells(tables[0])
    assert white.text == '9.96×10⁻⁵'  # drawn with 1e-4
    assert walk.text.startswith('< ')
    keys = [cell.text for row in cells(tables[1]) for cell in row]
    assert {'gyroscope_noise_density', 'IMU.GyroWalk', 'acc_w'} <= set(keys)


def test_a_high_pass_is_seen(quiet, loud, blocking):
    assert all(axis.shows_constants for found in (quiet, loud) for axis in found.axes.values())
    assert not any(axis.shows_constants for axis in blocking.axes.values())
    words = said(blocking, quiet)
    assert 'blocking: the gyroscope shows no constant signal' in words
    assert 'Dead reckoning: quiet, ' in words
    assert 'no constant signal' in sentences.of_sensor(blocking)[0]
    two = (blocking, quiet)
    (ranking,) = sensor_tables.rankings(two, sensors.compare(two), 0.95)
    titles = [column.title for column in ranking.columns]
    assert titles[4:6] == ['Bias instability B', 'Rate random walk K']
    rows = {row[0].text: row for row in cells(ranking)}
    assert [cell.text for cell in rows['blocking'][4:6]] == ['–', '–']
    assert rows['quiet'][4].text != '–'
    assert rows['quiet'][2].small[0].startswith('± ')


def test_inputs_that_failed_are_in_the_first_sentence(quiet):
    assert '1 input could not be analysed' in said(quiet, failures=(Failure('a.bag', 'cut off'),))
    assert 'could not be analysed' not in said(quiet)


def test_behind_a_high_pass_no_coefficient_is_smaller_than_the_noise(blocking):
    axes = blocking.of('angular_velocity')
    rows = cells(axis_tables.coefficients(axes))
    assert all('±' in row[1].text or '(' in row[1].text for row in rows)
    assert {cell.text for row in rows for cell in row[2:5]} == {'–'}
    assert sentences.fit_remarks(axes) == [f'x, y, z – {sentences.NO_CONSTANTS}.']


def test_the_page_of_a_campaign_says_what_is_lost_and_carries_no_library(tmp_path):
    chapters = [pages.Chapter('tilt', 'Tilt', 'inclination', failure='no steps')]
    pages.write_campaign('A bench', chapters, tmp_path / 'index.html')
    page = (tmp_path / 'index.html').read_text(encoding='utf-8')
    assert '1 test; no result of Tilt.' in page
    assert '<script' not in page
    assert len(page) < 20_000


def with_tiny_n(recording, axes):
    """Return a recording whose fit found this white noise in what a high-pass left."""
    tiny = Estimate(2e-7, 1.9e-7, 2.1e-7, 'rad/s/√Hz')
    changed = {
        name: replace(
            axis,
            model=replace(axis.model, N=replace(tiny)),
            noise_density=tiny,
            noise_density_methods=dict(axis.noise_density_methods) | {'allan': tiny},
        )
        for name, axis in axes.items()
    }
    return replace(recording, axes=changed)


def test_a_small_n_behind_a_high_pass_does_not_win(quiet, blocking):
    """What the Allan deviation has left there contradicts the plateau of the spectrum."""
    found = with_tiny_n(blocking, blocking.axes)
    for axis in found.axes.values():
        plateau = axis.noise_density_methods['plateau']
        assert axis.white_density is plateau
        assert axis.to_json()['noise_density']['value'] == plateau.value
        assert axis.coefficient('N').high is None
        assert axis.to_json()['coefficients']['N']['value'] is None
    again = RecordingResult.from_json(found.to_json())
    assert again.to_json() == found.to_json()
    standings = sensors.compare((found,)).standings['angular_velocity']
    assert standings[0].noise_density.value > 1e-5
    shown, other = (
        cells(axis_tables.coefficients(r.of('angular_velocity')))[0][1].text
        for r in (found, blocking)
    )
    assert shown == other
    # where constants are seen a small N is just a good sensor
    good = with_tiny_n(quiet, quiet.axes).axes['angular_velocity.x']
    assert good.white_density is good.noise_density


def test_a_bound_of_n_is_not_below_the_density_that_is_shown(quiet):
    axis = quiet.axes['angular_velocity.x']
    plateau = axis.noise_density_methods['plateau']
    low, high = (
        Estimate.not_observable('rad/s/√Hz', 'hidden', high=share * plateau.value)
        for share in (0.1, 1.0)
    )
    none = Estimate.not_observable('rad/s/√Hz', 'hidden')

    def shown(n):
        return replace(axis, noise_density=none, model=replace(axis.model, N=n)).coefficient('N')

    assert shown(high) is high
    assert shown(low).high is None and 'plateau' in shown(low).reason


def test_recordings_of_one_topic_without_a_serial_number_may_be_of_one_sensor(quiet):
    monday, friday = (replace(quiet, source=day, topic='/imu') for day in ('monday', 'friday'))
    assert '--pool' in said(monday, friday)
    assert '--pool' not in said(monday)
    assert '--pool' not in said(monday, replace(friday, topic='/other'))
    assert '--pool' not in said(monday, replace(friday, serial='17'))


@pytest.mark.parametrize(('rows', 'folded'), [(40, 0), (41, 1)])
def test_a_long_table_of_a_plan_unfolds(rows, folded):
    table = Table('Steps', (Column('step'),), tuple((k,) for k in range(rows)))
    page = pages.render_plan(PlanResult('p', 'A plan', ('Done.',), (table,), (), (), {}))
    assert page.count(f'<summary>Steps: {rows} rows</summary>') == folded
    assert page.count('<th scope="row"') >= rows
