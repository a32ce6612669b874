# SPDX-License-Identifier: Apache-2.0
"""The front door of the offline tools does what the verbs do, and opens late."""

import json
import subprocess
import sys

from imu_bench import offline
from imu_bench.cli.main import main
import numpy as np
import pytest


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    """Return two files of a still gyroscope."""
    rng, files = np.random.default_rng(3), []
    for name in ('left', 'right'):
        table = np.column_stack([np.arange(4000) / 100, rng.normal(size=(4000, 3))])
        header = 'stamp_s,' + ','.join(f'angular_velocity.{axis}' for axis in 'xyz')
        files.append(tmp_path_factory.mktemp('recordings') / f'{name}.csv')
        np.savetxt(files[-1], table, delimiter=',', header=header, comments='')
    return files


def test_everything_it_names_is_there():
    assert all(callable(getattr(offline, name)) for name in offline.__all__)
    with pytest.raises(AttributeError, match='no_such_name'):
        offline.no_such_name  # noqa: B018


@pytest.mark.slow
def test_it_gives_the_document_of_the_verb(recordings, tmp_path, capsys):
    files = [str(path) for path in recordings]
    assert main(['analyze', *files, '--jobs', '1', '--json', str(tmp_path / 'verb.json')]) == 0
    capsys.readouterr()
    analysis = offline.analyze(recordings)
    offline.write_results(analysis, tmp_path / 'door.json')
    verb, door = (
        json.loads((tmp_path / f'{name}.json').read_text('utf-8')) for name in ('verb', 'door')
    )
    assert door['recordings'] == verb['recordings']
    assert door['comparison'] == verb['comparison']
    offline.write_report(analysis, tmp_path / 'door.html')
    assert 'Noise of 2 inertial sensors' in (tmp_path / 'door.html').read_text('utf-8')
    assert offline.compare([tmp_path / 'verb.json', tmp_path / 'door.json']).lines
    assert offline.export(analysis, 'csv').startswith('source,topic,axis')


def test_nothing_heavy_is_imported_before_it_is_used():
    code = 'import sys; from imu_bench import offline; print("numpy" in sys.modules)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == 'False'


@pytest.mark.slow
def test_an_analysis_imports_of_scipy_what_all_of_them_need():
    """A correlation with the temperature had brought the optimizers along, 0.1 s of every run."""
    rooms = 'optimize', 'signal', 'stats', 'interpolate', 'sparse', 'integrate'
    code = (
        'import sys, imu_bench.offline.analysis.recording\n'
        f'print([m for m in {rooms} if "scipy." + m in sys.modules])'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'
