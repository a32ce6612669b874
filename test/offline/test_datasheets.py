# SPDX-License-Identifier: Apache-2.0
"""Typical values from a YAML file: measured against them, and bad files in one line."""

from dataclasses import replace
import json

from imu_bench.cli.main import main
from imu_bench.errors import ConfigError
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.comparing.sensors import compare, read_datasheets
import numpy as np
import pytest

DENSITY = 2e-3
"""One-sided, m/s²/√Hz, of the acceleration that the fixture `noise` makes."""

SHEET = """\
night:
  source: XY-100, table 2
  linear_acceleration: {noise_density: [204 µg/√Hz, 1 mg/√Hz, 20 µg/√Hz]}
"""


@pytest.fixture
def sheet(tmp_path):
    path = tmp_path / 'sheets.yaml'
    path.write_text(SHEET, encoding='utf-8')
    return path


@pytest.fixture(scope='module')
def result(recording_of, noise):
    found = analyse(recording_of(noise(5)))
    return replace(found, source='night.csv', topic='night', frame_id='')


def test_each_axis_has_its_verdict(sheet, result):
    density = result.axes['linear_acceleration.x'].white_density.value
    assert density == pytest.approx(DENSITY, rel=0.5)
    found = compare([result], '', read_datasheets(sheet)).verdicts
    assert [verdict.source for verdict in found] == ['XY-100, table 2'] * 3
    assert [verdict.verdict for verdict in found][1:] == ['better', 'worse']
    assert compare([result]).verdicts == ()


def test_it_goes_before_the_driver(sheet, result):
    known = replace(result, topic='/bench/mpu9250/imu/data_raw', source='x.mcap')
    sheets = {'mpu9250': read_datasheets(sheet)['night']}
    found = compare([known], '', sheets).verdicts
    assert {v.source for v in found if v.axis.startswith('linear')} == {'XY-100, table 2'}
    assert {v.source for v in found if v.axis.startswith('angular')} != {'XY-100, table 2'}


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('a: 1', 'a: must hold linear_acceleration, angular_velocity'),
        ('a: {gyro: {}}', 'a.gyro: not one of source, linear_acceleration, angular_velocity'),
        ('a: {angular_velocity: {bias: 1 °/s}}', 'a.angular_velocity.bias: unknown'),
        ('a: {angular_velocity: {noise_density: 3}}', 'a.angular_velocity.noise_density: '),
        ('a: {angular_velocity: {noise_density: 3 m/s}}', 'a.angular_velocity.noise_density: '),
        ('- 1', 'holds no mapping'),
    ],
)
def test_bad_files(tmp_path, text, words):
    path = tmp_path / 'bad.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(ConfigError) as caught:
        read_datasheets(path)
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


def test_the_command_writes_verdicts_and_names_who_is_not_there(tmp_path, sheet, capsys):
    rng = np.random.default_rng(2)
    rows = np.column_stack([np.arange(3000) / 100, rng.normal([0, 0, 9.8], 0.02, (3000, 3))])
    header = 'stamp_s,' + ','.join(f'linear_acceleration.{axis}' for axis in 'xyz')
    np.savetxt(tmp_path / 'night.csv', rows, delimiter=',', header=header, comments='')
    document, page = tmp_path / 'r.json', tmp_path / 'r.html'
    given = ['analyze', str(tmp_path / 'night.csv'), '--datasheet', str(sheet)]
    assert main([*given, '--json', str(document), '--html', str(page)]) == 0
    found = json.loads(document.read_text(encoding='utf-8'))['comparison']
    assert len([v for v in found['datasheet'] if v['source'] == 'XY-100, table 2']) == 3
    assert 'XY-100, table 2' in page.read_text(encoding='utf-8')
    sheet.write_text(SHEET.replace('night', 'day'), encoding='utf-8')
    assert main(given) == 1
    assert '--datasheet day: not among the sensors: night' in capsys.readouterr().err
