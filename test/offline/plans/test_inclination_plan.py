# SPDX-License-Identifier: Apache-2.0
"""Settings of the inclination plan, and what it says when steps cannot be found."""

from imu_bench.errors import ConfigError, RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials.inclination import Turn
from imu_bench.offline.plans.inclination import _hysteresis, Inclination
from imu_bench.offline.presentation.tables import cells
from imu_bench.samples import Samples
import numpy as np
import pytest

G = 9.80665


@pytest.fixture
def tilted(recording_of):
    """Return a function that makes a recording of a table at these angles, °."""

    def make(angles=(0.0, 1.0, 2.0, 1.0, 0.0), *, axis='x', noise=2e-3, **changes):
        times = np.array([t for k in range(len(angles)) for t in (23.0 * k, 23.0 * k + 20.0)])
        when = np.arange(0.0, times[-1], 0.01)
        theta = np.radians(np.interp(when, times, np.repeat(angles, 2)))
        force = np.zeros((when.size, 3))
        force[:, 'xyz'.index(axis)] = G * np.sin(theta)
        force[:, 2] = G * np.cos(theta)
        force += np.random.default_rng(3).normal(0.0, noise, force.shape)
        return recording_of(Samples((when * 1e9).astype(np.int64), acceleration=force), **changes)

    return make


def run(recordings, settings=None, **options):
    plan = Inclination(settings or {}, **options)
    return plan.conclude([plan.measure('table.mcap', recordings)])


def test_the_raised_axis_and_the_steps_are_found(tilted):
    result = run([tilted(axis='y')], {'angles': '0,1,2,1,0'})
    [sensor] = result.values.values()
    assert sensor['axis'] == 'y'
    assert np.degrees([s['mean']['value'] for s in sensor['steps']]) == pytest.approx(
        [0.0, 1.0, 2.0, 1.0, 0.0], abs=0.005
    )
    assert sensor['errors']['mean']['low'] < 0.0005


def test_variances_share_one_notation(tilted):
    result = run(
        [tilted(), tilted(topic='/bench/other/imu/data_raw')],
        {'angles': '0,1,2.002,1,0', 'axis': 'x'},
    )
    errors = next(t for t in result.tables if t.title.startswith('Errors'))
    at = [column.title for column in errors.columns].index('variance')
    assert errors.columns[at].unit == '10⁻⁹ °²'
    shown = [row[at].text for row in cells(errors)]
    assert len(shown) == 2 and not any('×' in text for text in shown)
    *_, found = [sensor['errors']['variance'] for sensor in result.values.values()]
    assert errors.rows[1][at] == pytest.approx(1e9 * found * np.degrees(1.0) ** 2)


def test_the_line_of_what_was_set_changes_while_the_table_moves(tilted):
    figure = next(
        f for f in run([tilted()], {'angles': '0,1,2,1,0'}).figures if 'Set and' in f.title
    )
    [line] = [series for series in figure.series if series.label == 'set']
    assert line.x[1:-1] == pytest.approx([21.5, 44.5, 67.5, 90.5], abs=1.0)
    assert line.y == pytest.approx([0.0, 1.0, 2.0, 1.0, 0.0, 0.0])


def test_given_times_need_no_detection(tilted):
    result = run([tilted()], {'times': '2-18,25-41', 'axis': 'x', 'angles': '0 °,60 arcsec'})
    [sensor] = result.values.values()
    assert [(s['begin_s'], s['end_s']) for s in sensor['steps']] == [(2.0, 18.0), (25.0, 41.0)]
    assert sensor['steps'][1]['set'] == pytest.approx(np.radians(1.0 / 60.0))


def test_without_set_angles_the_rest_is_there(tilted):
    result = run([tilted()])
    assert [finding.code for finding in result.findings] == ['no_set_angles']
    assert all('Errors' not in table.title for table in result.tables)
    assert 'is found with 95 %' in result.summary[0]


def test_sensors_share_the_steps_of_the_one_that_shows_them(tilted):
    quiet = tilted(topic='/bench/quiet/imu/data_raw')
    loud = tilted(noise=3.0, topic='/bench/loud/imu/data_raw')
    result = run([loud, quiet], {'step': '1 °'}, reference='quiet')
    assert list(result.values) == ['quiet', 'loud']
    first, second = result.values.values()
    assert [s['begin_s'] for s in first['steps']] == [s['begin_s'] for s in second['steps']]


