# SPDX-License-Identifier: Apache-2.0
"""Files that were refused and can be read: sentences, dates, split stamps, loose numbers."""

from datetime import datetime, timedelta, timezone

from imu_bench.cli.main import main
from imu_bench.errors import RecordingError
from imu_bench.offline.analysis.results import read
from imu_bench.offline.recordings import find_recordings, load_all
from imu_bench.offline.recordings.opening import open_source
from imu_bench.offline.recordings.source import ReadOptions
from imu_bench.offline.recordings.spelling import checksum
import numpy as np
import pytest

ROWS = 60
VALUES = [f'0.1,-0.2,9.8{k % 10}' for k in range(ROWS)]
EXPECTED = np.array([[0.1, -0.2, 9.8 + (k % 10) / 100] for k in range(ROWS)])
UNITS = {'units': 'linear_acceleration=m/s^2'}


def load(path, **options):
    source = open_source(path, ReadOptions(**options))
    return load_all(source, source.topics)[0], source.problems


def write(path, lines, head=''):
    path.write_text(head + '\n'.join(lines) + '\n', encoding='utf-8', newline='')
    return path


def test_checksums_of_real_devices():
    """An example of VectorNav UM001 (register 27), and lines that others have logged."""
    for line in (
        (
            b'$VNRRG,27,+006.380,+000.023,-001.953,+1.0640,-0.2531,+3.0614,+00.005,+00.344,-09.758,'
            b'-0.001222,-0.000450,-0.001218*4F'
        ),
        (
            b'$VNYMR,-078.104,+005.642,+023.096,+00.0125,+00.1252,-00.1042,+00.878,-03.762,-08.854,'
            b'-00.010387,-00.028062,-00.061305*68'
        ),
        b'$VNYMR,-165.918,-008.770,+000.198*7D',
    ):
        cells, _, told = line[1:].partition(b'*')
        assert checksum(cells) == int(told, 16)


def sentence(k):
    cells = (
        '-078.104,+005.642,+023.096,+00.0125,+00.1252,-00.1042,+00.878,-03.762,'
        f'-08.85{k % 10},-00.010387,-00.028062,-00.061305'
    )
    total = np.bitwise_xor.reduce(np.frombuffer(f'VNYMR,{cells}'.encode(), np.uint8))
    return f'$VNYMR,{cells}*{total:02X}'


@pytest.mark.parametrize('end', ['', '\r'])
def test_sentences(tmp_path, end):
    path = write(tmp_path / 'a.log', [sentence(k) + end for k in range(ROWS)])
    recording, problems = load(path, rate_hz=40.0)
    expected = [[0.878, -3.762, -8.85 - k / 1000] for k in range(3)]
    assert np.allclose(recording.samples.acceleration[:3], expected)
    assert np.allclose(recording.samples.angular_velocity[0], [-0.010387, -0.028062, -0.061305])
    # a gauss is 100 µT
    assert np.allclose(recording.samples.magnetic_field[0], [1.25e-6, 12.52e-6, -10.42e-6])
    assert len(recording) == ROWS and 'VNYMR' in problems[0]


def test_a_wrong_checksum_is_a_lost_sample(tmp_path):
    lines = [sentence(k) for k in range(ROWS)]
    lines[20] = lines[20].replace('-03.762', '-04.762')
    recording, problems = load(write(tmp_path / 'a.log', lines), rate_hz=40.0)
    assert len(recording) == ROWS - 1
    assert np.diff(recording.samples.stamps).max() == 50_000_000
    assert any('1 lines of the table' in problem and 'line 21' in problem for problem in problems)


BEGIN = datetime(2024, 2, 28, 23, 59, 59, 750_000, timezone.utc)
MOMENTS = [BEGIN + timedelta(milliseconds=10 * k) for k in range(ROWS)]
STAMPS = [round(BEGIN.timestamp() * 1000) * 1_000_000 + 10_000_000 * k for k in range(ROWS)]


@pytest.mark.parametrize(
    ('head', 'form', 'between'),
    [
        ('time,ax,ay,az\n', '{:%Y-%m-%dT%H:%M:%S.%fZ}', ','),
        ('time,ax,ay,az\n', '{:%Y-%m-%d %H:%M:%S.%f}', ','),
        ('date,time,ax,ay,az\n', '{:%Y-%m-%d,%H:%M:%S.%f}', ','),
        ('# date time ax ay az\n', '{:%Y/%m/%d %H:%M:%S.%f}', ' '),
        ('time;ax;ay;az\n', '{:%Y-%m-%d %H:%M:%S.%f}', ';'),
    ],
)
def test_dates(tmp_path, head, form, between):
    lines = [
        form.format(moment) + between + row.replace(',', between)
        for moment, row in zip(MOMENTS, VALUES, strict=True)
    ]
    recording, problems = load(write(tmp_path / 'a.csv', lines, head), **UNITS)
    assert recording.samples.stamps.tolist() == STAMPS
    assert np.allclose(recording.samples.acceleration, EXPECTED)
    assert any('UTC' in problem for problem in problems)


def test_whole_seconds_before_small_numbers(tmp_path):
    """No comma between cells is taken for that of a fraction of a second."""
    lines = [f'{BEGIN + timedelta(seconds=k):%Y-%m-%dT%H:%M:%S}+02:00,0,1,2' for k in range(9)]
    recording, _ = load(write(tmp_path / 'a.csv', lines, 'time,ax,ay,az\n'), **UNITS)
    first = int(BEGIN.timestamp()) - 7200
    assert recording.samples.stamps.tolist() == [(first + k) * 10**9 for k in range(9)]


