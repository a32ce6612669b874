# SPDX-License-Identifier: Apache-2.0
"""CSV and text: layouts, columns, units, rates; and what is refused with what to add."""

from __future__ import annotations

import math

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import cells, load, open_source, ReadOptions
import numpy as np
import pytest

G = 9.80665
DEGREE = math.pi / 180


@pytest.fixture
def csv(tmp_path):
    """Return a maker of files that reads them back: (text, **options) -> Recording."""

    def read(text: str | bytes, name: str = 'log.csv', **options):
        path = tmp_path / name
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        source = open_source(path, ReadOptions(**options))
        recording = load(source, source.select()[0])
        recording_problems.clear()
        recording_problems.extend(source.problems)
        return recording

    recording_problems: list[str] = []
    read.problems = recording_problems
    return read


NATIVE = (
    'stamp_s, linear_acceleration.x, linear_acceleration.y, linear_acceleration.z, '
    'angular_velocity.x, angular_velocity.y, angular_velocity.z\n'
)


class TestNative:
    def test_needs_no_option(self, csv):
        recording = csv(
            NATIVE + '1700000000.123456789, 1, 2, 3, 4, 5, 6\n1700000000.2,7,8,9,1,2,3\n'
        )
        samples = recording.samples
        assert samples.stamps.tolist() == [1700000000123456789, 1700000000200000000]
        assert samples.acceleration.tolist() == [[1, 2, 3], [7, 8, 9]]
        assert samples.angular_velocity.tolist() == [[4, 5, 6], [1, 2, 3]]
        assert (recording.topic, recording.stamp_source) == ('log', 'column')
        assert recording.notes == ()
        assert csv.problems == []

    def test_any_subset_of_the_axes_will_do(self, csv):
        recording = csv('stamp_s,angular_velocity.z\n0,1\n0.01,2\n')
        assert recording.samples.acceleration is None
        assert recording.samples.angular_velocity[:, 2].tolist() == [1, 2]
        assert np.isnan(recording.samples.angular_velocity[:, :2]).all()

    def test_magnetic_field_and_temperature_come_along(self, csv):
        recording = csv(
            'stamp_s,linear_acceleration.x,magnetic_field.z,temperature [degC]\n'
            '0,1,2e-5,21\n1,1,3e-5,22\n'
        )
        assert recording.samples.magnetic_field[:, 2].tolist() == [2e-5, 3e-5]
        assert recording.samples.temperature.tolist() == [21, 22]

    def test_what_ros_tools_export_is_native_too(self, csv):
        """Columns of rostopic echo -p: stamps in ns, fields with their path, text between."""
        recording = csv(
            '%time,field.header.seq,field.header.stamp,field.header.frame_id,'
            'field.orientation.x,field.angular_velocity.x,field.linear_acceleration.x,'
            'field.linear_acceleration_covariance0\n'
            '1432235782066391229,1,1432235782066391339,imu_link,0,0.5,9.5,0.01\n'
            '1432235782166391229,2,1432235782166391339,imu_link,0,0.6,9.6,0.01\n'
        )
        assert recording.samples.stamps.tolist() == [1432235782066391339, 1432235782166391339]
        assert recording.samples.acceleration[:, 0].tolist() == [9.5, 9.6]
        assert recording.samples.angular_velocity[:, 0].tolist() == [0.5, 0.6]

    def test_units_in_the_header_are_the_word_of_the_file(self, csv):
        """The header of the EuRoC data sets."""
        recording = csv(
            '#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],'
            'a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n'
            '1403636579758555392,-0.1,0.2,0.3,9.1,0.4,-3.0\n'
            '1403636579763555584,-0.2,0.2,0.3,9.2,0.4,-3.1\n'
        )
        assert recording.samples.stamps.tolist() == [1403636579758555392, 1403636579763555584]
        assert recording.samples.acceleration[:, 0].tolist() == [9.1, 9.2]
        assert recording.samples.angular_velocity[:, 0].tolist() == [-0.1, -0.2]

    def test_degrees_in_the_header_are_converted(self, csv):
        recording = csv('time_ms;gyro_x (deg/s);acc_x (g)\n0;180;1\n10;90;2\n')
        assert recording.samples.angular_velocity[:, 0].tolist() == [math.pi, math.pi / 2]
        assert recording.samples.acceleration[:, 0].tolist() == [G, 2 * G]
        assert recording.samples.stamps.tolist() == [0, 10_000_000]