def test_a_sensor_mounted_the_other_way_round_has_the_other_sign(tilted):
    there = tilted(topic='/bench/there/imu/data_raw')
    turned = tilted(angles=(0.0, -1.0, -2.0, -1.0, 0.0), topic='/bench/back/imu/data_raw')
    values = run([there, turned], {'step': '1 °'}).values
    for name, sign in (('there', 1.0), ('back', -1.0)):
        assert values[name]['steps'][2]['set'] == pytest.approx(sign * np.radians(2.0))
        assert abs(values[name]['scale_error']['value']) < 1e-3


def test_no_steps_is_one_clear_line(tilted, noise, recording_of):
    still = recording_of(noise())
    with pytest.raises(RecordingError, match=r'no steps found: no angle has two levels') as said:
        run([still])
    assert '\n' not in str(said.value)
    with pytest.raises(RecordingError, match=r'no steps found in the angle of y'):
        run([tilted()], {'axis': 'y'})
    with pytest.raises(RecordingError, match=r'step 2 from 400 s to 500 s holds 0 samples'):
        run([tilted()], {'times': '0-20,400-500'})
    with pytest.raises(RecordingError, match='too short for two stands'):
        run([tilted(angles=(0.0,))], {'dwell': '15 s'})


def test_no_accelerometer_is_said(recording_of):
    spin = Samples(np.arange(10), angular_velocity=np.zeros((10, 3)))
    with pytest.raises(RecordingError, match='no sensor of it has an accelerometer'):
        run([recording_of(spin)])
    single = np.full((5000, 3), np.nan)
    single[:, 2] = G
    only = recording_of(Samples(np.arange(5000) * 10_000_000, acceleration=single))
    with pytest.raises(RecordingError, match='no acceleration on three axes'):
        run([only])


def test_a_step_that_fits_no_multiple_is_said(tilted):
    with pytest.raises(RecordingError, match=r'step 2 of chip is \d\.\d+° from the first, no m'):
        run([tilted()], {'step': '0.7 °'})


@pytest.mark.parametrize(
    ('settings', 'text'),
    [
        ({'angles': '0,1 furlong'}, "unknown unit 'furlong'"),
        ({'angles': '0,up'}, '--set angles'),
        ({'angles': '0,1', 'step': '1 °'}, 'say the same'),
        ({'times': '0-20,10-30'}, '10-30 begins before the one before ends'),
        ({'times': '20-0'}, "'20-0' does not end after it begins"),
        ({'times': '5'}, "'5' is no begin and end"),
        ({'axis': 'w'}, 'w is not allowed'),
        ({'probability': '1.5'}, '--set probability'),
    ],
)
def test_settings_are_checked_before_anything_is_read(settings, text):
    with pytest.raises(ConfigError, match=text):
        Inclination(settings)


def test_a_chip_that_disagrees_with_its_acceleration_is_reported(tilted):
    recording = tilted()
    samples = recording.samples
    wrong = np.zeros((len(samples), 3))
    wrong[:, 0] = np.arctan2(samples.acceleration[:, 0], samples.acceleration[:, 2]) + 0.002
    from dataclasses import replace

    chip = replace(recording, samples=replace(samples, inclination=wrong))
    result = run([chip], {'step': '1 °'})
    [finding] = result.findings
    assert finding.code == 'on_chip_disagrees'
    assert '0.11' in finding.text


LESS = 'hysteresis up to 0.0115 ± 0.0057 °, at 1.146 °: reached from above it shows less.'
MORE = 'hysteresis up to 0.0057 ± 0.0029 °, at 1.146 °: reached from above it shows more.'
NONE = 'no hysteresis is seen; it is below 0.034 °.'


@pytest.mark.parametrize(
    ('turns', 'words'),
    [
        ([(-2e-4, -3e-4, -1e-4)], LESS),
        ([(-2e-4, -6e-4, 2e-4), (1e-4, 0.5e-4, 1.5e-4)], MORE),
        (
            [(-2e-4, -6e-4, 2e-4), (0.0, -1e-4, 1e-4)],
            'no hysteresis is seen; it is below 0.034 °.',
        ),
    ],
)
def test_hysteresis_is_a_size_and_a_direction_or_a_bound(turns, words):
    """Each turn is given as value, low and high in rad."""
    angle = Estimate(0.0, -1e-6, 1e-6, 'rad')
    made = [Turn(0.02, angle, angle, Estimate(*each, 'rad')) for each in turns]
    assert _hysteresis(made) == words
