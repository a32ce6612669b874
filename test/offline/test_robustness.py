# SPDX-License-Identifier: Apache-2.0
"""Bugs that the fuzz run found (`./run benchmark fuzz`): each stays dead."""

from __future__ import annotations

import tempfile

from imu_bench.bags.compression import compress
from imu_bench.errors import RecordingError
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.notation import number
from imu_bench.offline.recordings import load, open_source, ReadOptions
import numpy as np
import pytest

N = 300
HEADER = 'stamp_s,' + ','.join(
    f'{quantity}.{letter}'
    for quantity in ('linear_acceleration', 'angular_velocity')
    for letter in 'xyz'
)


@pytest.fixture
def analysed(tmp_path):
    """Return a function that changes the rows of a sound CSV, reads it back and analyses it."""

    def run(change):
        rng = np.random.default_rng(1)
        rows = np.column_stack([1.7e9 + np.arange(N) / 100, rng.normal(0, 0.02, (N, 6))])
        rows[:, 3] += 9.8
        change(rows)
        path = tmp_path / 'a.csv'
        np.savetxt(path, rows, fmt='%.17g', delimiter=',', header=HEADER, comments='')
        with open_source(path) as source:
            recording = load(source, source.select()[0])
            return analyse(recording, Settings(), problems=source.problems)

    return run


@pytest.mark.parametrize('value', [1e308, -1e200, 1e31])
def test_values_no_sensor_gives_are_left_out(analysed, value):
    """Their squares do not fit: they are as infinite as infinity."""

    def change(rows):
        rows[10:20, 2] = value

    result = analysed(change)
    assert (result.health.samples, result.health.left_out) == (N - 10, 10)
    [finding] = [f for f in result.health.findings if f.code == 'not_a_number']
    assert '10 infinite' in finding.text


def test_an_axis_without_a_single_number_is_absent_and_it_is_told(analysed):
    def change(rows):
        rows[:, 4] = np.inf
        rows[:, 5] = 1e308

    result = analysed(change)
    assert list(result.axes)[3:] == ['angular_velocity.z']
    told = [finding.text for finding in result.health.findings]
    assert 'angular_velocity.x is not used: it holds no finite value.' in told
    assert 'angular_velocity.y is not used: it holds no finite value.' in told


@pytest.mark.parametrize('value', [5e-324, 1e-300, -1e-160])
def test_numbers_whose_squares_vanish_are_zero(analysed, value):
    def change(rows):
        rows[::2, 4] = value
        rows[1::2, 4] = 0.0
        rows[7, 4], rows[9, 4] = np.nan, 1e300

    result = analysed(change)
    [finding] = [f for f in result.health.findings if f.code == 'constant']
    assert result.health.left_out == 2
    assert finding.text == 'angular_velocity.x is constant at zero.'


@pytest.mark.parametrize('header', [b"{'descr': '<f8', 'shape': (3,", b'"""', b"{'descr': '\0'}"])
def test_headers_of_npy_that_numpy_stumbles_over(tmp_path, header):
    path = tmp_path / 'a.npy'
    path.write_bytes(b'\x93NUMPY\1\0' + len(header).to_bytes(2, 'little') + header)
    with pytest.raises(RecordingError, match='not an array of numbers'):
        open_source(path)


def test_a_damaged_compressed_bag_leaves_nothing_behind_and_is_named(tmp_path, monkeypatch):
    scratch, bag = tmp_path / 'scratch', tmp_path / 'bag'
    scratch.mkdir()
    bag.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(scratch))
    for content in (b'SQLite format 3\0' + bytes(5000), b'x'):
        (bag / 'bag.db3.zstd').write_bytes(compress(content))
        with pytest.raises(RecordingError, match=r'/bag/bag\.db3\.zstd: '):
            open_source(bag)
        assert not list(scratch.iterdir())


def test_stamps_that_hardly_advance_have_no_rate(analysed):
    """Two values, and once back from the second to the first: the usual step is none."""

    def change(rows):
        rows[:, 0] = 1.7e9
        rows[130:140, 0] = rows[142:, 0] = 1.7e9 + 1e-6

    rate = analysed(change).health.rate
    assert not rate.observable
    assert rate.reason


def test_stamps_that_span_centuries_are_refused(tmp_path):
    """Their differences do not fit 64 bits."""
    stamps = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(N)
    stamps[7] = -7_521_857_769_029_238_774
    np.savez(tmp_path / 'a.npz', t_ns=stamps, gyro=np.random.default_rng(1).normal(size=(N, 3)))
    options = ReadOptions(units='angular_velocity=rad/s')
    with (
        open_source(tmp_path / 'a.npz', options) as source,
        pytest.raises(RecordingError, match='the stamps go from -7521857769029238774 to 17000'),
    ):
        load(source, source.select()[0])


def test_one_tiny_number_among_few_levels_is_no_resolution(analysed):
    """Ten levels, and once a number so near to one of them that it cannot be a step."""

    def change(rows):
        rows[:, 4] = np.arange(N) % 10 - 5
        rows[7, 4] = 1e-50

    assert 'angular_velocity.x' not in analysed(change).health.resolution


@pytest.mark.parametrize('value', [5e-324, 1e-310, -1e-305])
def test_numbers_near_the_smallest_there_are(analysed, value):
    """One axis saturated at such a number, which then is to be written."""

    def change(rows):
        rows[:, 4] = np.abs(rows[:, 4])
        rows[::4, 4] = value

    result = analysed(change)
    assert result.axes['angular_velocity.x'].statistics['minimum'].value == 0.0
    assert number(value)