class TestLayouts:
    EXPECTED = ((1.0, -2.0, 3.5), (4.0, 5.0, -6.25))

    @pytest.mark.parametrize(
        'text',
        [
            'ax,ay,az\n1,-2,3.5\n4,5,-6.25\n',
            'ax,ay,az\r\n1,-2,3.5\r\n4,5,-6.25\r\n',
            '\ufeffax,ay,az\n1,-2,3.5\n4,5,-6.25\n',
            'ax;ay;az\n1;-2;3.5\n4;5;-6.25\n',
            'ax;ay;az\n1,0;-2,0;3,5\n4,0;5,0;-6,25\n',
            'ax\tay\taz\n1\t-2\t3.5\n4\t5\t-6.25\n',
            'ax ay az\n1 -2 3.5\n4 5 -6.25\n',
            '  ax   ay    az\n   1   -2   3.5\n   4    5  -6.25\n',
            '# ax, ay, az\n1, -2, 3.5\n4, 5, -6.25\n',
            '% a comment\n% another\nax,ay,az\n1,-2,3.5\n4,5,-6.25\n',
            'Sensor: own\nDate: today\n\nax,ay,az\n1,-2,3.5\n4,5,-6.25\n',
            'ax,ay,az,\n1,-2,3.5,\n4,5,-6.25,\n',
            'ax,ay,az\n1,-2,3.5,\n4,5,-6.25,\n',
            '"ax","ay","az"\n"1","-2","3.5"\n"4","5","-6.25"\n',
            'ax,ay,az,label\n1,-2,3.5,still\n4,5,-6.25,moving\n',
            'ax,ay,az\n1e0,-2E+0,35e-1\n4,5,-6.25\n\n\n',
        ],
    )
    def test_is_detected(self, csv, text):
        recording = csv(text, rate_hz=100, units='SI')
        assert recording.samples.acceleration.tolist() == [list(row) for row in self.EXPECTED]
        assert recording.samples.stamps.tolist() == [0, 10_000_000]
        assert csv.problems == []

    def test_a_last_line_without_an_end_may_be_cut(self, csv):
        recording = csv('ax,ay,az\n1,-2,3.5\n4,5,-6.25', rate_hz=100, units='SI')
        assert recording.samples.acceleration.tolist() == [list(row) for row in self.EXPECTED]
        [problem] = csv.problems
        assert 'no line end' in problem

    def test_utf16_is_named(self, csv):
        with pytest.raises(RecordingError, match='UTF-16 text: save it as UTF-8'):
            csv('ax,ay,az\n1,2,3\n4,5,6\n'.encode('utf-16'))

    def test_a_header_in_the_middle_and_a_cut_off_row_are_skipped_and_said(self, csv):
        recording = csv(
            'stamp_s,linear_acceleration.x\n0,1\n1,2\nstamp_s,linear_acceleration.x\n2,3\n3'
        )
        assert recording.samples.acceleration[:, 0].tolist() == [1, 2, 3]
        assert csv.problems[1:] == [
            'log.csv: 2 lines of the table are no rows and were skipped, the first is its line 3'
        ]

    def test_a_skipped_row_is_a_gap_when_stamps_come_from_the_rate(self, csv):
        recording = csv('ax\n1\n2\n?\n4\n', rate_hz=10, units='SI')
        assert recording.samples.stamps.tolist() == [0, 100_000_000, 300_000_000]

    def test_an_empty_cell_is_a_missing_number(self, csv):
        recording = csv(NATIVE + '0,1,2,3,4,5,6\n1,1,,3,4,5,6\n2,1,2,3,4,5,\n3,1,2,3,4,5,6\n' * 20)
        assert recording.left_out == 40
        assert recording.notes == (
            'linear_acceleration.y: 20 NaN and 0 infinite values left out',
            'angular_velocity.z: 20 NaN and 0 infinite values left out',
        )

    def test_a_temperature_now_and_then_costs_no_sample(self, csv):
        rows = [f'{i},{i},{20 if i % 10 == 0 else ""}' for i in range(50)]
        recording = csv('stamp_s,linear_acceleration.x,temp_c\n' + '\n'.join(rows))
        assert (len(recording), recording.left_out) == (50, 0)
        assert recording.samples.temperature is None
        assert recording.notes == (
            'temperature is not used: it has numbers in 5 of 50 samples only',
        )

    def test_a_million_rows_take_several_blocks(self, csv, monkeypatch):
        monkeypatch.setattr(cells, 'BLOCK', 4096)
        rows = [f'{index / 1000},{index},{-index}' for index in range(20_000)]
        recording = csv('stamp_s,linear_acceleration.x,angular_velocity.y\n' + '\n'.join(rows))
        assert len(recording) == 20_000
        assert recording.samples.acceleration[:, 0].tolist() == list(range(20_000))
        assert recording.samples.stamps.tolist() == [1_000_000 * i for i in range(20_000)]


