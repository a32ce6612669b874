# SPDX-License-Identifier: Apache-2.0
"""Calibration from positions: algebra, Monte Carlo, and two published data sets."""

import json

from imu_bench.errors import DataError
from imu_bench.metrology.trials import six_position as six
from imu_bench.metrology.trials import turns
from imu_bench.metrology.trials.still import find_positions, Position
from imu_bench.units import STANDARD_GRAVITY
import numpy as np
import pytest

RESPONSE = np.array([[1.01, 0.004, -0.002], [-0.003, 0.985, 0.006], [0.001, 0.002, 1.003]])
BIAS = np.array([0.4, -0.3, 0.1])
UP = {
    name: np.eye(3)['xyz'.index(name[1])] * (1.0 if name[0] == '+' else -1.0) for name in six.FACES
}


def held(mean, error=0.0):
    return six.Held(np.asarray(mean, float), np.full(3, error))


def seen(force):
    return RESPONSE @ force + BIAS


def test_level_faces_give_back_what_went_in():
    faces = {name: held(seen(STANDARD_GRAVITY * up)) for name, up in UP.items()}
    found = six.six_faces(faces)
    np.testing.assert_allclose(found.matrix, np.linalg.inv(RESPONSE), atol=1e-12)
    np.testing.assert_allclose(found.offset, BIAS, atol=1e-12)
    assert found.misalignment['y', 'x'].value == pytest.approx(-0.003)
    np.testing.assert_allclose(
        found.corrected([seen([1.0, 2.0, 3.0])]), [[1.0, 2.0, 3.0]], atol=1e-12
    )


def tilted(rng, up, spread):
    """Return a face that is not quite level."""
    off = up + rng.normal(0.0, spread, 3) * (1.0 - np.abs(up))
    return STANDARD_GRAVITY * off / np.linalg.norm(off)


def test_intervals_hold_the_truth_when_faces_are_uneven():
    rng = np.random.default_rng(7)
    hits = np.zeros(3)
    for _ in range(300):
        faces = {
            name: held(seen(tilted(rng, up, 5e-3)) + rng.normal(0.0, 1e-3, 3), 1.96e-3)
            for name, up in UP.items()
        }
        found = six.six_faces(faces)
        hits += [
            np.mean([b.low < t < b.high for b, t in zip(found.bias, BIAS, strict=True)]),
            np.mean(
                [s.low < RESPONSE[k, k] - 1.0 < s.high for k, s in enumerate(found.scale_error)]
            ),
            np.mean(
                [
                    e.low < RESPONSE['xyz'.index(row), 'xyz'.index(column)] < e.high
                    for (row, column), e in found.misalignment.items()
                ]
            ),
        ]
    bias, scale, misalignment = hits / 300
    assert bias > 0.93
    assert scale > 0.93
    assert 0.92 < misalignment < 0.98


@pytest.mark.parametrize('missing', six.FACES)
def test_a_missing_face_is_named_and_the_other_axes_are_found(missing):
    faces = {name: held(seen(STANDARD_GRAVITY * up)) for name, up in UP.items() if name != missing}
    found = six.six_faces(faces)
    for axis, bias in zip('xyz', found.bias, strict=True):
        assert bias.observable == (axis != missing[1])
    [absent] = [bias for bias in found.bias if not bias.observable]
    assert absent.reason == f'position {missing} is missing'
    assert found.matrix is None
    with pytest.raises(DataError, match='positions are missing'):
        found.corrected([[0.0, 0.0, 0.0]])


def test_too_little_is_refused():
    with pytest.raises(DataError, match=r'positions on \+z only'):
        six.six_faces({'+z': held([0.0, 0.0, 9.8])})
    with pytest.raises(DataError, match='3 positions are too few'):
        six.any_positions([held([0.0, 0.0, 9.8])] * 3)
    flat = [held([9.8 * np.cos(a), 9.8 * np.sin(a), 0.0]) for a in np.linspace(0.0, 6.0, 20)]
    with pytest.raises(DataError, match='do not tell bias, scale and misalignment apart'):
        six.any_positions(flat)


