# SPDX-License-Identifier: Apache-2.0
"""The six-position plan: methods, missing positions, and the YAML for the nodes."""

from dataclasses import replace

from imu_bench.config import sensor_from_parameters
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.offline.plans.six_position import SixPosition
from imu_bench.samples import Samples
import numpy as np
import pytest
import yaml

G = 9.80665
RESPONSE = np.array([[1.01, 0.004, -0.002], [-0.003, 0.985, 0.006], [0.001, 0.002, 1.003]])
BIAS = np.array([0.4, -0.3, 0.1])
RATE = 100.0


@pytest.fixture
def turned(recording_of):
    """Return a function that makes a recording of a sensor laid on these sides."""

    def make(ups, *, turns=(), gyroscope=True, **changes):
        rng = np.random.default_rng(9)
        force, omega = [], []
        for number, up in enumerate(ups):
            still = np.tile(G * np.asarray(up, float), (400, 1))
            force += [still, still + rng.normal(0.0, 2.0, still.shape)]
            spin = np.zeros((400, 3))
            if number in turns:
                # about the vertical, and still again on the same side
                spin[:, int(np.argmax(np.abs(up)))] = 2.0 * np.pi / 4.0
                force.append(still)
            omega += [np.zeros((400, 3)), spin]
            omega += [np.zeros((400, 3))] * (number in turns)
        shown = np.concatenate(force) @ RESPONSE.T + BIAS
        shown += rng.normal(0.0, 0.01, shown.shape)
        rates = np.concatenate(omega) @ RESPONSE.T + 0.1 * BIAS
        rates += rng.normal(0.0, 1e-3, rates.shape)
        run = Samples(
            (np.arange(len(shown)) * 1e9 / RATE).astype(np.int64),
            acceleration=shown,
            angular_velocity=rates if gyroscope else None,
        )
        return recording_of(run, **changes)

    return make


FACES = [*np.eye(3), *-np.eye(3)]


def run(recordings, settings=None, **options):
    plan = SixPosition(settings or {}, **options)
    return plan.conclude([plan.measure('box.csv', recordings)])


def test_six_faces_with_turns_give_both_matrices(turned):
    found = run([turned(FACES, turns=(0, 1, 2))]).values['chip']
    assert found['acceleration']['method'] == 'faces'
    np.testing.assert_allclose(np.linalg.inv(found['acceleration']['matrix']), RESPONSE, atol=1e-3)
    np.testing.assert_allclose(
        np.linalg.inv(found['angular_velocity']['matrix']), RESPONSE, atol=3e-3
    )
    np.testing.assert_allclose(found['acceleration']['offset'], BIAS, atol=3e-3)
    assert max(np.abs(found['residuals_after'])) < 0.01 < max(np.abs(found['residuals_before']))


def test_many_positions_of_any_kind(turned):
    rng = np.random.default_rng(1)
    ups = rng.normal(size=(24, 3))
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    found = run([turned(ups, gyroscope=False)]).values['chip']
    assert found['acceleration']['method'] == 'norm'
    assert 'angular_velocity' not in found
    for bias, known in zip(found['acceleration']['bias'], BIAS, strict=True):
        assert bias['value'] == pytest.approx(known, abs=5e-3)


def test_a_missing_position_is_one_finding(turned):
    result = run([turned(FACES[:5])])
    finding = next(f for f in result.findings if f.code == 'positions_missing')
    assert finding.text == 'chip: position -z is missing.'
    bias = result.values['chip']['acceleration']['bias']
    assert [b['observable'] for b in bias] == [True, True, False]


def test_without_turns_the_gyroscope_has_a_bias_and_no_scale(turned, tmp_path):
    file = tmp_path / 'chip.yaml'
    result = run([turned(FACES)], {'yaml': str(file)})
    finding = next(f for f in result.findings if f.code == 'turns_missing')
    assert finding.text == (
        'chip: no turn about x, y, z by a multiple of 360° between still positions.'
    )
    assert finding.effect == (
        'The bias of the gyroscope is known, its scale and misalignment are not.'
    )
    gyroscope = result.values['chip']['angular_velocity']
    for bias, known in zip(gyroscope['bias'], 0.1 * BIAS, strict=True):
        assert bias['low'] < known < bias['high']
    assert not any(scale['observable'] for scale in gyroscope['scale_error'])
    assert gyroscope['misalignment'] == {}
    assert gyroscope['matrix'] is None
    assert result.summary[-2].endswith('scale not known, for it was not turned.')
    given = yaml.safe_load(file.read_text(encoding='utf-8'))['/**']['ros__parameters']
    assert list(given['calibration']['angular_velocity']) == ['bias']
    assert list(given['calibration']['acceleration']) == ['bias', 'matrix']


def test_turns_about_one_axis_give_the_scale_of_that_axis(turned):
    result = run([turned(FACES, turns=(1, 4))])
    scales = result.values['chip']['angular_velocity']['scale_error']
    assert [scale['observable'] for scale in scales] == [False, True, False]
    assert scales[1]['low'] < RESPONSE[1, 1] - 1.0 < scales[1]['high']
    finding = next(f for f in result.findings if f.code == 'turns_missing')
    assert 'about x, z by' in finding.text
    assert 'misalignment about these axes' in finding.effect


def test_too_little_is_one_clear_line(turned, noise, recording_of):
    with pytest.raises(RecordingError, match='1 still position found: lay the sensor still'):
        run([recording_of(noise(n=3000))])
    with pytest.raises(RecordingError, match=r'positions on \+x, \+y only'):
        run([turned(FACES[:2])])
    with pytest.raises(RecordingError, match='6 positions are too few for any position'):
        run([turned(FACES)], {'method': 'norm'})