class TestColumns:
    def test_by_position(self, csv):
        recording = csv(
            '9 0.1 1 2 3 7\n9 0.2 4 5 6 7\n',
            columns='-,stamp_s,ax,ay,az',
            units='linear_acceleration=g',
        )
        assert recording.samples.acceleration.tolist() == [
            [G, 2 * G, 3 * G],
            [4 * G, 5 * G, 6 * G],
        ]
        assert recording.samples.stamps.tolist() == [100_000_000, 200_000_000]

    def test_by_name(self, csv):
        recording = csv(
            'when,first,second,gx\n0,1,2,3\n1,4,5,6\n',
            columns='when=stamp,first=linear_acceleration.z,gx=-',
            units='stamp=s,linear_acceleration=m/s^2',
        )
        assert recording.samples.acceleration[:, 2].tolist() == [1, 4]
        assert recording.samples.angular_velocity is None

    def test_named_columns_leave_the_others_to_their_names(self, csv):
        recording = csv('tick,ax,ay\n0,1,2\n1,4,5\n', columns='tick=stamp', units='SI')
        assert recording.samples.acceleration[:, :2].tolist() == [[1, 2], [4, 5]]

    @pytest.mark.parametrize(
        ('names', 'vector'),
        [
            ('ax,ay,az', 'acceleration'),
            ('AccX,AccY,AccZ', 'acceleration'),
            ('Acc_X,Acc_Y,Acc_Z', 'acceleration'),
            ('accel x,accel y,accel z', 'acceleration'),
            ('Accelerometer X,Accelerometer Y,Accelerometer Z', 'acceleration'),
            ('linear_acceleration_x,linear_acceleration_y,linear_acceleration_z', 'acceleration'),
            ('x_acc,y_acc,z_acc', 'acceleration'),
            ('imu_acc_x,imu_acc_y,imu_acc_z', 'acceleration'),
            ('gx,gy,gz', 'angular_velocity'),
            ('wx,wy,wz', 'angular_velocity'),
            ('GyroX,GyroY,GyroZ', 'angular_velocity'),
            ('gyr_x_raw,gyr_y_raw,gyr_z_raw', 'angular_velocity'),
            ('omega_x,omega_y,omega_z', 'angular_velocity'),
        ],
    )
    def test_usual_names_are_known(self, csv, names, vector):
        recording = csv(f'{names}\n1,2,3\n4,5,6\n', units='SI', rate_hz=1)
        assert getattr(recording.samples, vector).tolist() == [[1, 2, 3], [4, 5, 6]]

    def test_an_index_leaves_gaps(self, csv):
        recording = csv('n_samples,ax\n0,1\n1,2\n5,3\n', units='SI', rate_hz=100)
        assert recording.samples.stamps.tolist() == [0, 10_000_000, 50_000_000]

    @pytest.mark.parametrize(
        ('text', 'options', 'message'),
        [
            ('a,b\n1,2\n3,4\n', {}, 'no column with an acceleration or angular velocity'),
            ('a,b\n1,2\n3,4\n', {}, 'the columns are a, b; name them as in --columns linear_acc'),
            ('1,2\n3,4\n', {}, 'the file has 2 columns without names'),
            ('ax,ay\n1,2\n3,4\n', {'columns': 'az=stamp'}, "no column 'az'; the columns are ax"),
            ('ax,ay\n1,2\n3,4\n', {'columns': 'ax=up'}, "unknown name 'up'; known are linear"),
            ('ax,ay\n1,2\n3,4\n', {'columns': 'ax,ay,az'}, 'names 3 columns, the file has 2'),
            ('ax,ay\n1,2\n3,4\n', {'columns': 'ax=ax,ay'}, 'either every entry is of the form'),
            ('ax,acc_x\n1,2\n3,4\n', {}, "columns 'ax' and 'acc_x' both look like linear_acc"),
            ('ax,ay,az\n1,up,2\n3,down,4\n', {'units': 'SI'}, "column 'ay' does not hold numbers"),
            (
                'ax\n1\n2\n',
                {'units': 'SI'},
                'there is no time column: give the sample rate with --rate HZ',
            ),
            (
                'Fs,100\nax,ay\n1,2\n3,4\n',
                {'units': 'SI'},
                r'--rate 100 \(a line before the table',
            ),
            ('index,ax\n0,1\n1,2\n,3\n', {'units': 'SI', 'rate_hz': 1}, 'holds no usable'),
            ('1 2 3 4 5 6 7 8', {}, 'numbers without rows: say how many make a sample, as in --l'),
            (
                'time,ax,ay\n31.12.2024 10:00:00,1,1\n31.12.2024 10:00:01,2,2\n',
                {'units': 'SI'},
                "column 'time' does not hold numbers; dates are read as in 2001-09-09 01:46:40.5",
            ),
        ],
    )
    def test_what_is_wrong_is_said_with_what_to_do(self, csv, text, options, message):
        with pytest.raises(RecordingError, match=message) as caught:
            csv(text, **options)
        assert '\n' not in str(caught.value)


