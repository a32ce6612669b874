# SPDX-License-Identifier: Apache-2.0
"""
What every verb that works on recordings says and writes, reduced to what can be kept and compared.

A case is a command line.  `{data}` is the folder of the shared recordings, `{here}` the folder of
the case, `{NAME}` the folder of another case, which is then run before.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import math
import os
from pathlib import Path
import re
import shutil
from typing import Any

import numpy as np

FEW = 12
"""Numbers of an array that are kept as they are; of a longer one some, and sums over all."""

_NAMES = ','.join(
    f'{short}_{axis}={name}.{axis}'
    for short, name in (('gyr', 'angular_velocity'), ('acc', 'linear_acceleration'))
    for axis in 'xyz'
)
FERRARIS = (
    '{data}/ferraris_session/example_ferraris_session.csv', '--rate', '102.4',
    '--columns', f'n_samples=index,{_NAMES}',
    '--units', 'linear_acceleration=m/s^2,angular_velocity=deg/s',
)  # fmt: skip
ELEVATOR = (
    '{data}/elevator_phone/data/skyscrapper_up.csv',
    '--units', 'stamp=ms,linear_acceleration=m/s^2',
)  # fmt: skip
MPU6050 = (
    '{data}/mpu6050_static/results test data/imu_static_test.csv', '--rate', '100',
    '--units', 'linear_acceleration=g/16384,angular_velocity=deg/s/131',
)  # fmt: skip
UNITS = ('--rate', '100', '--columns', 'ax,ay,az,wx,wy,wz', '--units', 'SI', '--jobs', '1')
WRITTEN = ('--json', '{here}/results.json', '--html', '{here}/report.html')
FORMATS = (
    'kalibr', 'openvins', 'orb-slam3', 'vins', 'gtsam', 'robot_localization', 'sensor_msgs',
    'gz-sim', 'kalman', 'csv',
)  # fmt: skip
SHEETS = """\
imu2:
  source: a page
  linear_acceleration: {noise_density: 120 µg/√Hz, bias_instability: 40 µg}
  angular_velocity: {noise_density: [0.005 °/s/√Hz, 0.005 °/s/√Hz, 0.02 °/s/√Hz]}
