# SPDX-License-Identifier: Apache-2.0
"""Arrays of NumPy and MATLAB: what is read, what is refused, and that nothing stays behind."""

from __future__ import annotations

import math
import struct
import tempfile
import zipfile
import zlib

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import find_recordings, load_all, open_source, ReadOptions
from imu_bench.samples import Samples
import numpy as np
import pytest
from scipy.io import savemat

N = 500
G = 9.80665
UNITS = 'linear_acceleration=g,angular_velocity=deg/s'
SI_UNITS = 'linear_acceleration=m/s^2,angular_velocity=rad/s'
RNG = np.random.default_rng(1)
ACCELERATION, RATES = RNG.normal(size=(N, 3)), RNG.normal(size=(N, 3))
TIME = np.arange(N) / 100.0


def read(path, **options):
    with open_source(path, ReadOptions(**options)) as source:
        [recording] = load_all(source, source.select())
        return recording, source.problems


def is_what_was_written(samples: Samples, acceleration=1.0, angular_velocity=1.0):
    np.testing.assert_allclose(samples.acceleration, ACCELERATION * acceleration, rtol=1e-12)
    np.testing.assert_allclose(samples.angular_velocity, RATES * angular_velocity, rtol=1e-12)
    assert np.diff(samples.stamps).tolist() == [10_000_000] * (N - 1)


