# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze`: outputs, options, and bad input with one clear line."""

import json
import os
import re
import time

from imu_bench.offline import stages
from imu_bench.offline.analysis import results
import numpy as np
import pytest


def one_line(err):
    """Return the message of the only line on stderr."""
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith('imu-bench: error: ')
    assert 'Traceback' not in err
    return lines[0]


@pytest.mark.slow
def test_table_json_and_report(imu_bench, write_csv, tmp_path, monkeypatch):
    monkeypatch.setenv('COLUMNS', '120')
    document, report = tmp_path / 'r.json', tmp_path / 'r.html'
    code, out, err = imu_bench(
        'analyze', write_csv(n=30_000), '--full', '--json', document, '--html', report
    )
    assert (code, err) == (0, '')
    assert out.index('nothing found') < out.index('Acceleration') < out.index('Angular velocity')
    assert re.search(r'noise density +N +B +K', out)
    assert 'µg/√Hz' in out
    [recording] = results.read(document).recordings
    std = recording.axes['linear_acceleration.x'].statistics['std']
    assert std.value == pytest.approx(0.02, rel=0.02)
    assert report.read_text(encoding='utf-8').startswith('<!DOCTYPE html>')


def test_what_each_stage_took_on_request(imu_bench, write_csv):
    """Held against the clock of this process, which does all of the work itself."""
    stages.table()  # what other tests have spent
    before = time.process_time()
    code, out, err = imu_bench('analyze', write_csv(n=2000), '--jobs', '1', '--profile')
    spent = time.process_time() - before
    assert (code, err) == (0, '')
    _, _, table = out.rpartition('\nstage ')
    rows = {name: list(map(float, row)) for name, *row in map(str.split, table.splitlines()[1:])}
    seconds, rates, peaks = zip(*rows.values(), strict=True)
    assert list(rows)[:-1] == list(stages.STAGES)
    assert min(seconds) >= 0.0
    assert min(peaks) > 0
    assert sum(seconds[:-1]) == pytest.approx(seconds[-1], abs=0.01)
    assert sum(seconds[1:-1]) <= spent
    assert rates == pytest.approx(np.array(seconds) / 2e-3, abs=0.5)
    assert peaks[-1] == max(peaks[:-1])


def test_stages_inside_one_another_count_once():
    """Work of a known share; the clock is that of the processor."""

    def work(seconds):
        end = time.process_time() + seconds
        while time.process_time() < end:
            pass

    before = time.process_time()
    stages.table()
    with stages.stage('fits'):
        work(0.02)
        with stages.stage('read'):
            work(0.04)
    _, account = stages.accounted(work, 0.01)
    assert account.seconds['fits'] >= 0.02
    assert account.seconds['read'] >= 0.04
    assert account.seconds['start'] >= 0.01
    assert sum(account.seconds.values()) <= time.process_time() - before
    assert stages.accounted(len, '')[1].seconds['read'] == 0.0


def test_si_units_on_request(imu_bench, write_csv):
    _, out, _ = imu_bench('analyze', write_csv(), '--si')
    assert 'm/s²/√Hz' in out
    table, _, _ = out.partition('\nDead reckoning')
    assert 'µg' not in table


def test_averaging_times_on_request(imu_bench, write_csv, tmp_path):
    document = tmp_path / 'r.json'
    imu_bench('analyze', write_csv(), '--tau', '0.1,1', '--json', document)
    axis = json.loads(document.read_text())['recordings'][0]['axes']['angular_velocity.x']
    assert axis['allan']['tau'] == pytest.approx([0.1, 1.0])


