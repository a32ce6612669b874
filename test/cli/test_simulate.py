# SPDX-License-Identifier: Apache-2.0
"""`imu-bench simulate`: bags of benches, scenarios and results; bad input is one clear line."""

import errno
import json
import shutil

import numpy as np
import pytest


@pytest.fixture
def own_bench(tmp_path):
    """Return the file of a bench with two small sensors."""
    for name, rate in (('left', 100.0), ('right', 50.0)):
        (tmp_path / f'{name}.yaml').write_text(
            '/**:\n  ros__parameters:\n    driver: generic\n    backend: emulated\n'
            f'    rate_hz: {rate}\n    simulation:\n      acceleration:\n'
            '        noise_density: "300 µg/√Hz"\n        bias: "20 mg"\n',
            encoding='utf-8',
        )
    bench = tmp_path / 'pair.yaml'
    bench.write_text(
        'name: pair\nsensors: [{file: left.yaml}, {file: right.yaml}]\n'
        'recorder: {storage: sqlite3}\n',
        encoding='utf-8',
    )
    return bench


def one_line(err):
    """Return the message of the only line on stderr."""
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith('imu-bench: error: ')
    return lines[0]


def test_a_bag_of_a_bench_that_analyze_reads(imu_bench, own_bench, tmp_path):
    bag, result = tmp_path / 'bag', tmp_path / 'r.json'
    code, out, err = imu_bench('simulate', own_bench, '--duration', '5min', '-o', bag)
    assert (code, err) == (0, '')
    assert '45000 messages, 300 s in ' in out
    assert (bag / 'bag_0.db3').is_file()
    code, _, _ = imu_bench('analyze', bag, '--json', result)
    assert code == 0
    truth = json.loads((bag / 'truth.json').read_text(encoding='utf-8'))
    found = json.loads(result.read_text(encoding='utf-8'))
    assert len(found['recordings']) == 2
    for recording in found['recordings']:
        name = recording['topic'].split('/')[2]
        axis = recording['axes']['linear_acceleration.x']
        expected = truth['sensors'][name]['axes']['linear_acceleration.x']
        n = expected['coefficients']['N']['value']
        assert axis['coefficients']['N']['value'] == pytest.approx(n, rel=0.03)
        assert axis['mean']['value'] == pytest.approx(expected['at_start']['value'], abs=2e-3)


def test_options_of_text_files_are_said_to_be_unused_on_a_bag(imu_bench, own_bench, tmp_path):
    bag = tmp_path / 'out' / 'bag'
    imu_bench('simulate', own_bench, '--duration', '20s', '-o', bag)
    # what a killed simulation leaves is no recording
    (bag.parent / '.unfinished-other').mkdir()
    shutil.copytree(bag, bag.parent / '.unfinished-other' / 'other')
    code, out, _ = imu_bench(
        'analyze', bag.parent, '--full', '--topic', '/bench/left/imu/data_raw',
        '--rate', '5', '--units', 'foo=bar',
    )  # fmt: skip
    assert code == 0
    assert out.count('--rate and --units are not used: a bag has ') == 1


def test_the_twin_of_a_result_is_simulated_and_its_files_are_written(
    imu_bench, own_bench, tmp_path
):
    bag, result, twin = tmp_path / 'bag', tmp_path / 'r.json', tmp_path / 'second'
    imu_bench('simulate', own_bench, '--duration', '3min', '-o', bag)
    imu_bench('analyze', bag, '--json', result)
    code, out, err = imu_bench('simulate', '--from', result, '--duration', '1min', '-o', twin)
    assert (code, err) == (0, '')
    assert '9000 messages' in out
    assert sorted(path.name for path in (twin / 'twin').iterdir()) == [
        'bench.yaml', 'left.yaml', 'right.yaml'
    ]  # fmt: skip
    code, _, _ = imu_bench(
        'simulate', twin / 'twin' / 'bench.yaml', '--duration', '2s', '-o', tmp_path / 'third'
    )
    assert code == 0


def test_another_seed_is_another_run_and_the_same_one_the_same(imu_bench, own_bench, tmp_path):
    def force(folder, *options):
        imu_bench(
            'simulate', own_bench, '--duration', '5s', '--storage', 'npy',
            '-o', tmp_path / folder, *options,
        )  # fmt: skip
        return np.load(tmp_path / folder / 'left' / 'acceleration.npy')

    first = force('a')
    np.testing.assert_array_equal(first, force('b'))
    assert not np.array_equal(first, force('c', '--seed', '1'))


def test_a_scenario_brings_its_duration_and_can_be_changed(imu_bench, own_bench, tmp_path):
    code, out, err = imu_bench(
        'simulate', own_bench, '--scenario', 'sine', '--set', 'sine.frequency=90 Hz',
        '--set', 'axis=x', '--storage', 'npy', '-o', tmp_path / 'out',
    )  # fmt: skip
    assert code == 0
    assert '9000 samples, 60 s in' in out
    # allowed, and said
    assert err.count('note: ') == 2
    assert 'left: sine at 90 Hz goes above half its rate (50 Hz)' in err
    x = np.load(tmp_path / 'out' / 'left' / 'acceleration.npy')[:, 0]
    line = np.abs(np.fft.rfft(x - x.mean())).argmax() / 60.0
    assert line == pytest.approx(10.0, abs=0.02)