@pytest.mark.parametrize('names', ['sec,nanosec', 'header.stamp.secs,header.stamp.nsecs'])
def test_seconds_and_nanoseconds(tmp_path, names):
    lines = [
        f'{stamp // 10**9},{stamp % 10**9},{row}'
        for stamp, row in zip(STAMPS, VALUES, strict=True)
    ]
    recording, _ = load(write(tmp_path / 'a.csv', lines, f'{names},ax,ay,az\n'), **UNITS)
    assert recording.samples.stamps.tolist() == STAMPS


def test_a_second_of_too_many_nanoseconds(tmp_path):
    path = write(
        tmp_path / 'a.csv',
        [f'{k},{2 * 10**9},{row}' for k, row in enumerate(VALUES)],
        'sec,nsec,ax,ay,az\n',
    )
    with pytest.raises(RecordingError, match='nanoseconds beside seconds'):
        load(path, **UNITS)


def test_ascii_of_matlab(tmp_path):
    """As save -ascii writes it: blanks, exponents, the suffix of a binary file."""
    path = tmp_path / 'a.mat'
    np.savetxt(path, np.column_stack([np.arange(ROWS) / 100, EXPECTED]), fmt='%16.7e')
    recording, _ = load(path, columns='stamp,ax,ay,az', units='SI')
    assert np.allclose(recording.samples.acceleration, EXPECTED)


@pytest.mark.parametrize('per_line', [8, 180])
def test_numbers_on_any_lines(tmp_path, per_line):
    numbers = [f'{value:.2f}' for value in EXPECTED.ravel()]
    lines = [' '.join(numbers[k : k + per_line]) for k in range(0, len(numbers), per_line)]
    path = write(tmp_path / 'a.txt', lines)
    options = {'columns': 'ax,ay,az', 'units': 'SI', 'rate_hz': 100.0}
    recording, _ = load(path, layout=3, **options)
    assert np.allclose(recording.samples.acceleration, EXPECTED)
    assert recording.topic == 'a' and recording.source == str(path)
    with pytest.raises(RecordingError, match='180 numbers are no rows of 7'):
        load(path, layout=7, **options)


def test_layout_from_the_command_line(tmp_path):
    rng = np.random.default_rng(1)
    path, out = tmp_path / 'a.txt', tmp_path / 'r.json'
    write(path, [' '.join(f'{v:.5f}' for v in rng.normal(0.0, 0.1, 3000))])
    arguments = ['--layout', '3', '--columns', 'gx,gy,gz', '--units', 'SI', '--rate', '100']
    assert main(['analyze', str(path), *arguments, '--json', str(out)]) == 0
    assert read(out).recordings[0].health.samples == 1000


def test_an_offset_before_scaling(tmp_path):
    lines = [f'{k / 100},32768,16384,49152' for k in range(ROWS)]
    path = write(tmp_path / 'a.csv', lines, 'stamp_s,ax,ay,az\n')
    recording, _ = load(path, units='linear_acceleration=(count-32768)*g/16384')
    assert np.allclose(recording.samples.acceleration, [0.0, -9.80665, 9.80665])


def test_halves_by_suffix(tmp_path):
    out, files = tmp_path / 'r.json', []
    rng = np.random.default_rng(2)
    for name, quantity in (
        ('walk_acc', 'linear_acceleration'),
        ('walk_gyro', 'angular_velocity'),
        ('run_gyro', 'angular_velocity'),
    ):
        rows = [
            f'{k / 100},{x:.6f},{y:.6f},{z:.6f}'
            for k, (x, y, z) in enumerate(rng.normal(0.0, 0.1, (500, 3)))
        ]
        head = ','.join(['stamp_s', *(f'{quantity}.{axis}' for axis in 'xyz')])
        files.append(str(write(tmp_path / f'{name}.csv', rows, f'{head}\n')))
    assert main(['analyze', *files, '--json', str(out)]) == 0
    sizes = {one.topic: len(one.axes) for one in read(out).recordings}
    assert sizes == {'walk_acc + walk_gyro': 6, 'run_gyro': 3}


METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  duration: {nanoseconds: 1}
  starting_time: {nanoseconds_since_epoch: 1}
  message_count: 10
  topics_with_message_count: []
  compression_format: ""
  compression_mode: ""
  relative_file_paths: [a_0.db3]
"""


@pytest.mark.parametrize(
    ('content', 'words'), [(b'', 'a_0.db3 is empty'), (b'\0' * 900, 'a_0.db3 is no storage file')]
)
def test_a_broken_file_beside_its_metadata(tmp_path, capsys, content, words):
    (tmp_path / 'a_0.db3').write_bytes(content)
    (tmp_path / 'metadata.yaml').write_text(METADATA, encoding='utf-8')
    assert main(['analyze', str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert words in error and 'damaged' in error and len(error.splitlines()) == 1


def test_metadata_without_its_bag_is_named(tmp_path):
    (tmp_path / 'metadata.yaml').write_text('rosbag2_bagfile_information: {}\n')
    with pytest.raises(RecordingError, match=r'folder: metadata\.yaml without its bag$'):
        find_recordings(tmp_path)