class TestUnits:
    TABLE = 'time,ax,gx,temp\n0,16384,131,20\n1,32768,262,21\n'

    def test_counts_per_unit(self, csv):
        recording = csv(
            self.TABLE, units='stamp=s,linear_acceleration=g/16384,angular_velocity=deg/s/131'
        )
        assert recording.samples.acceleration[:, 0].tolist() == [G, 2 * G]
        np.testing.assert_allclose(
            recording.samples.angular_velocity[:, 0], [DEGREE, 2 * DEGREE], rtol=1e-15
        )
        assert csv.problems == [
            "column 'temp' is not used: its unit is not known; add temperature=degC to --units"
        ]

    def test_units_per_count(self, csv):
        recording = csv(self.TABLE, units='time=ms,acc=mg*0.061,gyro=mdps*8.75,temp=degC')
        assert recording.samples.acceleration[0, 0] == pytest.approx(16384 * 0.061e-3 * G)
        assert recording.samples.angular_velocity[0, 0] == pytest.approx(131 * 8.75e-3 * DEGREE)
        assert recording.samples.temperature.tolist() == [20, 21]
        assert recording.samples.stamps.tolist() == [0, 1_000_000]

    def test_one_axis_or_column_may_have_its_own(self, csv):
        recording = csv(
            'stamp_s,ax,ay,az\n0,1,1,1\n1,1,1,1\n',
            units='acc=m/s^2,linear_acceleration.y=g,az=mg',
        )
        np.testing.assert_allclose(recording.samples.acceleration[0], [1, G, G / 1000], rtol=1e-15)

    def test_go_by_the_names_that_columns_were_given(self, csv):
        """As in --columns t,ax,gx --units t=ms,ax=g,gyro=deg/s."""
        recording = csv('1,1,1\n2,1,1\n', columns='t,ax,gx', units='t=ms,ax=g,gyro=deg/s')
        assert recording.samples.stamps.tolist() == [1_000_000, 2_000_000]
        assert recording.samples.acceleration[0, 0] == pytest.approx(G)
        assert recording.samples.angular_velocity[0, 0] == pytest.approx(DEGREE)

    @pytest.mark.parametrize(
        ('units', 'message'),
        [
            (None, 'the unit of stamp and linear_acceleration and angular_velocity is not known'),
            ('stamp=s,gyro=deg/s', 'the unit of linear_acceleration is not known'),
            ('acc=g', '--units acc=g,stamp=ms,angular_velocity=deg/s/131; '),
            ('acc=furlong', "acceleration=furlong: unknown unit 'furlong'"),
            ('acc=deg/s', "'°/s' measures angular velocity and cannot be given in"),
            ('acc=g/0', 'the number must not be 0'),
            ('acc', "'acc' is not of the form name=unit; write for example"),
            ('acc=g,acc=mg', "'acc' is given twice"),
            ('pressure=Pa', "nothing is called 'pressure'; known are "),
        ],
    )
    def test_are_never_guessed(self, csv, units, message):
        with pytest.raises(RecordingError, match=message):
            csv(self.TABLE, units=units)

    def test_naming_a_column_does_not_make_it_si(self, csv):
        with pytest.raises(RecordingError, match='the unit of linear_acceleration is not known'):
            csv('1,2\n3,4\n', columns='stamp_s,linear_acceleration.x')


