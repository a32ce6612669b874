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


def test_numbers_of_a_sensor_that_moved_are_written_with_a_warning(imu_bench, write_csv, tmp_path):
    def move(rows):
        rows[1000:4000, 1] += 3.0 * np.sin(np.arange(3000) / 50.0)

    document = tmp_path / 'moved.json'
    imu_bench('analyze', write_csv(change=move), '--json', document)
    code, out, err = imu_bench('export', document, '--to', 'kalibr')
    assert code == 0
    assert '# WARNING: the recording is not to be trusted: motion' in out
    assert err.startswith('imu-bench: warning: The sensor moved ')
    assert len(err.splitlines()) == 1


def test_conservative_numbers_are_larger(imu_bench, documents):
    _, nominal, _ = imu_bench('export', documents[0], '--to', 'kalibr')
    _, upper, _ = imu_bench('export', documents[0], '--to', 'kalibr', '--conservative')
    first, second = yaml.safe_load(nominal), yaml.safe_load(upper)
    assert second['accelerometer_noise_density'] > first['accelerometer_noise_density']
    assert 'nominal values' in nominal and 'conservative values' in upper


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['{two}', '--to', 'kalibr'], 'choose one with --topic: quiet, loud'),
        (['{one}', '--to', 'kalibr', '--topic', 'other'], "no sensor 'other'"),
        (['{one}', '--to', 'kalibr', '-o', '{folder}'], 'is a folder'),
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
