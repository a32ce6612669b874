# SPDX-License-Identifier: Apache-2.0
"""`imu-bench import`: one line per stream, and one clear line where it cannot be done."""

from __future__ import annotations

import errno
import json
import shutil

import numpy as np
import pytest

UNITS = 'stamp=ms,linear_acceleration=m/s^2'


def one_line(err):
    """Return the message of the only line on stderr."""
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith('imu-bench: error: ')
    return lines[0]


@pytest.fixture(scope='module')
def log(write_csv):
    """Return a CSV that `analyze` reads without an option."""
    return write_csv()


@pytest.fixture
def axes(imu_bench, tmp_path):
    """Return a function that analyses a recording and returns its numbers."""

    def run(path, *options):
        document = tmp_path / 'r.json'
        code, _, err = imu_bench('analyze', path, *options, '--json', document)
        assert (code, err) == (0, '')
        return [found['axes'] for found in json.loads(document.read_text('utf-8'))['recordings']]

    return run


@pytest.mark.slow
def test_an_analysis_of_what_was_imported_gives_the_same_numbers(imu_bench, axes, log, tmp_path):
    before = axes(log)
    source, outputs = log, []
    for name, form in (('bag', ()), ('a.csv', ()), ('db', ('--to', 'sqlite3'))):
        code, out, err = imu_bench('import', source, '-o', tmp_path / name, *form)
        assert (code, err) == (0, '')
        outputs.append(out)
        source = tmp_path / name
    assert axes(source) == before
    assert outputs[0] == (
        '/chip/imu/data_raw: 6\u202f000 samples, 60.0 s at 100.0 Hz; nothing left out; '
        'stamps are those of a clock of its own, not dates\n'
        f'wrote {tmp_path / "bag"}; next: imu-bench analyze {tmp_path / "bag"} '
        f'or ros2 bag info {tmp_path / "bag"}\n'
    )
    assert (tmp_path / 'bag' / 'bag_0.mcap').is_file()
    assert (tmp_path / 'db' / 'db_0.db3').is_file()


@pytest.mark.slow
@pytest.mark.data
def test_a_real_log_with_its_options(imu_bench, axes, shared_data, tmp_path):
    source = shared_data / 'elevator_phone' / 'data' / 'skyscrapper_up.csv'
    code, out, err = imu_bench('import', source, '--units', UNITS, '-o', tmp_path / 'ride')
    assert code == 0
    assert 'left out: 11 samples with values that are no numbers' in out
    assert all(line.startswith('note: ') for line in err.splitlines())
    assert 'note: skyscrapper_up: linear_acceleration.x: 8 NaN and 0 infinite' in err
    assert axes(tmp_path / 'ride') == axes(source, '--units', UNITS)


def test_without_a_clock_stamps_count_from_zero_and_that_is_said(imu_bench, tmp_path):
    log = tmp_path / 'raw.txt'
    np.savetxt(log, np.random.default_rng(1).normal(size=(50, 3)), delimiter=',')
    code, out, _ = imu_bench(
        'import', log, '--columns', 'ax,ay,az', '--rate', '50', '--units', 'SI',
        '-o', tmp_path / 'a.csv',
    )  # fmt: skip
    assert code == 0
    assert 'stamps count from 0 s at the given rate, since the source has no clock' in out
    lines = (tmp_path / 'a.csv').read_text().splitlines()
    assert [line.partition(',')[0] for line in lines[1:3]] == ['0.000000000', '0.020000000']


def test_a_failed_import_leaves_no_folder(imu_bench, log, tmp_path):
    nonsense = tmp_path / 'nonsense.mcap'
    nonsense.write_bytes(b'no bag')
    code, _, _ = imu_bench('import', log, nonsense, '-o', tmp_path / 'new' / 'one' / 'bag')
    assert code == 1
    assert not (tmp_path / 'new').exists()


def test_the_next_command_runs_as_printed(imu_bench, log, tmp_path):
    output = tmp_path / 'my bag'
    _, out, _ = imu_bench('import', log, '-o', output)
    assert f"next: imu-bench analyze '{output}' or ros2 bag info '{output}'\n" in out


def test_several_streams_are_topics_or_files(imu_bench, write_csv, tmp_path):
    logs = [write_csv(name, n=200) for name in ('left.csv', 'right.csv')]
    code, out, _ = imu_bench('import', *logs, '-o', tmp_path / 'bag')
    assert code == 0
    assert out.startswith('/left/imu/data_raw: 200 samples')
    assert '\n/right/imu/data_raw: 200 samples' in out
    code, _, _ = imu_bench('import', tmp_path / 'bag', '-o', tmp_path / 'both', '--to', 'csv')
    assert code == 0
    assert sorted(file.name for file in (tmp_path / 'both').iterdir()) == ['left.csv', 'right.csv']
    code, _, err = imu_bench('import', tmp_path / 'bag', '-o', tmp_path / 'one.csv')
    assert code == 1
    assert 'one.csv: one CSV holds one stream' in one_line(err)
    assert not (tmp_path / 'one.csv').exists()
    code, _, _ = imu_bench(
        'import', tmp_path / 'bag', '--topic', '/left/imu/data_raw', '-o', tmp_path / 'one.csv'
    )
    assert code == 0