class TestNpy:
    def test_other_columns_in_the_majority_do_not_stand_for_the_sensor(self, tmp_path):
        """An accelerometer with a magnetometer and a thermometer of another rate."""
        np.save(tmp_path / 'stamps.npy', (TIME * 1e9).astype(np.int64))
        np.save(tmp_path / 'acceleration.npy', ACCELERATION)
        for name, shape in (('magnetic_field', (N // 10, 3)), ('temperature', (N // 10,))):
            np.save(tmp_path / f'{name}.npy', np.zeros(shape))
        np.save(tmp_path / 'magnetic_field_stamps.npy', np.arange(N // 10))
        recording, [note] = read(tmp_path)
        assert recording.samples.angular_velocity is None
        np.testing.assert_array_equal(recording.samples.acceleration, ACCELERATION)
        assert 'not used, being of another length: magnetic_field.x' in note

    def test_a_table_needs_columns_units_and_rate(self, tmp_path):
        path = tmp_path / 'log.npy'
        np.save(path, np.hstack([ACCELERATION, RATES]))
        with pytest.raises(RecordingError, match='6 columns without names; name them as in'):
            open_source(path)
        columns = 'ax,ay,az,gx,gy,gz'
        with pytest.raises(RecordingError, match='the unit of linear_acceleration and angular_ve'):
            read(path, columns=columns, rate_hz=100)
        with pytest.raises(RecordingError, match='no time column: give the sample rate'):
            read(path, columns=columns, units=UNITS)
        recording, problems = read(path, columns=columns, units=UNITS, rate_hz=100)
        assert (recording.topic, recording.stamp_source, problems) == ('log', 'rate', [])
        is_what_was_written(recording.samples, G, math.pi / 180)

    @pytest.mark.parametrize('order', ['C', 'F'])
    @pytest.mark.parametrize('turned', [False, True])
    def test_axes_in_rows_or_columns(self, tmp_path, order, turned):
        table = np.hstack([TIME[:, None], ACCELERATION, RATES])
        np.save(tmp_path / 'a.npy', np.array(table.T if turned else table, order=order))
        columns = 'stamp,ax,ay,az,gx,gy,gz'
        recording, _ = read(tmp_path / 'a.npy', columns=columns, units=f'stamp=s,{SI_UNITS}')
        is_what_was_written(recording.samples)
        assert recording.stamp_source == 'column'

    def test_the_name_of_a_file_says_what_three_columns_are(self, tmp_path):
        np.save(tmp_path / 'gyro.npy', RATES)
        recording, _ = read(tmp_path / 'gyro.npy', units='angular_velocity=rad/s', rate_hz=10)
        assert recording.samples.acceleration is None
        np.testing.assert_array_equal(recording.samples.angular_velocity, RATES)

    def test_fields_of_a_structured_array_are_names(self, tmp_path):
        table = np.zeros(N, [('t_ns', np.int64), ('acc', np.float32, (3,)), ('gx', np.int16)])
        table['t_ns'] = 1_700_000_000_123_456_789 + 10_000_000 * np.arange(N)
        table['acc'], table['gx'] = ACCELERATION, 131
        np.save(tmp_path / 'a.npy', table)
        units = 'linear_acceleration=m/s^2,angular_velocity=deg/s/131'
        recording, _ = read(tmp_path / 'a.npy', units=units)
        assert recording.samples.stamps.tolist() == table['t_ns'].tolist()
        np.testing.assert_array_equal(recording.samples.acceleration, table['acc'].astype(float))
        np.testing.assert_allclose(recording.samples.angular_velocity[:, 0], math.pi / 180)

    @pytest.mark.parametrize(
        ('content', 'expected'),
        [
            (b'\x93NUMPY\x01\x00\xff\xff{', 'not an array of numbers'),
            (b'\x93NUMPY', 'not an array of numbers'),
            (b'\x93NUMPY\x09\x00v\x00', 'not an array of numbers'),
        ],
    )
    def test_damage_is_one_line(self, tmp_path, content, expected):
        path = tmp_path / 'a.npy'
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=expected):
            open_source(path)

    def test_a_file_cut_off_says_so(self, tmp_path):
        path = tmp_path / 'a.npy'
        np.save(path, RATES)
        path.write_bytes(path.read_bytes()[:-8])
        with pytest.raises(RecordingError, match='cut off: 12000 bytes are announced, 11992 are'):
            open_source(path)

    def test_objects_are_never_unpickled(self, tmp_path):
        np.save(tmp_path / 'a.npy', np.array([{}, []], dtype=object), allow_pickle=True)
        with pytest.raises(RecordingError, match='it holds object of shape'):
            open_source(tmp_path / 'a.npy')

    @pytest.mark.parametrize('last', ['<f8', '|O'])
    def test_columns_within_columns_are_no_table(self, tmp_path, last):
        kind = [('ax', last)]
        for _ in range(300):
            kind = [('ax', kind)]
        header = {'descr': kind, 'fortran_order': False, 'shape': (20,)}
        with (tmp_path / 'a.npy').open('wb') as file:
            np.lib.format.write_array_header_2_0(file, header)
            file.write(bytes(160))
        with pytest.raises(RecordingError, match='not an array of numbers') as caught:
            open_source(tmp_path / 'a.npy')
        assert len(str(caught.value)) < 500

    @pytest.mark.parametrize('array', [np.float64(3), np.zeros((0, 6)), np.array(['a', 'b'])])
    def test_no_columns_of_numbers(self, tmp_path, array):
        np.save(tmp_path / 'a.npy', array)
        with pytest.raises(RecordingError, match=r'no columns of numbers|not an array of numbers'):
            open_source(tmp_path / 'a.npy')

    @pytest.mark.parametrize('bad', [np.nan, np.inf, 1e300])
    def test_times_that_are_none(self, tmp_path, bad):
        table = np.hstack([TIME[:, None], RATES])
        table[7, 0] = bad
        np.save(tmp_path / 'a.npy', table)
        with pytest.raises(RecordingError, match='a time is not finite or does not fit'):
            read(tmp_path / 'a.npy', columns='stamp,gx,gy,gz', units='SI')


class TestNpz:
    def test_arrays_by_their_names(self, tmp_path):
        path = tmp_path / 'a.npz'
        np.savez_compressed(path, time_s=TIME, accel=ACCELERATION, gyro=RATES, mark=np.zeros(3))
        recording, problems = read(path, units=SI_UNITS)
        is_what_was_written(recording.samples)
        assert problems == ['a.npz: not used, being of another length: mark']

    def test_native_names_need_no_option(self, tmp_path):
        path = tmp_path / 'a.npz'
        np.savez(path, stamp_s=TIME, linear_acceleration=ACCELERATION, angular_velocity=RATES)
        is_what_was_written(read(path)[0].samples)

    def test_nothing_stays_behind(self, tmp_path, monkeypatch):
        scratch = tmp_path / 'scratch'
        scratch.mkdir()
        monkeypatch.setattr(tempfile, 'tempdir', str(scratch))
        good, bad = tmp_path / 'good.npz', tmp_path / 'bad.npz'
        np.savez(good, stamp_s=TIME, angular_velocity=RATES)
        np.savez(bad, something=np.zeros(7))
        with open_source(good) as source:
            assert list(scratch.iterdir())
            load_all(source, source.select())
        with pytest.raises(RecordingError):
            open_source(bad)
        source = open_source(good)
        del source
        assert not list(scratch.iterdir())

    def test_an_archive_that_claims_too_much_is_refused(self, tmp_path):
        path = tmp_path / 'a.npz'
        np.savez_compressed(path, gyro=np.zeros((100_000, 3)))
        data = path.read_bytes()
        with zipfile.ZipFile(path) as archive:
            claimed = archive.infolist()[0].file_size
        path.write_bytes(
            data.replace(claimed.to_bytes(4, 'little'), (1 << 31).to_bytes(4, 'little'))
        )
        with pytest.raises(RecordingError, match=r'gyro.npy claims 2147483648 bytes'):
            open_source(path)

    @pytest.mark.slow
    def test_a_constant_column_is_no_bomb(self, tmp_path):
        """Zeros shrink a thousandfold."""
        np.savez_compressed(tmp_path / 'a.npz', stamp_s=np.arange(1e6), gyro=np.zeros((10**6, 3)))
        recording, _ = read(tmp_path / 'a.npz', units='angular_velocity=rad/s')
        assert len(recording) == 10**6


class TestMatlab:
    @pytest.mark.slow
    def test_variables_and_structs(self, tmp_path):
        path = tmp_path / 'a.mat'
        struct = {'accel': ACCELERATION, 'gyro': RATES, 'name': 'unit 7'}
        savemat(path, {'log': struct, 'time_s': TIME, 'Fs': 100.0})
        recording, problems = read(path, units=SI_UNITS)
        is_what_was_written(recording.samples)
        assert problems == []

    @pytest.mark.slow
    @pytest.mark.parametrize('form', ['4', '5'])
    def test_a_matrix(self, tmp_path, form):
        path = tmp_path / 'a.mat'
        savemat(path, {'data': np.hstack([ACCELERATION, RATES])}, format=form)
        recording, _ = read(path, columns='ax,ay,az,gx,gy,gz', units=SI_UNITS, rate_hz=100)
        is_what_was_written(recording.samples)

    def test_version_7_3_says_how_to_save_it(self, tmp_path):
        path = tmp_path / 'a.mat'
        header = b'MATLAB 7.3 MAT-file, Platform: GLNXA64'.ljust(124) + b'\x00\x02IM'
        path.write_bytes(header.ljust(512, b'\0') + b'\x89HDF\r\n\x1a\n' + bytes(500))
        with pytest.raises(RecordingError, match=r"HDF5\) is not read: .* save\(file, '-v7'\)"):
            open_source(path)

    @pytest.mark.slow
    def test_damage_is_one_line(self, tmp_path):
        path = tmp_path / 'a.mat'
        savemat(path, {'gyro': RATES})
        whole = path.read_bytes()
        for end in (1, 50, 128, 132, 500, len(whole) - 1):
            path.write_bytes(whole[:end])
            with pytest.raises(RecordingError) as caught:
                open_source(path)
            assert '\n' not in str(caught.value)

    def test_a_text_file_of_that_name_is_no_matlab_file(self, tmp_path):
        path = tmp_path / 'a.mat'
        path.write_text('a,b,c\n' * 100)
        with pytest.raises(RecordingError, match='damaged, or no MATLAB file'):
            open_source(path)

    def test_what_crashes_the_reader_of_scipy_is_one_line(self, tmp_path):
        """An array in a cell that says nothing of its numbers: found by fuzzing."""

        def element(kind, data):
            return struct.pack('<II', kind, len(data)) + data + bytes(-len(data) % 8)

        def head(kind, rows, name):
            flags = element(6, struct.pack('<II', kind, 0))
            return flags + element(5, struct.pack('<ii', rows, 1)) + element(1, name)

        cell = element(14, head(1, 10, b'a') + element(14, head(6, 0, b'')) * 10)
        path = tmp_path / 'a.mat'
        path.write_bytes(b'MATLAB 5.0 MAT-file'.ljust(124) + b'\0\1IM' + cell)
        with pytest.raises(RecordingError, match=r'a\.mat: damaged, or no MATLAB file: '):
            open_source(path)

    @pytest.mark.parametrize('compressed', [False, True])
    def test_cells_within_cells_do_not_fill_the_stack(self, tmp_path, compressed):
        def element(kind, data):
            return struct.pack('<II', kind, len(data)) + data + bytes(-len(data) % 8)

        head = element(6, struct.pack('<II', 1, 0)) + element(5, struct.pack('<ii', 1, 1))
        levels = 200_000
        content = element(14, head + element(1, b'') + b'')
        inner = len(content)
        parts = [content]
        for level in range(levels):
            name = element(1, b'a' if level == levels - 1 else b'')
            parts.append(struct.pack('<II', 14, len(head) + len(name) + inner) + head + name)
            inner += len(parts[-1])
        content = b''.join(reversed(parts))
        if compressed:
            packed = zlib.compress(content)
            content = struct.pack('<II', 15, len(packed)) + packed
        path = tmp_path / 'a.mat'
        path.write_bytes(b'MATLAB 5.0 MAT-file'.ljust(124) + b'\0\1IM' + content)
        with pytest.raises(RecordingError, match='a struct or cell of more than 1000 arrays'):
            open_source(path)


class TestFolders:
    def test_columns_of_the_simulation_need_no_option(self, tmp_path):
        folder = tmp_path / 'chip'
        folder.mkdir()
        start = 1_700_000_000_000_000_000
        np.save(folder / 'stamps.npy', start + 10_000_000 * np.arange(N))
        np.save(folder / 'acceleration.npy', ACCELERATION)
        np.save(folder / 'angular_velocity.npy', RATES)
        assert find_recordings(tmp_path) == (folder,)
        recording, problems = read(folder)
        assert (recording.topic, problems) == ('chip', [])
        assert recording.samples.stamps[0] == start
        is_what_was_written(recording.samples)

    def test_arrays_are_found(self, tmp_path):
        for name in ('a.npy', 'b.npz', 'c.mat', 'd.png'):
            (tmp_path / name).write_bytes(b'x')
        assert [path.name for path in find_recordings(tmp_path)] == ['a.npy', 'b.npz', 'c.mat']