def test_the_file_of_a_sensor_is_a_bench_of_one(imu_bench, own_bench, tmp_path):
    """It was refused, while `record` took it; `analyze` knows the sensor by its name."""
    alone = next(own_bench.parent.glob('left*.yaml'))
    bag = tmp_path / 'bag'
    code, out, _ = imu_bench('simulate', alone, '--duration', '20s', '-o', bag)
    assert (code, '20 s in' in out) == (0, True)
    code, out, _ = imu_bench('analyze', bag, '--topic', alone.stem)
    assert code == 0
    assert '1 sensor, 20.0 s' in out


def test_a_shipped_bench_by_its_name(imu_bench, tmp_path):
    code, out, _ = imu_bench(
        'simulate', 'vehicle_vibration', '--scenario', 'sine_on_random_sc1',
        '--set', 'zones.before=2 s', '--set', 'zones.test=3 s', '--set', 'zones.after=1 s',
        '-o', tmp_path / 'bag',
    )  # fmt: skip
    assert code == 0
    assert ', 6 s in' in out
    truth = json.loads((tmp_path / 'bag' / 'truth.json').read_text(encoding='utf-8'))
    assert truth['scenario']['zones'][1] == {'name': 'test', 'begin_s': 2.0, 'end_s': 5.0}


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['nope', '--duration', '3s'], "no bench 'nope'; known are"),
        (['machine_vibratio', '--duration', '3s'], "did you mean 'machine_vibration'?"),
        (['machine_vibration', '--scenario', 'nope'], "no scenario 'nope'; known are engine_idle"),
        (['machine_vibration'], 'say how long with --duration'),
        ([], 'Give either a bench or --from'),
        (['machine_vibration', '--from', 'r.json'], 'Give either a bench or --from'),
        (['--from', 'none.json'], 'none.json: cannot be read: No such file'),
        (
            ['machine_vibration', '--scenario', 'sine', '--set', 'sine.frequency=9 furlong'],
            "unknown unit 'furlong'; use one of Hz, kHz, rpm",
        ),
        (['machine_vibration', '--scenario', 'sine', '--set', 'x'], "'x' is no setting like"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(imu_bench, tmp_path, arguments, text):
    code, out, err = imu_bench('simulate', *arguments, '-o', tmp_path / 'bag')
    assert (code, out) == (1, '')
    assert text in one_line(err)
    assert not (tmp_path / 'bag').exists()


def test_a_folder_that_exists_is_refused(imu_bench, tmp_path):
    code, _, err = imu_bench('simulate', 'machine_vibration', '--duration', '1s', '-o', tmp_path)
    assert code == 1
    assert 'exists already; name another folder' in one_line(err)


@pytest.mark.parametrize('duration', ['3 fortnights', 'long', '-5s', '0s', '1e9h', '3 m'])
def test_a_duration_that_is_none_is_wrong_usage(imu_bench, tmp_path, duration):
    code, _, err = imu_bench(
        'simulate', 'machine_vibration', f'--duration={duration}', '-o', tmp_path / 'bag'
    )
    assert code == 2
    assert 'duration' in err


def test_a_bench_with_a_wrong_unit_names_file_and_setting(imu_bench, own_bench, tmp_path):
    left = own_bench.parent / 'left.yaml'
    left.write_text(left.read_text(encoding='utf-8').replace('20 mg', '20 furlong'), 'utf-8')
    code, _, err = imu_bench('simulate', own_bench, '--duration', '1s', '-o', tmp_path / 'bag')
    assert code == 1
    assert 'left.yaml' in one_line(err)
    assert "acceleration.bias: '20 furlong': unknown unit" in err


@pytest.mark.parametrize('storage', ['npy', 'mcap', 'sqlite3'])
def test_a_run_that_is_stopped_leaves_nothing(
    imu_bench, own_bench, tmp_path, monkeypatch, storage
):
    seen = []

    def stop(*_):
        seen.extend(path.name for path in tmp_path.iterdir())
        raise KeyboardInterrupt

    monkeypatch.setattr('imu_bench.terminal.progress.Bar.phase', lambda bar, name: stop)
    before = sorted(tmp_path.iterdir())
    code, _, err = imu_bench(
        'simulate', own_bench, '--duration', '10min', '-o', tmp_path / 'bag', '--storage', storage
    )
    assert (code, err) == (130, 'imu-bench: stopped\n')
    assert '.unfinished-bag' in seen
    assert 'bag' not in seen
    assert sorted(tmp_path.iterdir()) == before


def test_a_full_disk_leaves_nothing_and_is_one_line(imu_bench, own_bench, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr('imu_bench.bags.writer.BagWriter.flush', full)
    monkeypatch.setattr('imu_bench.bags.columns.ColumnWriter.write', full)
    before = sorted(tmp_path.iterdir())
    for storage in ('mcap', 'npy'):
        code, _, err = imu_bench(
            'simulate', own_bench, '--duration', '20s', '-o', tmp_path / 'a', '--storage', storage
        )
        assert code == 1
        assert f'{tmp_path / "a"}: ' in one_line(err)
        assert 'unfinished' not in err
    assert err.endswith('a: the disk is full; what was written is removed\n')
    assert sorted(tmp_path.iterdir()) == before