def test_accelerometer_and_gyroscope_in_two_files_are_a_pair_afterwards(imu_bench, axes, tmp_path):
    rng = np.random.default_rng(1)
    paths = []
    for name, rate in (('Accelerometer', 50.0), ('Gyroscope', 100.0)):
        rows = np.column_stack([np.arange(1000) / rate, rng.normal(size=(1000, 3))])
        paths.append(tmp_path / f'{name}.csv')
        np.savetxt(paths[-1], rows, delimiter=',', header='time_s,x,y,z', comments='')
    units = ('--units', 'linear_acceleration=m/s^2,angular_velocity=rad/s')
    code, out, _ = imu_bench('import', *paths, *units, '-o', tmp_path / 'bag')
    assert code == 0
    assert out.startswith('/Accelerometer/imu/data_raw: 1\u202f000 samples, 20.0 s at 50.00 Hz')
    [together] = axes(tmp_path / 'bag')
    assert len(together) == 6


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['none.csv', '-o', '{out}/a'], 'none.csv: no such file or folder'),
        (['{log}', '-o', '{out}'], 'exists already; name another output with -o'),
        (['{log}', '-o', '{log}'], 'exists already; name another output with -o'),
        (['{log}', '-o', '{out}/a.mcap'], 'a bag is a folder: name it without .mcap, as in -o'),
        (['{log}', '-o', '{out}/a.csv', '--to', 'mcap'], 'a bag is a folder: name it without'),
        (['{log}', '-o', '{out}/a.npy', '--to', 'npy'], 'columns are a folder: name it without'),
        (['{log}', '-o', '{out}/no/a.csv'], 'no does not exist'),
        (['{log}', '-o', '{out}/a', '--topic', 'b'], "no topic 'b'; it holds chip (text, 6000)"),
        (['{log}', '-o', '{out}/a', '--rate', '0'], '--rate 0: the sample rate must be above 0'),
        (['{log}', '-o', '{out}/a', '--columns', 'ax,ay'], 'is not known: add it, for example'),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_writes_nothing(imu_bench, log, tmp_path, arguments, text):
    code, out, err = imu_bench(
        'import', *(part.format(log=log, out=tmp_path) for part in arguments)
    )
    assert (code, out) == (1, '')
    assert text in one_line(err)
    assert list(tmp_path.iterdir()) == []


def test_the_errors_of_reading_are_those_of_analyze(imu_bench, tmp_path):
    log = tmp_path / 'log.csv'
    log.write_text('a;b\n1;2\n3;4\n')
    _, _, expected = imu_bench('analyze', log)
    code, _, err = imu_bench('import', log, '-o', tmp_path / 'out')
    assert (code, err) == (1, expected)


def test_no_output_is_wrong_usage(imu_bench, log):
    code, _, err = imu_bench('import', log)
    assert code == 2
    assert '-o/--output' in err


@pytest.mark.parametrize(
    ('name', 'form', 'where'),
    [
        ('a', 'mcap', 'imu_bench.bags.mcap_writer.McapWriter.write_many'),
        ('a', 'sqlite3', 'imu_bench.bags.sqlite_writer.SqliteWriter.write_many'),
        ('a', 'npy', 'imu_bench.bags.columns.ColumnWriter.write'),
        ('a', 'csv', 'imu_bench.offline.imports.outputs.rows'),
        ('a.csv', 'csv', 'imu_bench.offline.imports.outputs.rows'),
    ],
)
@pytest.mark.parametrize('full', [True, False])
def test_a_full_disk_or_a_stop_leaves_nothing(
    imu_bench, log, tmp_path, monkeypatch, name, form, where, full
):
    def fail(*_):
        if full:
            raise OSError(errno.ENOSPC, 'No space left on device')
        raise KeyboardInterrupt

    monkeypatch.setattr(where, fail)
    code, out, err = imu_bench('import', log, '-o', tmp_path / name, '--to', form)
    assert out == ''
    assert list(tmp_path.iterdir()) == []
    if full:
        assert code == 1
        words = one_line(err)
        assert f'{tmp_path / name}: ' in words
        assert 'unfinished' not in words
        assert 'disk is full' in words or 'No space left' in words
    else:
        assert (code, err) == (130, 'imu-bench: stopped\n')


def test_what_a_killed_import_left_is_no_hindrance(imu_bench, log, tmp_path):
    (tmp_path / '.unfinished-a.csv').write_text('stamp_s')
    shutil.copytree(tmp_path, tmp_path / '.unfinished-a' / 'a')
    for name in ('a.csv', 'a'):
        assert imu_bench('import', log, '-o', tmp_path / name)[0] == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a', 'a.csv']