def test_the_yaml_is_read_by_a_sensor_and_corrects_it(turned, tmp_path):
    from imu_bench.acquisition.correction import correction

    file = tmp_path / 'chip.yaml'
    recording = turned(FACES, turns=(0, 1, 2), source='my\nsession.csv')
    result = run([recording], {'yaml': str(file)})
    assert str(file) in result.summary[-1]
    given = yaml.safe_load(file.read_text(encoding='utf-8'))['/**']['ros__parameters']
    sensor = sensor_from_parameters('chip', {'driver': 'x', 'backend': 'emulated', **given})
    corrected = correction(sensor.calibration)(recording.samples)
    still = corrected.acceleration[50:350]
    np.testing.assert_allclose(still.mean(axis=0), [G, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(corrected.angular_velocity[50:350].mean(axis=0), 0.0, atol=1e-3)


def test_a_yaml_that_cannot_be_is_refused(turned, tmp_path):
    file = {'yaml': str(tmp_path / 'x.yaml')}
    with pytest.raises(RecordingError, match='not complete: position -z is missing'):
        run([turned(FACES[:5])], file)
    two = [turned(FACES, topic=f'/bench/{name}/imu/data_raw') for name in ('a', 'b')]
    with pytest.raises(RecordingError, match='holds one sensor, here are a, b: choose with --ref'):
        run(two, file)
    run(two, file, reference='b')
    assert '/bench/b/imu' in (tmp_path / 'x.yaml').read_text(encoding='utf-8')
    with pytest.raises(RecordingError, match=r'--set yaml: .*No such file or directory'):
        run([turned(FACES)], {'yaml': str(tmp_path / 'none' / 'x.yaml')})
    assert not list(tmp_path.glob('*/*'))


@pytest.mark.parametrize(
    ('settings', 'text'),
    [
        ({'gravity': '9.81'}, '--set gravity'),
        ({'gravity': '20 m/s²'}, '20 is not allowed'),
        ({'turn': '360 furlong'}, "unknown unit 'furlong'"),
        ({'method': 'best'}, 'best is not allowed; allowed: auto, faces, norm'),
    ],
)
def test_settings_are_checked(settings, text):
    with pytest.raises(ConfigError, match=text):
        SixPosition(settings)


def leaning(degrees, count, seed=3):
    """Return directions that lean by up to so much from the six faces."""
    rng = np.random.default_rng(seed)
    ups = np.array([FACES[k % 6] for k in range(count)])
    ups = ups + np.tan(np.radians(degrees)) * rng.uniform(-1.0, 1.0, ups.shape)
    return ups / np.linalg.norm(ups, axis=1, keepdims=True)


def test_positions_near_faces_that_are_none_are_taken_by_the_size_of_gravity(turned):
    ups = leaning(20.0, 24)
    found = run([turned(ups, gyroscope=False)]).values['chip']
    assert found['acceleration']['method'] == 'norm'
    assert np.sqrt(np.mean(np.square(found['residuals_after']))) < 0.01


def test_faces_laid_by_hand_stay_faces(turned):
    found = run([turned(leaning(1.0, 24), gyroscope=False)]).values['chip']
    assert found['acceleration']['method'] == 'faces'


def test_too_few_that_are_no_faces_are_said_first(turned):
    result = run([turned(leaning(22.0, 6), gyroscope=False)])
    finding = result.findings[0]
    assert (finding.code, finding.severity) == ('no_faces', 'severe')
    assert 'lean up to' in finding.text and 'method=norm' in finding.action


def test_one_recording_per_face(turned):
    """Their names say nothing; the faces do."""
    plan = SixPosition({})
    whole = run([turned(FACES)]).values['chip']
    parts = [
        plan.measure(f'{k}.csv', [turned([up], source=f'{k}.csv', topic=f'{k}')])
        for k, up in enumerate(FACES)
    ]
    result = plan.conclude(parts)
    (found,) = result.values.values()
    assert len(found['positions']) == 6 and found['source'] == '6 recordings'
    np.testing.assert_allclose(
        found['acceleration']['matrix'], whole['acceleration']['matrix'], atol=2e-3
    )
    for bias, known in zip(found['angular_velocity']['bias'], 0.1 * BIAS, strict=True):
        assert bias['value'] == pytest.approx(known, abs=1e-3)


def test_accelerometer_and_gyroscope_in_two_files(turned):
    """The gyroscope starts earlier and runs at another rate."""
    whole = turned(FACES, turns=(0, 1, 2))
    run_ = whole.samples
    reference = run([whole]).values['chip']
    every = np.concatenate(
        [np.repeat(run_.angular_velocity[:1], 50, axis=0), run_.angular_velocity]
    )
    stamps = (np.arange(2 * len(every)) * 0.5e9 / RATE).astype(np.int64)
    first = Samples(run_.stamps + 500_000_000, acceleration=run_.acceleration)
    second = Samples(stamps, angular_velocity=np.repeat(every, 2, axis=0))
    plan = SixPosition({})
    parts = [
        plan.measure('a', [replace(whole, samples=first, source='a', topic='Accelerometer')]),
        plan.measure('g', [replace(whole, samples=second, source='g', topic='Gyroscope')]),
    ]
    (found,) = plan.conclude(parts).values.values()
    for name in ('acceleration', 'angular_velocity'):
        np.testing.assert_allclose(found[name]['matrix'], reference[name]['matrix'], atol=3e-3)
    with pytest.raises(RecordingError, match='no accelerometer belongs to it'):
        plan.conclude(parts[1:])
