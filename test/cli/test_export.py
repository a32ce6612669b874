# SPDX-License-Identifier: Apache-2.0
"""`imu-bench export`: from the file of an analysis to a file for another program."""

from imu_bench.cli.export import FORMATS
from imu_bench.offline import exports
import numpy as np
import pytest
import yaml


@pytest.fixture(scope='module')
def documents(write_csv, tmp_path_factory):
    """Return the results of one sensor and of two."""
    from imu_bench.cli.main import main

    folder = tmp_path_factory.mktemp('results')
    one, two = folder / 'one.json', folder / 'two.json'
    quiet, loud = write_csv('quiet.csv', n=12_000), write_csv('loud.csv', n=12_000, scale=3.0)
    assert main(['analyze', str(quiet), '--json', str(one)]) == 0
    assert main(['analyze', str(quiet), str(loud), '--json', str(two)]) == 0
    return one, two


def test_help_and_the_house_know_the_same_formats():
    assert FORMATS == exports.FORMATS


@pytest.mark.parametrize('name', FORMATS)
def test_every_format_is_written(imu_bench, documents, tmp_path, name):
    output = tmp_path / 'out'
    code, out, err = imu_bench('export', documents[0], '--to', name, '-o', output)
    assert (code, err) == (0, '')
    assert out == f'wrote {output}\n'
    text = output.read_text(encoding='utf-8')
    assert 'quiet.csv' in text
    _, shown, _ = imu_bench('export', documents[0], '--to', name)
    assert shown == text


def test_the_numbers_of_the_sensor_that_was_named(imu_bench, documents):
    values = {}
    for sensor in ('quiet', 'loud'):
        _, out, _ = imu_bench('export', documents[1], '--to', 'kalibr', '--topic', sensor)
        values[sensor] = yaml.safe_load(out)['gyroscope_noise_density']
    assert values['loud'] == pytest.approx(3.0 * values['quiet'], rel=0.05)


@pytest.fixture(scope='module')
def moved(write_csv, tmp_path_factory):
    """Return the results of a sensor at rest and of one that moved."""
    from imu_bench.cli.main import main

    def move(rows):
        rows[1000:4000, 1] += 3.0 * np.sin(np.arange(3000) / 50.0)

    document = tmp_path_factory.mktemp('moved') / 'moved.json'
    still, shaken = write_csv('still.csv'), write_csv('shaken.csv', change=move)
    assert main(['analyze', str(still), str(shaken), '--json', str(document)]) == 0
    return document


@pytest.mark.parametrize('to', FORMATS)
def test_numbers_with_a_severe_finding_need_force(imu_bench, moved, tmp_path, to):
    given = ('export', moved, '--topic', 'shaken', '--to', to)
    code, out, err = imu_bench(*given, '-o', tmp_path / 'refused')
    assert (code, out, len(err.splitlines())) == (1, '', 1)
    assert 'shaken: The sensor moved' in err and '--force' in err
    assert not list(tmp_path.iterdir())
    code, out, err = imu_bench(*given, '--force')
    assert code == 0
    assert err.startswith('imu-bench: warning: shaken: The sensor moved ')
    assert len(err.splitlines()) == 1
    if to == 'csv':
        assert ',motion,' in out.splitlines()[1]
        return
    first = [line for line in out.splitlines() if line.strip(' #<!-')][:2]
    assert any('WARNING: NOT TO BE TRUSTED (motion): The sensor moved' in line for line in first)


def test_every_sensor_gets_a_file_of_its_own(imu_bench, documents, tmp_path):
    folder = tmp_path / 'kalibr'
    given = ('export', documents[1], '--to', 'kalibr', '-o', folder)
    code, out, _ = imu_bench(*given)
    assert (code, out) == (0, f'wrote {folder}/quiet.yaml\nwrote {folder}/loud.yaml\n')
    for name in ('quiet', 'loud'):
        _, alone, _ = imu_bench('export', documents[1], '--to', 'kalibr', '--topic', name)
        assert (folder / f'{name}.yaml').read_text() == alone
    named = ('--topic', 'loud', '--topic', 'quiet')
    assert imu_bench(*given, *named)[1] == out
    assert imu_bench(*given, '--topic', 'loud')[1] == f'wrote {folder}/loud.yaml\n'
    (tmp_path / 'file').touch()
    code, _, err = imu_bench('export', documents[1], '--to', 'kalibr', '-o', tmp_path / 'file')
    assert code == 1 and 'one file for 2 sensors' in err


def test_one_severe_sensor_of_two_is_left_out_by_name(imu_bench, moved, tmp_path):
    folder = tmp_path / 'all'
    assert imu_bench('export', moved, '--to', 'vins', '-o', folder)[0] == 1
    assert not folder.exists()
    code, *_ = imu_bench('export', moved, '--to', 'vins', '-o', folder, '--topic', 'still')
    assert code == 0 and not folder.is_dir() and folder.read_text().startswith('%YAML')


def test_conservative_numbers_are_larger(imu_bench, documents):
    _, nominal, _ = imu_bench('export', documents[0], '--to', 'kalibr')
    _, upper, _ = imu_bench('export', documents[0], '--to', 'kalibr', '--conservative')
    first, second = yaml.safe_load(nominal), yaml.safe_load(upper)
    assert second['accelerometer_noise_density'] > first['accelerometer_noise_density']
    assert 'nominal values' in nominal and 'conservative values' in upper


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['{two}', '--to', 'kalibr'], 'with -o FOLDER: quiet, loud'),
        (['{one}', '--to', 'kalibr', '--topic', 'other'], "no sensor 'other'"),
        (['{one}', '--to', 'kalibr', '-o', '{folder}/none/x'], 'does not exist'),
        (['{folder}/missing.json', '--to', 'csv'], 'No such file'),
        (['{folder}/text.json', '--to', 'csv'], 'not a JSON document'),
    ],
)
def test_bad_input_is_one_line(imu_bench, documents, tmp_path, arguments, words):
    (tmp_path / 'text.json').write_text('hello')
    names = {'one': documents[0], 'two': documents[1], 'folder': tmp_path}
    code, out, err = imu_bench('export', *(a.format(**names) for a in arguments))
    assert (code, out) == (1, '')
    assert len(err.splitlines()) == 1
    assert words in err


def test_an_unknown_format_is_wrong_usage(imu_bench, documents):
    code, _, err = imu_bench('export', documents[0], '--to', 'matlab')
    assert code == 2
    assert 'kalibr' in err


def test_a_sensor_without_a_gyroscope_does_not_keep_the_others_from_a_folder(
    imu_bench, write_csv, tmp_path
):
    def no_gyroscope(rows):
        rows[:, 4:] = np.nan

    both = write_csv('both.csv', n=6_000)
    half = write_csv('half.csv', n=6_000, change=no_gyroscope)
    result, folder = tmp_path / 'r.json', tmp_path / 'filters'
    assert imu_bench('analyze', both, half, '--json', result)[0] == 0
    code, out, err = imu_bench('export', result, '--to', 'kalibr', '-o', folder)
    assert (code, out) == (0, f'wrote {folder / "both.yaml"}\n')
    assert err.startswith('imu-bench: warning: left out: ')
    assert 'half.csv' in err
    assert 'there is no angular_velocity in it to export' in err
    assert [path.name for path in folder.iterdir()] == ['both.yaml']
    code, _, err = imu_bench(
        'export', result, '--to', 'kalibr', '-o', folder, '--topic', 'half', '--topic', 'both'
    )
    assert code == 1
    assert 'there is no angular_velocity in it to export' in err