class TestStamps:
    @pytest.mark.parametrize(
        ('unit', 'cell', 'stamp_ns'),
        [
            ('s', '1700000000.123456789', 1700000000123456789),
            ('s', '1700000000.1234567894', 1700000000123456789),
            ('s', '1700000000.1234567896', 1700000000123456790),
            ('s', '0', 0),
            ('s', '.5', 500_000_000),
            ('s', '-1.5', -1_500_000_000),
            ('s', '1.5e3', 1_500_000_000_000),
            ('ms', '1700000000123.456789', 1700000000123456789),
            ('us', '1700000000123456.789', 1700000000123456789),
            ('ns', '1700000000123456789', 1700000000123456789),
            ('min', '1.5', 90_000_000_000),
        ],
    )
    def test_are_exact_to_the_nanosecond(self, csv, unit, cell, stamp_ns):
        recording = csv(f't,ax\n{cell},1\n{cell},2\n', units=f't={unit},acc=g')
        assert recording.samples.stamps.tolist() == [stamp_ns, stamp_ns]

    @pytest.mark.parametrize('cell', ['1e30', 'inf', 'nan'])
    def test_that_cannot_be_are_refused(self, csv, cell):
        with pytest.raises(RecordingError, match='a time stamp is not finite or does not fit'):
            csv(f'stamp_s,linear_acceleration.x\n0,1\n{cell},2\n')

    def test_a_rate_does_not_replace_a_time_column(self, csv):
        recording = csv('stamp_s,linear_acceleration.x\n0,1\n1,2\n', rate_hz=100)
        assert recording.samples.stamps.tolist() == [0, 1_000_000_000]
        assert csv.problems == ['--rate is not used: the file has a time column']

    def test_a_rate_that_is_no_whole_number_keeps_its_phase(self, csv):
        recording = csv('ax\n' + '1\n' * 1025, units='SI', rate_hz=102.4)
        assert recording.samples.stamps[-1] == 10_000_000_000
        assert recording.stamp_source == 'rate'


class TestRowsThatHoldPartsOfASample:
    ROWS = (
        't,ax,ay,az\n0,,,3\n1,1,2,\n20,,5,\n21,4,,6\n'
        '40,7,8,9\n60,1,,\n60,,2,\n61,,,3\n80,1,2,\n100,1,2,3\n'
    )

    def test_are_joined(self, csv):
        recording = csv(self.ROWS, units='t=ms,acc=m/s^2')
        assert recording.samples.acceleration.tolist() == [
            [1, 2, 3],
            [4, 5, 6],
            [7, 8, 9],
            [1, 2, 3],
            [1, 2, 3],
        ]
        assert recording.samples.stamps.tolist() == [
            1_000_000 * stamp for stamp in (0, 20, 40, 60, 100)
        ]
        assert recording.left_out == 1  # the row at 80 ms has no z
        assert csv.problems == [
            'log.csv: the columns are filled in different rows: 10 rows were joined into 6 samples'
        ]

    def test_are_joined_across_blocks(self, csv, monkeypatch):
        whole = csv(self.ROWS, units='t=ms,acc=m/s^2')
        monkeypatch.setattr(cells, 'BLOCK', 16)
        pieces = csv(self.ROWS, units='t=ms,acc=m/s^2')
        assert pieces.samples.acceleration.tolist() == whole.samples.acceleration.tolist()
        assert pieces.samples.stamps.tolist() == whole.samples.stamps.tolist()