"""

CASES: dict[str, tuple[str, ...]] = {
    'one': ('analyze', *MPU6050, *WRITTEN, '--jobs', '1'),
    'figures': ('analyze', *ELEVATOR, '--figures', '{here}/figures', '--jobs', '1'),
    'units': (
        'analyze', '{data}/mpu9150_five_units/imu2.log', '{data}/mpu9150_five_units/imu3.log',
        *UNITS, *WRITTEN, '--reference', 'imu3',
        '--datasheet', '{here}/sheets.yaml',
    ),
    'part': (
        'analyze', '{data}/mpu9150_five_units/imu2.log', *UNITS, '--si', '--start', '5', '--end',
        '60', '--tau', '0.1,0.5,2', '--min-share', '0.9', '--json', '{here}/results.json',
    ),
    'moving': ('analyze', '{data}/rosbag1_husky_imu/test/test2.bag', *WRITTEN, '--strict'),
    'streams': (
        'analyze', '{tilt}/tilt/tilt_steps', '--json', '{here}/results.json', '--jobs', '1',
    ),
    'nothing': ('analyze', '{data}/rosbag1_samples', '--jobs', '1'),
    'narrow': (
        'analyze', '{data}/mpu9150_five_units/imu2.log', *UNITS, '--end', '20',
    ),
    'ferraris': ('analyze', '--plan', 'six-position', *FERRARIS, *WRITTEN, '--jobs', '1',
                 '--set', 'gravity=9.81 m/s²', '--set', 'yaml={here}/calibration.yaml'),
    'elevator': ('analyze', '--plan', 'vibration', *ELEVATOR, *WRITTEN, '--jobs', '1'),
    'wrong_plan': ('analyze', '--plan', 'statics', *ELEVATOR),
    'wrong_setting': ('analyze', '--plan', 'thermal', *ELEVATOR, '--set', 'x=1'),
    **{
        name: ('campaign', '{here}/bench.yaml', '--test', name, '--jobs', '1', '-o', '{here}')
        for name in ('rest', 'tilt', 'heat', 'lift', 'shaker')
    },
    'rest_noise': ('analyze', '{rest}/rest', *WRITTEN, '--jobs', '1'),
    'list': ('campaign', '{here}/bench.yaml', '--list'),
    'compare': ('compare', '{one}/results.json', '{part}/results.json', '--json',
                '{here}/comparison.json', '--html', '{here}/comparison.html'),
    'compare_runs': ('compare', '{units}/results.json', '{part}/results.json'),
    **{f'export_{name}': ('export', '{units}/results.json', '--topic', 'imu2', '--force', '--to',
                          name)
       for name in FORMATS},
    'export_refused': ('export', '{units}/results.json', '--to', 'kalibr', '-o', '{here}/all'),
    'export_all': ('export', '{units}/results.json', '--force', '--to', 'kalibr', '-o',
                   '{here}/all'),
    **{f'conservative_{name}': ('export', '{one}/results.json', '--conservative', '--to', name)
       for name in FORMATS},
    'import_csv': ('import', '{tilt}/tilt/tilt_steps', '--to', 'csv', '-o', '{here}/csv'),
    'import_npy': ('import', '{data}/rosbag1_husky_imu/test/test2.bag', '--to', 'npy', '-o',
                   '{here}/npy'),
    'import_bag': ('import', *ELEVATOR, '-o', '{here}/bag'),
    'import_whole': ('import', '{tilt}/tilt/tilt_steps', '--to', 'sqlite3', '-o', '{here}/bag'),
}  # fmt: skip

COLUMNS = {'narrow': 60, 'compare_runs': 60, 'units': 130}
"""Widths of the terminal; 200 for the others."""


class Golden:
    """
    Runs cases, each once.

    Parameters
    ----------
    run : callable
        Takes a command line and the width of the terminal, returns exit code, stdout and stderr.
    folder, data : Path
        Where to work, and where the shared recordings are.
    """

    def __init__(self, run, folder: Path, data: Path) -> None:
        self._run = run
        self._folder = folder
        self._data = data
        self._found: dict[str, dict[str, Any]] = {}

    def result(self, name: str) -> dict[str, Any]:
        """Return what a case says and writes: its text, and its files reduced."""
        if name in self._found:
            return self._found[name]
        here = self._folder / name
        here.mkdir(exist_ok=True)
        line = CASES[name]
        for other in re.findall(r'\{(\w+)\}', ' '.join(line)):
            if other in CASES:
                self.result(other)
        self._prepare(name, here)
        places = {'data': str(self._data), 'here': str(here)}
        places |= {other: str(self._folder / other) for other in CASES}
        before = set(here.rglob('*'))
        code, out, err = self._run(
            [part.format(**places) for part in line], COLUMNS.get(name, 200)
        )
        text = f'exit code {code}\n--- stdout\n{out}--- stderr\n{err}'
        files = {}
        for path in sorted(set(here.rglob('*')) - before):
            if path.is_file() and not (path.parent / 'truth.json').exists():  # simulated
                relative = path.relative_to(here)
                files[str(relative)] = self._reduced(path)
        self._found[name] = {'text': self._nameless(text), 'files': files}
        return self._found[name]

    def _prepare(self, name: str, here: Path) -> None:
        if name == 'units':
            (here / 'sheets.yaml').write_text(SHEETS, encoding='utf-8')
        if '{here}/bench.yaml' in CASES[name]:
            shutil.copy(Path(__file__).with_name('bench.yaml'), here)

    def _nameless(self, text: str) -> str:
        """Return text without the folders of this run, colours and spaces at ends of lines."""
        text = re.sub(r'\x1b\[[0-9;]*m', '', text)
        text = text.replace(str(self._folder), '<work>').replace(str(self._data), '<data>')
        return '\n'.join(line.rstrip() for line in text.split('\n'))

    def _reduced(self, path: Path) -> Any:
        suffix = path.suffix
        if suffix == '.json':
            return json.loads(
                self._nameless(json.dumps(_thin(json.loads(path.read_text('utf-8')))))
            )
        if suffix == '.html':
            return _thin(_page(self._nameless(path.read_text('utf-8'))))
        if suffix in ('.yaml', '.txt'):
            return self._nameless(path.read_text('utf-8'))
        if suffix == '.csv':
            return _thin(_table(path))
        if suffix == '.npy':
            return _thin(np.load(path).T.tolist())
        if suffix in ('.mcap', '.db3'):
            return _bag(path)
        return 'there'  # a picture


def _thin(value: Any) -> Any:
    """Return a document in which long arrays of numbers are some of them and two sums."""
    if isinstance(value, dict):
        return {key: _thin(item) for key, item in value.items()}
    if not isinstance(value, list | tuple):
        return None if isinstance(value, float) and math.isnan(value) else value
    if len(value) <= FEW or not all(isinstance(x, int | float | None) for x in value):
        return [_thin(item) for item in value]
    numbers = [0.0 if x is None or math.isnan(x) else float(x) for x in value]
    at = sorted({round(k * (len(value) - 1) / 4) for k in range(5)})
    return {
        'size': len(value),
        'some': [numbers[k] for k in at],
        'sum': math.fsum(map(abs, numbers)),
        'moment': math.fsum(abs(x) * k for k, x in enumerate(numbers)) / len(value),
        'lost': sum(x is None or math.isnan(x) for x in value),
    }


def figures_in(text: str) -> list[Any]:
    """Return the documents of the figures of a page."""
    packed = re.search(r'id="packed-figures">([^<]*)<', text)
    return [] if packed is None else json.loads(gzip.decompress(base64.b64decode(packed[1])))


def _page(text: str) -> dict[str, Any]:
    """Return the words of a page and what its figures hold."""
    figures = figures_in(text)
    text = re.sub(r'<(style|script)\b.*?</\1>', '', text, flags=re.DOTALL)
    words = html.unescape(re.sub(r'<[^>]*>', '\n', text))
    lines = [line.strip() for line in words.split('\n')]
    return {
        'words': [line for line in lines if line],
        'figures': [_figure(figure['doc']['roots']) for figure in figures],
    }


def _figure(part: Any) -> Any:
    """Return the objects of a figure without their identifiers, arrays as numbers."""
    if isinstance(part, list):
        return [_figure(item) for item in part]
    if not isinstance(part, dict):
        return part
    if part.get('type') == 'ndarray':
        packed = gzip.decompress(base64.b64decode(part['array']['data']))
        return np.frombuffer(packed, part['dtype']).astype(float).tolist()
    if part.get('type') == 'object':
        return {part['name']: _figure(part['attributes'])}
    return {key: _figure(item) for key, item in part.items() if key != 'id'}


def _table(path: Path) -> dict[str, Any]:
    """Return the columns of a table in a file."""
    lines = path.read_text('utf-8').splitlines()
    head = [line for line in lines if line[:1].isalpha() or line.startswith('#')]
    rows = [line.split(',') for line in lines if line not in head]
    try:
        return {
            'head': head,
            'columns': [[float(x) if x else None for x in c] for c in zip(*rows, strict=True)],
        }
    except ValueError:
        return {'lines': lines}


def _bag(path: Path) -> dict[str, Any]:
    """Return the messages of a bag by topic: how many, and a digest of their bytes."""
    from imu_bench.bags.bag import Bag

    bag = Bag(path)
    found = {}
    for topic in sorted(channel.topic for channel in bag.channels):
        digest, size = hashlib.sha256(), 0
        for block in bag.blocks({topic}):
            for message in block.blobs():
                digest.update(message)
                size += 1
        found[topic] = [size, digest.hexdigest()[:16]]
    bag.close()
    return found


def differences(found: Any, expected: Any, where: str = '') -> list[str]:
    """Return where two documents differ: numbers by more than 1e-9 of themselves."""
    if isinstance(expected, dict) and isinstance(found, dict):
        lines = [f'{where}: only expected: {key}' for key in expected.keys() - found.keys()]
        lines += [f'{where}: not expected: {key}' for key in found.keys() - expected.keys()]
        for key in expected.keys() & found.keys():
            lines += differences(found[key], expected[key], f'{where}.{key}')
        return lines
    if isinstance(expected, list) and isinstance(found, list) and len(found) == len(expected):
        return [
            line
            for index, (one, other) in enumerate(zip(found, expected, strict=True))
            for line in differences(one, other, f'{where}[{index}]')
        ]
    numbers = all(
        isinstance(x, int | float) and not isinstance(x, bool) for x in (found, expected)
    )
    if numbers and math.isclose(found, expected, rel_tol=1e-9, abs_tol=1e-300):
        return []
    return [] if found == expected else [f'{where}: {found!r}, expected {expected!r}']


EXPECTED = Path(__file__).with_name('expected')
WRITE = bool(os.environ.get('IMU_BENCH_WRITE_GOLDEN'))


def kept(name: str) -> dict[str, Any]:
    """Return what is expected of a case."""
    files = EXPECTED / f'{name}.json.gz'
    return {
        'text': (EXPECTED / f'{name}.txt').read_text(encoding='utf-8'),
        'files': json.loads(gzip.decompress(files.read_bytes())) if files.exists() else {},
    }


def keep(name: str, found: dict[str, Any]) -> None:
    """Make what was found what is expected."""
    EXPECTED.mkdir(exist_ok=True)
    (EXPECTED / f'{name}.txt').write_text(found['text'], encoding='utf-8')
    packed = json.dumps(found['files'], ensure_ascii=False, sort_keys=True).encode('utf-8')
    if found['files']:
        (EXPECTED / f'{name}.json.gz').write_bytes(gzip.compress(packed, 9, mtime=0))
