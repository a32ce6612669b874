# SPDX-License-Identifier: Apache-2.0
"""What is imported and read again is the same: every bit of a number, every ns of a stamp."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import RecordingError
from imu_bench.offline.imports import FORMS, import_recordings
from imu_bench.offline.imports.outputs import rows
from imu_bench.offline.imports.tracks import Names, reported, token, topic
from imu_bench.offline.recordings import find_recordings, load_all, open_source, ReadOptions
from imu_bench.offline.recordings.cells import nanoseconds
import numpy as np
import pytest

QUANTITIES = ('acceleration', 'angular_velocity', 'magnetic_field', 'temperature', 'orientation')
NAMES = ('linear_acceleration', 'angular_velocity')
SECOND = 1_000_000_000

VALUES = st.one_of(
    st.just(0.0),
    st.floats(1e-100, 1e30),
    st.floats(-1e30, -1e-100),
    st.sampled_from((9.80665, 1 / 3, 2.0**-60, 5e-100)),
)
AXES = st.sets(st.sampled_from([f'{name}.{axis}' for name in NAMES for axis in 'xyz']), min_size=1)


@st.composite
def tables(draw, last):
    """Draw stamps that increase, up to a last one, and columns of numbers."""
    size = draw(st.integers(2, 12))
    steps = draw(st.lists(st.integers(1, 10**12), min_size=size, max_size=size))
    stamps = np.cumsum(np.array(steps, np.int64))
    stamps += draw(st.integers(0, last - int(stamps[-1])))
    axes = sorted(draw(AXES))
    cells = st.lists(VALUES, min_size=size * len(axes), max_size=size * len(axes))
    return stamps, axes, np.array(draw(cells)).reshape(size, len(axes))


def read(path, **options):
    """Return every stream at a path."""
    found = []
    for place in find_recordings(path):
        with open_source(place, ReadOptions(**options)) as source:
            found += load_all(source, source.select())
    return found


def as_reported(recording):
    """Return a recording without an orientation that its messages declare as not reported."""
    if reported(recording):
        return recording
    return replace(recording, samples=replace(recording.samples, orientation=None))


def assert_same(first, second):
    """Compare stamps and all numbers; NaN equals NaN: an axis that is not there."""
    np.testing.assert_array_equal(first.samples.stamps, second.samples.stamps)
    for name in QUANTITIES:
        one, other = getattr(first.samples, name), getattr(second.samples, name)
        assert (one is None) == (other is None), name
        if one is not None:
            np.testing.assert_array_equal(one, other, name)


def imported(source, output, form, **options):
    return import_recordings(find_recordings(source), ReadOptions(**options), Path(output), form)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(table=tables(last=2**31 * SECOND - 1), form=st.sampled_from(FORMS))
def test_every_bit_and_every_nanosecond_comes_back(table, form):
    stamps, axes, values = table
    with TemporaryDirectory() as folder:
        log, output = Path(folder) / 'log.csv', Path(folder) / 'out'
        log.write_text(','.join(['stamp_s', *axes]) + '\n' + rows(stamps, values))
        [before] = read(log)
        np.testing.assert_array_equal(before.samples.stamps, stamps)
        for axis, column in zip(axes, values.T, strict=True):
            name, _, letter = axis.partition('.')
            field = {'linear_acceleration': 'acceleration'}.get(name, name)
            stored = getattr(before.samples, field)[:, 'xyz'.index(letter)]
            np.testing.assert_array_equal(stored, column)
        imported(log, output, form)
        if form != 'npy' or len(stamps) > 3:  # of two samples nobody knows which way they lie
            [after] = read(output)
            assert_same(before, after)


@pytest.mark.slow
@given(st.lists(st.integers(-(9 * 10**18), 9 * 10**18), min_size=1, max_size=9))
def test_stamps_as_text_are_exact(stamps):
    text = rows(np.array(stamps), np.empty((len(stamps), 0))).replace(',', '').split()
    assert nanoseconds(np.array(text, 'S40'), 9).tolist() == stamps


@pytest.mark.ros
@given(st.text(max_size=20))
def test_any_name_becomes_one_that_ros_accepts(words):
    from rclpy.validate_full_topic_name import validate_full_topic_name

    assert validate_full_topic_name(f'/{token(words)}/imu/data_raw')
    assert validate_full_topic_name(topic(f'/{words}'))
    assert topic(topic(f'/{words}')) == topic(f'/{words}')


@given(st.lists(st.sampled_from(['/imu', '/a/imu', '/a/imu_2', 'x', 'a_x']), max_size=8))
def test_no_name_is_given_twice(wanted):
    names = Names()
    given_out = [names.claim(name, Path('a.bag')) for name in wanted]
    assert len(set(given_out)) == len(wanted)


REAL = {
    'rosbag1_husky_imu/test/test1.bag': {},
    'elevator_phone/data/skyscrapper_up.csv': {'units': 'stamp=ms,linear_acceleration=m/s^2'},
    'mpu6050_static/calibration data/example_data_calibration.csv': {
        'rate_hz': 100.0,
        'units': 'linear_acceleration=g/16384,angular_velocity=deg/s/131',
    },
    'mpu9150_five_units/imu3.log': {
        'rate_hz': 100.0,
        'columns': 'ax,ay,az,wx,wy,wz',
        'units': 'SI',
    },
    'nbs14/nbs14_1000_frequency.csv': {
        'rate_hz': 1.0,
        'columns': 'angular_velocity.x',
        'units': 'SI',
    },
}


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize('place', REAL)
def test_recordings_of_others_go_through_every_format(shared_data, tmp_path, place):
    source, options = shared_data / place, REAL[place]
    [before] = map(as_reported, read(source, full=True, **options))
    for number, form in enumerate((*FORMS, 'mcap')):
        output = tmp_path / f'out_{number}'
        imported(source, output, form, **options)
        [after] = map(as_reported, read(output, full=True))
        assert_same(before, after)
        assert after.left_out == 0
        source, options = output, {}


def test_stamps_that_no_message_can_hold(tmp_path):
    log = tmp_path / 'log.csv'
    rows = '\n'.join(f'{k - 5},0.1' for k in range(20))
    log.write_text(f'stamp_s,angular_velocity.z\n{rows}\n')
    with pytest.raises(RecordingError, match=r'go from -5 to 14 s .* --to csv and --to npy keep'):
        imported(log, tmp_path / 'out', 'mcap')
    assert not (tmp_path / 'out').exists()
    imported(log, tmp_path / 'out.csv', 'csv')
    assert (tmp_path / 'out.csv').read_text().splitlines()[1] == '-5.000000000,0.1'
