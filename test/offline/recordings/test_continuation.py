# SPDX-License-Identifier: Apache-2.0
"""Logs of the two evaluation programs, and logs that go on in another file."""

from __future__ import annotations

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import grouped, load_all, open_source, ReadOptions
from imu_bench.offline.recordings.cache import fingerprint
import numpy as np
import pytest

G = 9.80665
HEADER = 'stamp_s,linear_acceleration.x,angular_velocity.z\n'


def read(path, options=None, **given):
    with open_source(path, options or ReadOptions(**given)) as source:
        [recording] = load_all(source, source.select())
        return recording, source.problems


def murata(n=400, *, seed=1, tilt_deg=(3.0, -8.0), start=0.0, rate=100.0):
    """Return the columns of appendix 11: time, status, acceleration zyx, inclination zyx, rest."""
    rng = np.random.default_rng(seed)
    x, y = np.sin(np.radians(tilt_deg))
    xyz = np.array([x, y, np.sqrt(1 - x * x - y * y)]) + rng.normal(0, 5e-4, (n, 3))
    others = np.sqrt((xyz**2).sum(axis=1, keepdims=True) - xyz**2)
    angles = np.degrees(np.arctan2(xyz, others))
    time = start + np.arange(n) / rate
    rest = np.tile([24.1, 0.0, 0.0], (n, 1))
    table = np.column_stack([time, np.zeros(n), xyz[:, ::-1], angles[:, ::-1], rest])
    return table, xyz


def write(path, table, header='', delimiter='\t'):
    np.savetxt(path, table, fmt='%.9g', delimiter=delimiter, header=header, comments='')
    return path


class TestMurata:
    @pytest.mark.parametrize('delimiter', ['\t', ';', ' '])
    @pytest.mark.parametrize('header', ['', 'names nobody knows'])
    def test_known_by_its_angles_and_told(self, tmp_path, delimiter, header):
        table, xyz = murata()
        path = write(tmp_path / 'log.txt', table, header, delimiter)
        recording, problems = read(path)
        np.testing.assert_allclose(recording.samples.acceleration, xyz * G, rtol=1e-6)
        assert recording.samples.angular_velocity is None
        assert np.diff(recording.samples.stamps).tolist() == [10_000_000] * 399
        [told] = problems
        assert told.startswith('log.txt: read as a log of Murata MEMS Demo: time in s, accel')

    @pytest.mark.parametrize(
        'spoil',
        [
            lambda table: table[:, 2:5].__imul__(G),  # m/s², or anything else that is not g
            lambda table: table[:, 5:8].__imul__(0.9),
            lambda table: table[:, 5:8].__iadd__(3.0),
            lambda table: table[:, 0].__imul__(0.0),
        ],
    )
    def test_what_does_not_fit_is_not_guessed(self, tmp_path, spoil):
        table, _ = murata()
        spoil(table)
        with pytest.raises(RecordingError, match='11 columns without names; name them as in'):
            open_source(write(tmp_path / 'log.txt', table))

    def test_angles_that_say_nothing_prove_nothing(self, tmp_path):
        """Three equal columns: any order would fit."""
        table, _ = murata(tilt_deg=(35.264, 35.264))
        with pytest.raises(RecordingError, match='columns without names'):
            open_source(write(tmp_path / 'log.txt', table))

    def test_the_user_knows_better(self, tmp_path):
        path = write(tmp_path / 'log.txt', murata()[0])
        recording, problems = read(
            path, columns='stamp,-,ax,ay,az', units='stamp=s,linear_acceleration=m/s^2'
        )
        assert problems == []
        assert recording.samples.acceleration[:, 0].mean() == pytest.approx(0.99, abs=0.01)

    def test_several_files_are_one_recording(self, tmp_path):
        tables = [murata(400, seed=k, start=4.0 * k)[0] for k in range(12)]
        paths = [write(tmp_path / f'test_{k + 1}.txt', t) for k, t in enumerate(tables)]
        kept, options = grouped(paths, ReadOptions())
        assert kept == [paths[0]]
        recording, problems = read(kept[0], options)
        assert len(recording) == 12 * 400
        assert np.diff(recording.samples.stamps).tolist() == [10_000_000] * 4799
        assert problems[-1] == (
            '12 files that continue each other are read as one recording: '
            'test_1.txt to test_12.txt'
        )


class TestSmartMotion:
    TEXT = 'index,ax,ay,az,gx,gy,gz\n' + ''.join(f'{k},0,0,2048,1,2,3\n' for k in range(5, 105))
    UNITS = 'linear_acceleration=g/2048,angular_velocity=deg/s/16.4'

    def test_needs_the_rate(self, tmp_path):
        path = tmp_path / 'log.csv'
        path.write_text(self.TEXT)
        with pytest.raises(RecordingError, match='no time column: give the sample rate with --ra'):
            open_source(path, ReadOptions(units=self.UNITS))
        recording, _ = read(path, units=self.UNITS, rate_hz=25)
        assert recording.stamp_source == 'rate'
        assert recording.samples.stamps[[0, -1]].tolist() == [200_000_000, 4_160_000_000]
        np.testing.assert_array_equal(recording.samples.acceleration[:, 2], G)

    def test_an_index_left_out_is_a_gap(self, tmp_path):
        path = tmp_path / 'log.csv'
        lines = self.TEXT.splitlines(keepends=True)
        path.write_text(''.join(lines[:20] + lines[30:]))
        recording, _ = read(path, units=self.UNITS, rate_hz=25)
        assert np.diff(recording.samples.stamps).max() == 11 * 40_000_000

    def test_without_names(self, tmp_path):
        path = tmp_path / 'log.txt'
        path.write_text(self.TEXT.split('\n', 1)[1])
        recording, _ = read(path, columns='index,ax,ay,az,gx,gy,gz', units=self.UNITS, rate_hz=50)
        assert np.diff(recording.samples.stamps).tolist() == [20_000_000] * 99