@pytest.mark.slow
def test_averages_that_lack_samples_on_request(imu_bench, write_csv, tmp_path):
    path, document, report = write_csv(n=20_000), tmp_path / 'r.json', tmp_path / 'r.html'
    header, *rows = path.read_text().splitlines()
    kept = np.random.default_rng(1).random(len(rows)) > 0.005
    left = [row for row, keep in zip(rows, kept, strict=True) if keep]
    path.write_text('\n'.join([header, *left]))
    _, out, _ = imu_bench('analyze', path, '--json', document)
    strict = results.read(document)
    assert '--min-share 0.95' in out
    code, _, err = imu_bench(
        'analyze', path, '--min-share', '0.95', '--json', document, '--html', report
    )
    assert (code, err) == (0, '')
    found = results.read(document)
    assert (strict.settings['min_share'], found.settings['min_share']) == (1.0, 0.95)
    before, after = (r.recordings[0].axes['angular_velocity.x'].allan for r in (strict, found))
    assert (before.min_share, after.min_share) == (1.0, 0.95)
    assert after.tau[-1] > 3 * before.tau[-1]
    assert 'averages count from 95 % of their samples on' in report.read_text(encoding='utf-8')
    code, _, err = imu_bench('analyze', path, '--min-share', '95')
    assert code != 0
    assert '--min-share 95' in one_line(err)


@pytest.mark.slow
def test_a_window_of_stamps_and_of_seconds_agree(imu_bench, write_csv, tmp_path):
    path = write_csv()
    first, second = tmp_path / '1.json', tmp_path / '2.json'
    imu_bench('analyze', path, '--start', '10', '--end', '30', '--json', first)
    imu_bench('analyze', path, '--window', '1010000000000:1030000000000', '--json', second)
    one, two = results.read(first).recordings[0], results.read(second).recordings[0]
    assert one.health.samples == 2001
    assert one.axes['angular_velocity.x'].to_json() == two.axes['angular_velocity.x'].to_json()


@pytest.mark.slow
def test_several_inputs_are_compared(imu_bench, write_csv, tmp_path):
    quiet = write_csv('quiet.csv', seed=2)
    loud = write_csv('loud.csv', seed=3, scale=3.0)
    report = tmp_path / 'r.html'
    code, _, _ = imu_bench('analyze', loud, quiet, '--html', report)
    assert code == 0
    page = report.read_text(encoding='utf-8')
    assert 'Vibration: quiet is best' in page
    assert 'All sensors together' in page


def test_one_bad_input_does_not_stop_the_others(imu_bench, write_csv, tmp_path):
    document = tmp_path / 'r.json'
    missing = tmp_path / 'missing.csv'
    code, out, err = imu_bench('analyze', missing, write_csv(), '--json', document)
    assert code == 1
    assert 'missing.csv' in one_line(err)
    assert 'Acceleration' in out
    found = results.read(document)
    assert len(found.recordings) == 1
    assert found.failures[0].source == str(missing)


@pytest.mark.slow
def test_strict_makes_severe_findings_fail(imu_bench, write_csv):
    def stop(rows):
        rows[:, 3] = 9.81

    path = write_csv(change=stop)
    assert imu_bench('analyze', path)[0] == 0
    code, out, err = imu_bench('analyze', path, '--strict')
    assert code == 1
    assert 'severe' in one_line(err)
    assert 'linear_acceleration.z is constant' in out


def test_values_that_are_no_numbers_are_counted(imu_bench, write_csv):
    def spoil(rows):
        rows[100, 1] = np.nan
        rows[200:210, 5] = np.inf

    _, out, _ = imu_bench('analyze', write_csv(change=spoil))
    assert '11 samples' in out
    assert '1 NaN' in out
    assert '10 infinite' in out