@pytest.mark.slow
def test_any_positions_cover_the_truth():
    triangular = np.triu(RESPONSE)
    rng = np.random.default_rng(11)
    inside = []
    for _ in range(200):
        force = rng.normal(size=(25, 3))
        force *= STANDARD_GRAVITY / np.linalg.norm(force, axis=1, keepdims=True)
        raw = force @ triangular.T + BIAS + rng.normal(0.0, 2e-3, (25, 3))
        found = six.any_positions([held(mean) for mean in raw])
        inside += [b.low < t < b.high for b, t in zip(found.bias, BIAS, strict=True)]
        inside += [
            s.low < triangular[k, k] - 1.0 < s.high for k, s in enumerate(found.scale_error)
        ]
        inside += [
            e.low < triangular['xyz'.index(row), 'xyz'.index(column)] < e.high
            for (row, column), e in found.misalignment.items()
        ]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_faces_that_were_taken_twice_show_how_well_they_repeat():
    zero = held([0.0, 0.0, 9.80], 1e-5), held([0.0, 0.0, 9.82], 1e-5), held([9.81, 0, 0], 1e-5)
    found = six.by_face(zero)
    assert found['+z'].error[2] > 0.05
    assert found['+x'].error[0] > found['+z'].error[2]  # taken once only
    assert found['+x'].error[1] == pytest.approx(1e-5)


def session(shared_data):
    folder = shared_data / 'ferraris_session'
    table = np.loadtxt(folder / 'example_ferraris_session.csv', delimiter=',', skiprows=1)
    sections = json.loads((folder / 'example_ferraris_session_list.json').read_text())
    known = json.loads((folder / 'imucal_calibration_of_example_session.json').read_text())
    return table[:, 4:7], np.radians(table[:, 1:4]), sections, known


@pytest.mark.data
def test_the_ferraris_session_is_that_of_imucal_to_rounding(shared_data):
    force, _, sections, known = session(shared_data)
    faces = {
        ('+' if name.endswith('p') else '-') + name[0]: six.held(force[s['start'] : s['end']])
        for name, s in sections.items()
        if not name.endswith('rot')
    }
    found = six.six_faces(faces, 9.81)
    np.testing.assert_allclose(found.offset, known['b_a'], atol=1e-9)
    response = np.array(known['K_a']) @ np.array(known['R_a'])
    np.testing.assert_allclose(np.linalg.inv(found.matrix), response, atol=1e-12)


@pytest.mark.data
def test_the_ferraris_session_by_itself(shared_data):
    """Positions and turns found without help: bias to 2 mm/s², matrices to 0.15 %."""
    force, omega, sections, known = session(shared_data)
    rate = 102.4
    places = find_positions(force, rate, omega)
    for name, section in sections.items():
        inside = [p for p in places if p.begin < section['end'] and p.end > section['start']]
        if name.endswith('rot'):
            # a turn lies between two positions; its section has still ends
            assert len(inside) <= 2
        else:
            assert len(inside) == 1
    still = [six.held(force[p.begin : p.end]) for p in places]
    found = six.six_faces(six.by_face(still), 9.81)
    np.testing.assert_allclose(found.offset, known['b_a'], atol=2e-3)
    response = np.array(known['K_a']) @ np.array(known['R_a'])
    np.testing.assert_allclose(np.linalg.inv(found.matrix), response, atol=1.5e-3)
    for bias, theirs in zip(found.bias, known['b_a'], strict=True):
        assert bias.low < theirs < bias.high
    rates = [six.held(omega[p.begin : p.end]) for p in places]
    rest = turns.at_rest(rates, still)
    zero = [estimate.value for estimate in rest.bias]
    np.testing.assert_allclose(np.degrees(zero), known['b_g'], atol=3e-3)
    made = turns.find_turns(omega, 1.0 / rate, places, still, zero)
    assert [turn.axis for turn in made] == ['x', 'y', 'z']
    gyroscope = turns.gyroscope(rest, made)
    theirs = np.array(known['K_g']) @ np.array(known['R_g'])
    np.testing.assert_allclose(np.linalg.inv(gyroscope.matrix), theirs, atol=3e-4)


@pytest.mark.data
@pytest.mark.parametrize('unit', range(5))
def test_the_published_biases_of_five_mpu9150(shared_data, unit):
    """Mikov, Reginya and Moschevikin 2020 (ICINS): with the g of 9.81 that their scale shows."""
    folder = shared_data / 'mpu9150_five_units'
    table = np.loadtxt(folder / f'imu{unit}.log')
    known = json.loads((folder / 'reference.json').read_text())['imus'][f'imu{unit}']
    places = find_positions(table[:, :3], 100.0, table[:, 3:])
    still = [six.held(table[p.begin : p.end, :3]) for p in places]
    found = six.any_positions(still, 9.81)
    for bias, theirs in zip(found.bias, known['published_acc_bias_ms2'], strict=True):
        assert bias.value == pytest.approx(theirs, abs=2.5e-3)
        # they print three decimals
        assert bias.low - 5e-4 <= theirs <= bias.high + 5e-4
    for scale, theirs in zip(found.scale_error, known['published_acc_scale_pct'], strict=True):
        assert 100.0 * scale.value == pytest.approx(theirs, abs=0.03)
    rest = turns.at_rest([six.held(table[p.begin : p.end, 3:]) for p in places], still)
    for bias, theirs in zip(rest.bias, known['published_gyro_bias_dps'], strict=True):
        # printed in steps of 0.001 rad/s
        assert np.degrees(bias.value) == pytest.approx(theirs, abs=0.057)
    before, _ = six.residuals(None, still, 9.81)
    after, _ = six.residuals(found, still, 9.81)
    assert np.abs(after).max() < 0.1 * np.abs(before).max()


