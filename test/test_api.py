# SPDX-License-Identifier: Apache-2.0
"""The Python interface says what the JSON document says; notebooks run; importing it is free."""

import json
from pathlib import Path
import re
import subprocess
import sys

import imu_bench as ib
from imu_bench.api.views import COEFFICIENTS, SHORT
from imu_bench.errors import RecordingError
from imu_bench.offline.analysis.axis_result import STATISTICS
import numpy as np
import pytest

DOCS = Path(__file__).resolve().parent.parent / 'docs'


def write(folder, name, scale):
    rng = np.random.default_rng(5)
    np.savez(
        folder / f'{name}.npz',
        stamps=np.arange(4000) * 10_000_000,
        acceleration=rng.normal([0.0, 0.0, 9.80665], 0.01 * scale, (4000, 3)),
        angular_velocity=rng.normal(0.0, 1e-3 * scale, (4000, 3)),
    )
    return folder / f'{name}.npz'


@pytest.fixture(scope='module')
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp('api')
    return ib.analyze(write(folder, 'quiet', 1.0), write(folder, 'loud', 3.0), reference='quiet')


@pytest.mark.slow
def test_every_number_is_that_of_the_json_document(result):
    document = json.loads(json.dumps(result.to_json()))
    assert len(result) == len(document['recordings']) == 2
    for sensor, recording in zip(result, document['recordings'], strict=True):
        assert set(sensor.axes) == set(recording['axes'])
        for name, axis in recording['axes'].items():
            quantity, _, letter = name.rpartition('.')
            short = {full: short for short, full in SHORT.items()}[quantity]
            found = sensor.axes[name]
            assert getattr(getattr(sensor, short), letter).name == name
            for term in COEFFICIENTS:
                assert getattr(found, term).to_json() == axis['coefficients'][term]
            for each in STATISTICS:
                assert getattr(found, each).to_json() == axis[each]
            assert found.noise_density.to_json() == axis['noise_density']
            assert found.oadev.tau.tolist() == axis['allan']['tau']


@pytest.mark.slow
def test_tables_hold_the_same_numbers(result):
    rows = result.to_pandas()
    numbers = result.to_xarray()
    for sensor in result:
        for name, axis in sensor.axes.items():
            quantity, _, letter = name.rpartition('.')
            cell = rows[
                (rows.topic == sensor.topic) & (rows.axis == name) & (rows.parameter == 'N')
            ]
            place = numbers[f'{quantity}.N'].sel(sensor=sensor.label, axis=letter)
            assert cell['value'].item() == axis.N.value == place.sel(end='value').item()
            assert cell['high'].item() == axis.N.high == place.sel(end='high').item()
            assert numbers[f'{quantity}.N'].units == cell['unit'].item() == axis.N.unit


def test_a_sensor_is_found_by_label_and_place(result):
    assert result['quiet'] is result[0]
    with pytest.raises(KeyError, match="'left' is no sensor of this result: quiet, loud"):
        result['left']
    with pytest.raises(AttributeError, match="quiet has no 'magnetometer'; it has accel, gyro"):
        _ = result['quiet'].magnetometer
    with pytest.raises(AttributeError, match=r"angular_velocity\.x has no 'M'; it has Q, N, B, K"):
        _ = result['quiet'].gyro.x.M
    with pytest.raises(AttributeError, match="no axis 'w'; there are x, y, z"):
        _ = result['quiet'].gyro.w


@pytest.mark.slow
def test_it_shows_itself(result):
    page = result._repr_html_()
    assert page.count('<tr>') == 1 + 2 * 6
    assert 'quiet' in repr(result)
    assert '39.99 s at 100.0' in repr(result[0])
    drawn = result.plot('allan')
    assert len(drawn) == drawn._repr_html_().count('<svg') == 4
    assert result[0].gyro.x.N._repr_html_() == str(result[0].gyro.x.N)


def test_results_are_saved_loaded_compared_and_exported(result, tmp_path):
    result.save(tmp_path / 'a.json')
    again = ib.load(tmp_path / 'a.json')
    assert again['loud'].gyro.x.N == result['loud'].gyro.x.N
    compared = ib.compare(tmp_path / 'a.json', result)
    assert {line.verdict for line in compared} <= {'same', 'undecided'}
    assert len(compared) == len(compared.to_json()['lines'])
    assert repr(compared).startswith(f'{len(compared)} numbers compared: ')
    assert compared._repr_html_().count('<tr>') == len(compared) + 2
    assert ib.export(result, 'csv') == ib.export(tmp_path / 'a.json', 'csv')
    assert 'gyroscope_noise_density' in result.export('kalibr', 'quiet', conservative=True)
    result.report(tmp_path / 'a.html')
    assert '</html>' in (tmp_path / 'a.html').read_text('utf-8')


def test_what_is_wrong_is_said(tmp_path):
    with pytest.raises(TypeError, match="unknown option 'rate'; there are topics, rate_hz, "):
        ib.analyze(tmp_path / 'x.csv', rate=100)
    (tmp_path / 'x.csv').write_text('nothing here\n')
    with pytest.raises(RecordingError, match=re.escape('x.csv')):
        ib.analyze(tmp_path / 'x.csv')
    with pytest.raises(AttributeError, match="no attribute 'analyse'"):
        _ = ib.analyse


def test_a_file_is_read(tmp_path):
    (recording,) = ib.read(write(tmp_path, 'quiet', 1.0)).values()
    assert recording.samples.angular_velocity.shape == (4000, 3)


@pytest.mark.parametrize(
    'path', sorted((DOCS / 'notebooks').glob('*.ipynb')), ids=lambda p: p.stem
)
def test_notebooks_run(path):
    document = json.loads(path.read_text('utf-8'))
    names = {}
    for cell in document['cells']:
        if cell['cell_type'] == 'code':
            assert not cell['outputs'], 'notebooks are kept without outputs'
            exec(compile(''.join(cell['source']), path.name, 'exec'), names)


def test_the_names_of_the_page_are_those_of_the_package():
    page = (DOCS / 'python.md').read_text('utf-8')
    rows = [line for line in page.splitlines() if line.startswith('| `')]
    told = set(re.findall(r'`(\w+)', ''.join(row.split('|')[1] for row in rows)))
    assert told == set(ib.__all__) - {'__version__'}


def test_curves_models_and_spectra_print_as_people_read_them():
    noise = np.random.default_rng(4).normal(0.0, 1.0, 2000)
    curve = ib.oadev(noise, 100.0, unit='rad/s')
    assert repr(curve).startswith(f'<oadev in rad/s: {len(curve)} averaging times from 0.01 to ')
    assert f'\nN = {ib.fit(curve).N}\n' in str(ib.fit(curve))
    assert '²/Hz: ' in repr(ib.psd(noise, 100.0, unit='rad/s'))


def test_types_are_there_for_others():
    for package in ('imu_bench', 'msg_conversions'):
        assert (DOCS.parent / package / 'py.typed').is_file()


def test_importing_it_imports_nothing_else():
    code = 'import sys, imu_bench; print(*sorted({n.split(".")[0] for n in sys.modules}))'
    command = [sys.executable, '-c', code]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert not {'numpy', 'scipy', 'yaml', 'msg_conversions', 'typing'} & set(found)
