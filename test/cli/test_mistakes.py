# SPDX-License-Identifier: Apache-2.0
"""What people get wrong at the command line: each time one line that says what to do."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest


@pytest.fixture(scope='module')
def document(write_csv, tmp_path_factory):
    """Return the result of one sensor."""
    from imu_bench.cli.main import main

    path = tmp_path_factory.mktemp('results') / 'one.json'
    assert main(['analyze', str(write_csv('quiet.csv')), '--json', str(path)]) == 0
    return path


@pytest.fixture
def refused(imu_bench):
    """Return a function that runs what is refused and returns the only line on stderr."""

    def run(*arguments):
        code, _, err = imu_bench(*arguments)
        assert code == 1
        [line] = err.splitlines()
        return line

    return run


@pytest.mark.parametrize(
    ('verb', 'meant'), [('anlyze', 'analyze'), ('exprot', 'export'), ('compair', 'compare')]
)
def test_a_misspelt_verb_is_recognised(imu_bench, verb, meant):
    code, _, err = imu_bench(verb, 'x')
    assert code == 2
    assert f'did you mean {meant!r}?' in err.splitlines()[-1]


def test_the_help_that_is_meant_follows_an_unknown_verb(imu_bench):
    _, _, err = imu_bench('fly')
    assert 'analyze' in err
    assert 'did you mean' not in err


def test_a_result_is_no_recording(refused, document):
    line = refused('analyze', document)
    assert 'a result of imu-bench analyze, no recording' in line
    assert 'export' in line and 'compare' in line


def test_a_wire_recording_is_played_not_analysed(refused, tmp_path):
    path = tmp_path / 'trouble.wire'
    path.write_bytes(b'imu_bench wire recording 1 00000000\n{}\n')
    line = refused('analyze', path)
    assert 'this is a wire recording; play it with sensor_node' in line
    assert str(path) in line


@pytest.mark.parametrize(
    'verb', [('export', '--to', 'kalibr'), ('compare',), ('simulate', '-o', 'x', '--from')]
)
@pytest.mark.parametrize('kind', ['folder', 'text'])
def test_a_recording_is_no_result(refused, write_csv, document, verb, kind):
    recording = write_csv()
    given = recording.parent if kind == 'folder' else recording
    first = [document] if verb == ('compare',) else []
    line = refused(*verb, *first, given)
    assert str(given) in line
    assert 'imu-bench analyze RECORDING --json' in line


@pytest.mark.parametrize(
    ('options', 'says'),
    [
        (['--start', '5000000'], 'from 5000000 s on'),
        (['--window', '0:5'], 'with a stamp from 0 to 5 ns; its stamps are 1000000000000 to'),
    ],
)
def test_a_part_that_is_none(refused, write_csv, options, says):
    assert says in refused('analyze', write_csv(), *options)


def test_what_is_no_file_of_typical_values_is_said_once(refused, write_csv, document):
    line = refused('analyze', write_csv(), '--datasheet', document)
    assert 'an entry is like' in line
    assert len(line) < 600


def test_units_that_fit_are_listed_and_no_others(refused, write_csv):
    path = write_csv()
    line = refused('analyze', path, '--units', 'angular_velocity=grad/s')
    assert '°/s' in line and 'rad/s' in line
    assert 'm/s²' not in line
    assert 'K/min' not in line


def test_columns_that_nobody_named_are_told(imu_bench, tmp_path):
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join(f'{i % 7},{i % 5},{i % 3},4,5' for i in range(200)))
    code, out, _ = imu_bench(
        'analyze', path, '--full', '--columns', 'ax,ay', '--units', 'SI', '--rate', '100'
    )
    assert code == 0
    assert '--columns names 2 of 5 columns and no linear_acceleration.z' in ' '.join(out.split())
    code, out, _ = imu_bench(
        'analyze', path, '--columns', 'ax,ay,-,-,-', '--units', 'SI', '--rate', '100'
    )
    assert '--columns' not in out
    code, out, _ = imu_bench(
        'analyze', path, '--columns', 'ax,ay,az', '--units', 'SI', '--rate', '100'
    )
    assert '--columns' not in out


def test_a_still_simulation_is_no_run_on_a_shaker(refused, tmp_path, write_csv):
    path = write_csv()
    truth = {'scenario': {'name': 'still', 'axis': '', 'motions': []}, 'run': 1}
    (path.parent / 'truth.json').write_text(json.dumps(truth))
    assert 'which condition and axis?' in refused('analyze', '--plan', 'sine-on-random', path)


@pytest.mark.slow
def test_more_moves_than_are_named(imu_bench, write_csv):
    def shake(rows):
        for begin in (1000, 3000, 5000, 7000):
            rows[begin : begin + 300, 1:4] += 5.0 * np.sin(np.arange(300)[:, None] / 5.0)

    _, out, _ = imu_bench('analyze', write_csv(n=10_000, change=shake))
    assert 'and once more' in ' '.join(out.split())


def test_a_topic_is_suggested(refused, tmp_path, imu_bench):
    bag = tmp_path / 'bag'
    imu_bench('simulate', 'mast_inclination', '--duration', '2s', '-o', bag)
    meant = "did you mean '/bench/scl3300/imu/data_raw'?"
    assert meant in refused('analyze', bag, '--topic', 'scl330')
    assert meant in refused('analyze', bag, '--topic', '/bench/scl3300/imu/dat_raw')
    assert 'did you mean' not in refused('analyze', bag, '--topic', '/camera')


@pytest.mark.slow
@pytest.mark.parametrize('options', [[], ['--plan', 'static']])
def test_a_reader_that_goes_away_costs_no_result(write_csv, tmp_path, options):
    """As with `imu-bench analyze … --json r.json | head`."""
    document = tmp_path / 'r.json'
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, '-m', 'imu_bench.cli.main', 'analyze', write_csv(), *options]
    done = subprocess.run(
        [*command, '--json', document], stdout=writer, stderr=subprocess.PIPE, check=False
    )
    os.close(writer)
    assert done.stderr == b''
    assert json.loads(document.read_text())['schema'].startswith('imu_bench.')