class TestBadInput:
    def test_missing_column(self, imu_bench, tmp_path):
        path = tmp_path / 'no.csv'
        path.write_text('stamp_s,pressure\n' + '\n'.join(f'{i},1.5' for i in range(100)))
        code, out, err = imu_bench('analyze', path)
        assert (code, out) == (1, '')
        assert 'pressure' in one_line(err)

    @pytest.mark.parametrize('rate', ['0', '-5', 'nan', '1e9'])
    def test_impossible_rate(self, imu_bench, write_csv, rate):
        code, _, err = imu_bench('analyze', write_csv(), '--rate', rate)
        assert code == 1
        assert '--rate' in one_line(err)

    def test_not_a_recording(self, imu_bench, tmp_path):
        path = tmp_path / 'x.mcap'
        path.write_bytes(b'\x00\x01\x02' * 100)
        code, _, err = imu_bench('analyze', path)
        assert code == 1
        assert 'x.mcap' in one_line(err)

    def test_empty_file_and_folder(self, imu_bench, tmp_path):
        (tmp_path / 'empty.bag').touch()
        for path in (tmp_path / 'empty.bag', tmp_path):
            code, _, err = imu_bench('analyze', path)
            assert code == 1
            assert path.name in one_line(err)

    def test_too_few_samples(self, imu_bench, write_csv):
        code, _, err = imu_bench('analyze', write_csv(n=5))
        assert code == 1
        assert 'too few' in one_line(err)

    def test_a_window_outside(self, imu_bench, write_csv):
        code, _, err = imu_bench('analyze', write_csv(), '--start', '1000')
        assert code == 1
        assert 'no sample from 1000 s on' in one_line(err)

    def test_an_output_that_cannot_be_written_is_refused_first(
        self, imu_bench, write_csv, tmp_path
    ):
        for target in (tmp_path / 'no' / 'r.json', tmp_path):
            code, out, err = imu_bench('analyze', write_csv(), '--json', target)
            assert (code, out) == (1, '')
            assert str(target) in one_line(err)

    @pytest.mark.parametrize(
        ('option', 'value', 'wrong'),
        [('--start', 'nan', 2), ('--start', '-5', 2), ('--end', 'inf', 2), ('--end', '-5', 2),
         ('--tau', '1e300', 1), ('--tau', 'nan', 2)],
    )  # fmt: skip
    def test_a_time_that_is_none(self, imu_bench, write_csv, option, value, wrong):
        code, out, err = imu_bench('analyze', write_csv(), f'{option}={value}')
        assert (code, out) == (wrong, '')
        line = err.splitlines()[-1]
        assert option in (line if wrong == 2 else one_line(err))

    def test_an_output_does_not_destroy_an_input(self, imu_bench, write_csv):
        path = write_csv()
        before = path.read_bytes()
        code, _, err = imu_bench('analyze', path, '--json', path)
        assert code == 1
        assert 'is an input, too' in one_line(err)
        assert path.read_bytes() == before

    def test_two_outputs_are_two_files(self, imu_bench, write_csv, tmp_path):
        target = tmp_path / 'r'
        code, _, err = imu_bench('analyze', write_csv(), '--json', target, '--html', target)
        assert code == 1
        assert 'another output' in one_line(err)
        assert not target.exists()

    def test_a_pipe_is_refused_without_waiting_for_it(self, imu_bench, tmp_path):
        os.mkfifo(tmp_path / 'pipe')
        code, _, err = imu_bench('analyze', tmp_path / 'pipe')
        assert code == 1
        assert 'pipe: neither a file nor a folder' in one_line(err)

    def test_a_setting_without_a_plan(self, imu_bench, write_csv):
        code, out, err = imu_bench('analyze', write_csv(), '--set', 'bandwidth=100 Hz')
        assert (code, out) == (1, '')
        assert '--plan' in one_line(err)

    def test_a_reference_that_is_not_there(self, imu_bench, write_csv):
        code, out, err = imu_bench('analyze', write_csv(), '--reference', 'clip')
        assert code == 1
        assert 'Acceleration' in out
        assert '--reference clip: not among the sensors: chip' in one_line(err)

    @pytest.mark.data
    def test_unknown_topic_lists_what_there_is(self, imu_bench, shared_data):
        bag = shared_data / 'rosbag1_husky_imu' / 'test' / 'test1.bag'
        code, _, err = imu_bench('analyze', bag, '--topic', '/imu/raw')
        assert code == 1
        assert re.search(r'/imu/data \(sensor_msgs/(msg/)?Imu, 11865\)', one_line(err))

    @pytest.mark.data
    @pytest.mark.parametrize(
        'name', ['example.bag', 'no-messages.bag', 'empty-file.bag', 'asci-file.txt']
    )
    def test_no_imu_topic_and_no_bag(self, imu_bench, shared_data, name):
        path = shared_data / 'rosbag1_samples' / 'fixtures' / name
        code, out, err = imu_bench('analyze', path)
        assert (code, out) == (1, '')
        assert name in one_line(err)

    @pytest.mark.slow
    @pytest.mark.data
    def test_truncated_bag(self, imu_bench, shared_data, tmp_path):
        whole = (shared_data / 'rosbag1_husky_imu' / 'test' / 'test1.bag').read_bytes()
        path = tmp_path / 'cut.bag'
        path.write_bytes(whole[: len(whole) // 3])
        code, _, err = imu_bench('analyze', path)
        assert code in (0, 1)
        if code:
            assert 'cut.bag' in one_line(err)

    @pytest.mark.data
    def test_every_bag_without_imu_gives_one_line(self, imu_bench, shared_data):
        folder = shared_data / 'rosbag2_test_bags'
        index = json.loads((folder / 'index.json').read_text())
        checked = 0
        for bag in index['bags']:
            types = {str(topic[0]) for topic in bag.get('topics', {}).values()}
            if any('Imu' in name for name in types):
                continue
            code, out, err = imu_bench('analyze', folder / bag['dir'])
            assert (code, out) == (1, '')
            one_line(err)
            checked += 1
        assert checked > 10


@pytest.mark.data
class TestRealRecordings:
    """Values that somebody else computed from the same files."""

    NAMES = ('ax', 'ay', 'az', 'gx', 'gy', 'gz')
    AXES = tuple(
        f'{quantity}.{letter}'
        for quantity in ('linear_acceleration', 'angular_velocity')
        for letter in 'xyz'
    )

    @pytest.mark.parametrize(
        ('reference', 'folder'),
        [
            ('reference_static_449s_raw.json', 'calibration data'),
            ('reference_static_test_100s_raw.json', 'results test data'),
        ],
    )
    def test_mpu6050(self, imu_bench, shared_data, tmp_path, reference, folder):
        data = shared_data / 'mpu6050_static'
        expected = json.loads((data / reference).read_text())
        document = tmp_path / 'r.json'
        taus = [point['tau_s'] for point in expected['channels']['ax']['curve']]
        code, _, err = imu_bench(
            'analyze', data / folder / expected['dataset'].rpartition('/')[2],
            '--rate', '100',
            '--units', 'linear_acceleration=m/s^2/1,angular_velocity=rad/s/1',
            '--tau', ','.join(map(str, taus)),
            '--json', document,
        )  # fmt: skip
        assert (code, err) == (0, '')
        axes = results.read(document).recordings[0].axes
        for axis, name in zip(self.AXES, self.NAMES, strict=True):
            channel = expected['channels'][name]
            numbers = axes[axis].statistics
            assert numbers['mean'].value == pytest.approx(channel['mean'], rel=1e-9)
            assert numbers['std'].value == pytest.approx(channel['std_ddof1'], rel=1e-9)
            assert numbers['rms'].value == pytest.approx(channel['rms_about_mean'], rel=1e-9)
            assert numbers['minimum'].value == channel['min']
            curve = axes[axis].allan
            np.testing.assert_allclose(
                curve.deviation, [point['oadev'] for point in channel['curve']], rtol=1e-9
            )
            np.testing.assert_array_equal(curve.terms, [point['n'] for point in channel['curve']])

    @pytest.mark.slow
    def test_mpu9150_five_units_in_one_report(self, imu_bench, shared_data, tmp_path):
        data = shared_data / 'mpu9150_five_units'
        expected = json.loads((data / 'reference.json').read_text())['imus']
        document, report = tmp_path / 'r.json', tmp_path / 'r.html'
        code, _, err = imu_bench(
            'analyze', *(data / f'{name}.log' for name in expected),
            '--rate', '100', '--columns', ','.join(self.AXES),
            '--units', 'linear_acceleration=m/s^2,angular_velocity=rad/s',
            '--json', document, '--html', report,
        )  # fmt: skip
        assert (code, err) == (0, '')
        found = results.read(document).recordings
        assert [r.health.samples for r in found] == [e['rows'] for e in expected.values()]
        for recording in found:
            assert recording.health.rate.value == pytest.approx(100.0)
            assert any(f.code == 'motion' for f in recording.health.findings)
        page = report.read_text(encoding='utf-8')
        for name in expected:
            assert f'<h2>{name}</h2>' in page

    @pytest.mark.slow
    @pytest.mark.parametrize('index', [0, 1])
    def test_husky(self, imu_bench, shared_data, tmp_path, index):
        data = shared_data / 'rosbag1_husky_imu'
        bag = json.loads((data / 'reference.json').read_text())['bags'][index]
        expected = bag['imu']['/imu/data']
        document = tmp_path / 'r.json'
        path = data / 'test' / bag['path'].rpartition('/')[2]
        code, _, err = imu_bench('analyze', path, '--json', document)
        assert (code, err) == (0, '')
        [recording] = results.read(document).recordings
        health = recording.health
        assert health.samples == expected['count']
        assert health.rate.value == pytest.approx(
            expected['header_time']['mean_rate_hz'], rel=1e-4
        )
        assert (health.missing, health.duplicates, health.order_faults) == (0, 0, 0)
        assert recording.frame_id == expected['frame_id']
        assert any(f.code == 'motion' for f in health.findings)
        order = ('wx', 'wy', 'wz', 'ax', 'ay', 'az')
        names = dict(zip(order, (*self.AXES[3:], *self.AXES[:3]), strict=True))
        for position, name in enumerate(expected['order']):
            numbers = recording.axes[names[name]].statistics
            assert numbers['mean'].value == pytest.approx(expected['mean'][position], rel=1e-9)
            assert numbers['std'].value == pytest.approx(expected['std_ddof1'][position], rel=1e-9)


class TestFigures:
    @pytest.mark.slow
    def test_they_are_written_into_a_new_folder(self, imu_bench, write_csv, tmp_path):
        folder, path = tmp_path / 'figures', write_csv()
        rows = [row.split(',')[:4] for row in path.read_text().splitlines()]  # no gyroscope
        path.write_text('\n'.join(map(','.join, rows)))
        code, out, err = imu_bench('analyze', path, '--figures', folder)
        assert (code, err) == (0, '')
        assert f'wrote 12 files in {folder}' in out
        assert (folder / 'chip-linear_acceleration-allan.pdf').stat().st_size > 1000

    @pytest.mark.parametrize(
        ('name', 'words'), [('file', 'is a file'), ('none/figures', 'does not exist')]
    )
    def test_a_place_that_cannot_be_is_refused_first(
        self, imu_bench, write_csv, tmp_path, name, words
    ):
        (tmp_path / 'file').write_text('')
        code, out, err = imu_bench('analyze', write_csv(), '--figures', tmp_path / name)
        assert (code, out) == (1, '')
        assert words in one_line(err)


@pytest.mark.slow
def test_the_confidence_level_is_an_option(imu_bench, write_csv, tmp_path):
    """A narrower interval of the same value, in the result and in the words of the page."""
    found = {}
    for level in (0.68, 0.95):
        document, page = tmp_path / f'{level}.json', tmp_path / f'{level}.html'
        code, _, err = imu_bench(
            'analyze', write_csv(), '--confidence', level, '--json', document, '--html', page
        )
        assert (code, err) == (0, '')
        axis = json.loads(document.read_text('utf-8'))['recordings'][0]['axes']
        found[level] = axis['angular_velocity.x']['noise_density']
        assert found[level]['confidence'] == level
        assert f'<dd>{100 * level:g} % confidence interval' in page.read_text('utf-8')
    narrow, wide = found.values()
    assert narrow['value'] == wide['value']
    assert narrow['high'] - narrow['low'] < 0.7 * (wide['high'] - wide['low'])
    code, _, err = imu_bench('analyze', write_csv(), '--confidence', '1')
    assert (code, err.count('\n')) == (1, 1)
    assert '--confidence 1: give a level from 0.5 to 0.999' in err
