# SPDX-License-Identifier: Apache-2.0
"""The first sentences of the report: which sensor is best, and what it cannot do."""

from dataclasses import replace

from imu_bench.metrology.estimate import Estimate
from imu_bench.offline import comparison
from imu_bench.offline.analyse import analyse
from imu_bench.offline.report import campaign_page, summary, text
from imu_bench.offline.results import Analysis, Failure, RecordingResult
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
    return ' '.join(
        summary.sentences(Analysis(recordings, failures), comparison.compare(recordings))
    )


def with_b(recording, *sizes):
    axes = {
        name: replace(axis, model=replace(axis.model, B=b))
        for (name, axis), b in zip(recording.axes.items(), sizes, strict=True)
    }
    return replace(recording, axes=axes)


def test_the_quietest_has_its_interval(quiet, loud):
    words = said(quiet, loud)
    assert 'Quietest gyroscope: quiet with ' in words
    assert '±' in words.partition('Quietest gyroscope')[2].partition(';')[0]
    assert 'loud has 3.0 times as much' in words
    assert 'told apart' not in words


def test_two_that_are_alike_are_not_ranked(quiet, loud):
    twin = replace(quiet, topic='/twin')
    assert 'quiet with' in said(quiet, twin)
    assert 'not told apart from twin.' in said(quiet, twin)
    assert 'not told apart from twin; loud has' in said(quiet, twin, loud)


def test_the_steadiest_is_named_by_its_worst_axis(quiet, loud):
    small, large = (Estimate(size, 0.9 * size, 1.1 * size, 'rad/s') for size in (1e-6, 1e-4))
    bound = Estimate.not_observable('rad/s', 'too short', high=1e-5)
    words = said(with_b(quiet, small, small, large), with_b(loud, small, bound, small))
    assert 'Least bias instability of the gyroscopes: loud, below 2.1 °/h on its worst' in words
    assert 'Least bias' not in said(quiet)
    wide = Estimate.not_observable('rad/s', 'too short', high=2e-5)
    unknown = with_b(replace(quiet, topic='/short'), wide, wide, wide)
    assert 'not told apart from short.' in said(
        with_b(quiet, small, small, large), with_b(loud, small, bound, small), unknown
    )
    assert 'Least bias' not in said(unknown, with_b(loud, bound, bound, bound))


def test_a_high_pass_is_seen(quiet, loud, blocking):
    assert all(axis.shows_constants for found in (quiet, loud) for axis in found.axes.values())
    assert not any(axis.shows_constants for axis in blocking.axes.values())
    words = said(blocking, quiet)
    assert 'blocking: the gyroscope shows no constant signal' in words
    assert 'Least bias' not in words
    assert 'no constant signal' in text.sensor_words(blocking)[0]
    (ranking,) = text.rankings(Analysis((blocking, quiet)), comparison.compare((blocking, quiet)))
    rows = {row.label: row for row in ranking.rows}
    assert rows['blocking'].bias.shown == rows['blocking'].walk.shown == '–'
    assert rows['quiet'].bias.shown != '–'
    assert rows['quiet'].density.spread.startswith('± ')


def test_inputs_that_failed_are_in_the_first_sentence(quiet):
    assert '1 input could not be analysed' in said(quiet, failures=(Failure('a.bag', 'cut off'),))
    assert 'could not be analysed' not in said(quiet)


def test_behind_a_high_pass_no_coefficient_is_smaller_than_the_noise(blocking):
    axes = blocking.of('angular_velocity')
    density, n, b, k = text.coefficient_columns(axes)[:4]
    assert all('±' in cell.shown or '(' in cell.shown for cell in density.cells)
    assert {cell.shown for column in (n, b, k) for cell in column.cells} == {'–'}
    assert text.fit_remarks(axes) == [f'x, y, z – {text.NO_CONSTANTS}.']


def test_the_page_of_a_campaign_says_what_is_lost_and_carries_no_library(tmp_path):
    chapters = [campaign_page.Chapter('tilt', 'Tilt', 'inclination', failure='no steps')]
    campaign_page.write('A bench', chapters, tmp_path / 'index.html')
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
    standings = comparison.compare((found,)).standings['angular_velocity']
    assert standings[0].noise_density.value > 1e-5
    shown = text.coefficient_columns(found.of('angular_velocity'))[0].cells[0].shown
    assert shown == text.coefficient_columns(blocking.of('angular_velocity'))[0].cells[0].shown
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