def joined(paths):
    return grouped(paths, ReadOptions())[1]


def series(folder, names, *, starts=None, rate=100.0, n=50, header=HEADER):
    """Return files of a log that goes on."""
    paths = []
    for k, name in enumerate(names):
        begin = k * n / rate if starts is None else starts[k]
        rows = ''.join(f'{begin + i / rate:.6f},{i},{k}\n' for i in range(n))
        (folder / name).write_text(header + rows)
        paths.append(folder / name)
    return paths


class TestContinuation:
    @pytest.mark.parametrize(
        'names',
        [
            ('log.csv', 'log_1.csv', 'log_2.csv'),
            ('log (1).csv', 'log (2).csv', 'log (10).csv'),
            ('log-2024-05-01_10.csv', 'log-2024-05-01_11.csv', 'log-2024-05-02_0.csv'),
        ],
    )
    def test_numbers_in_names_give_the_order(self, tmp_path, names):
        paths = series(tmp_path, names)
        kept, options = grouped(paths[::-1], ReadOptions())
        assert kept == [paths[0]]
        recording, _ = read(kept[0], options)
        assert recording.samples.angular_velocity[::50, 2].tolist() == [0, 1, 2]
        assert np.diff(recording.samples.stamps).tolist() == [10_000_000] * 149

    def test_one_file_named_is_one_file(self, tmp_path):
        paths = series(tmp_path, ('a_1.csv', 'a_2.csv'))
        kept, options = grouped(paths[:1], ReadOptions())
        assert (kept, options.join) == (paths[:1], ())
        assert len(read(kept[0], options)[0]) == 50

    @pytest.mark.parametrize('second', [0.0, 0.25, 5.0, -3.0])
    def test_times_that_do_not_go_on(self, tmp_path, second):
        paths = series(tmp_path, ('a_1.csv', 'a_2.csv'), starts=(0.0, second))
        assert grouped(paths, ReadOptions())[0] == paths

    def test_other_columns_do_not_go_on(self, tmp_path):
        paths = series(tmp_path, ('a_1.csv', 'a_2.csv'))
        other = HEADER.replace('linear_acceleration.x', 'linear_acceleration.y')
        paths[1].write_text(paths[1].read_text().replace(HEADER, other))
        assert grouped(paths, ReadOptions())[0] == paths

    def test_only_files_that_were_named_are_joined(self, tmp_path):
        first = series(tmp_path, ('a_1.csv', 'a_2.csv', 'a_3.csv'))
        second = series(tmp_path, ('b_1.csv', 'b_2.csv'))
        kept, options = grouped([*first[:2], second[0]], ReadOptions())
        assert kept == [first[0], second[0]]
        assert [len(read(path, options)[0]) for path in kept] == [100, 50]

    def test_what_was_kept_of_others_is_used_again(self, tmp_path):
        first = series(tmp_path, ('a_1.csv', 'a_2.csv'))
        [other] = series(tmp_path, ('b.csv',))
        assert fingerprint(other, joined(first)) == fingerprint(other, ReadOptions())

    def test_two_series_in_one_folder(self, tmp_path):
        first = series(tmp_path, ('a_1.csv', 'a_2.csv'))
        second = series(tmp_path, ('b_1.csv', 'b_2.csv'))
        kept, options = grouped([*first, *second], ReadOptions())
        assert kept == [first[0], second[0]]
        assert [len(read(path, options)[0]) for path in kept] == [100, 100]

    def test_a_damaged_file_in_between_ends_the_series(self, tmp_path):
        paths = series(tmp_path, ('a_1.csv', 'a_2.csv', 'a_3.csv'))
        paths[1].write_text('nothing of use')
        assert grouped(paths, ReadOptions())[0] == paths

    def test_a_line_that_is_no_row_is_told_with_its_file(self, tmp_path):
        paths = series(tmp_path, ('a_1.csv', 'a_2.csv'))
        paths[1].write_text(paths[1].read_text().replace('0.600000,10,1', 'x'))
        recording, problems = read(paths[0], joined(paths))
        assert len(recording) == 99
        assert problems[-1].endswith('1 lines of the table are no rows and were skipped, the '
                                     'first is its line 11 of a_2.csv')  # fmt: skip

    def test_what_was_kept_is_not_used_when_a_later_file_changed(self, tmp_path):
        paths = series(tmp_path, ('a_1.csv', 'a_2.csv'))
        before = fingerprint(paths[0], joined(paths))
        paths[1].write_text(paths[1].read_text() + '1.0,0,0\n')
        assert fingerprint(paths[0], joined(paths)) != before