def test_positions_are_separated_by_a_quick_turn():
    """No block is restless when the move is shorter than one, but the mean jumps."""
    rng = np.random.default_rng(2)
    force = np.repeat([[0.0, 0.0, 9.8], [9.8, 0.0, 0.0], [0.0, 9.8, 0.0]], 500, axis=0)
    force = force + rng.normal(0.0, 0.01, force.shape)
    assert len(find_positions(force, 100.0)) == 3


def test_a_recording_too_short_for_a_position_is_said():
    with pytest.raises(DataError, match=r'0\.5 s are too short for positions of 1 s'):
        find_positions(np.zeros((50, 3)), 100.0)


def turning(axis, angle, rate=100.0, seconds=4.0, after=1.0):
    """Return the angular velocity of a turn with still parts around it."""
    still = np.zeros((round(after * rate), 3))
    part = np.zeros((round(seconds * rate), 3))
    share = np.sin(np.pi * (np.arange(len(part)) + 0.5) / len(part)) ** 2
    part[:, 'xyz'.index(axis)] = angle * rate * share / share.sum()
    return np.concatenate([still, part, still])


def test_turns_give_back_the_matrix_of_the_gyroscope():
    bias = np.array([0.01, -0.02, 0.005])
    runs, places, forces, begin = [], [], [], 0
    for axis in 'xyz':
        part = turning(axis, -2.0 * np.pi)
        runs.append(part)
        upright = held(STANDARD_GRAVITY * UP[f'+{axis}'])
        places += [Position(begin, begin + 100), Position(begin + 500, begin + 600)]
        forces += [upright, upright]
        begin += len(part)
    omega = np.concatenate(runs) @ RESPONSE.T + bias
    rest = turns.at_rest([six.held(omega[p.begin : p.end]) for p in places], forces)
    made = turns.find_turns(omega, 0.01, places, forces, bias)
    assert [turn.axis for turn in made] == ['x', 'y', 'z']
    found = turns.gyroscope(rest, made, turn_error=0.0)
    np.testing.assert_allclose(np.linalg.inv(found.matrix), RESPONSE, atol=1e-9)
    wide = turns.gyroscope(rest, made, turn_error=np.radians(1.0))
    assert wide.scale_error[0].high - wide.scale_error[0].value == pytest.approx(
        1.96 / 360.0 * 1.01, rel=0.01
    )


def test_a_turn_that_tips_the_sensor_is_none():
    omega = turning('x', 2.0 * np.pi)
    places = [Position(0, 100), Position(500, 600)]
    tipped = [held([9.8, 0.0, 0.0]), held([0.0, 9.8, 0.0])]
    assert turns.find_turns(omega, 0.01, places, tipped, np.zeros(3)) == ()
    lying = [held([0.0, 0.0, 9.8])] * 2
    assert turns.find_turns(omega, 0.01, places, lying, np.zeros(3)) == ()


def test_a_turn_that_was_not_made_is_named():
    rest = turns.at_rest([held([0.0, 0.0, 0.0])], [held([0.0, 0.0, 9.8])])
    found = turns.gyroscope(rest, ())
    assert found.scale_error[2].reason == 'no turn about z by a multiple of 360°'
    with pytest.raises(DataError, match='no still position'):
        turns.at_rest([], [])


def test_what_gravity_does_to_a_gyroscope():
    rng = np.random.default_rng(5)
    effect = 1e-4 * rng.normal(size=(3, 3))
    force = rng.normal(size=(30, 3))
    force *= STANDARD_GRAVITY / np.linalg.norm(force, axis=1, keepdims=True)
    rates = force @ effect.T + [0.01, 0.02, 0.03] + rng.normal(0.0, 1e-5, (30, 3))
    rest = turns.at_rest([held(r) for r in rates], [held(f) for f in force])
    found = np.array([[rest.sensitivity[a, b].value for b in 'xyz'] for a in 'xyz'])
    np.testing.assert_allclose(found, effect, atol=2e-6)
    assert [b.value for b in rest.bias] == pytest.approx([0.01, 0.02, 0.03], abs=1e-5)
