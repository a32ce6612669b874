# SPDX-License-Identifier: Apache-2.0
"""
How far a change reaches: a plan, a metric, a file format, a plot, a default, in a copy.

Each is made as a person would make it, in two files at most, and then seen in what the verbs say.
"""

import json
from pathlib import Path
import shutil
import subprocess
import sys

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
AT_MOST = 2

PLAN = '''
"""How loud it is."""

from imu_bench.offline.plans.plan import NoisePlan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation.tables import Column, Table


class Loudness(NoisePlan):
    """The standard deviation of every axis."""

    name = 'loudness'
    title = 'Loudness'

    def conclude(self, measured):
        axes = [axis for each in measured for axis in each.axes.values()]
        rows = [(axis.name, axis.statistics['std']) for axis in axes]
        unit = axes[0].unit
        table = Table('All axes', (Column('axis'), Column('loudness', unit)), tuple(rows), heads=1)
        return PlanResult(self.name, self.title, ('It was listened to.',), (table,))


PLAN = Loudness
'''

FORMAT = '''
"""Two columns of text behind a line that says so: stamp in ns, rate about z in rad/s."""

from imu_bench.offline.recordings.source import Chunk, Source, Topic
from imu_bench.samples import Samples
import numpy as np

MAGIC = b'GYRO1'


class _Reader:
    stamps_from = 'column'

    def __init__(self, path):
        self._table = np.loadtxt(path, skiprows=1)

    def chunks(self, topics, problems):
        stamps, turn = self._table.T
        turns = np.column_stack([0 * turn, 0 * turn, turn])
        for topic in topics:
            yield topic.name, Chunk(Samples(stamps.astype(np.int64), angular_velocity=turns))

    def close(self):
        pass


def open_gyro(path, options):
    reader = _Reader(path)
    return Source(path, 'gyro', (Topic(path.stem, 'gyro', len(reader._table), True),), reader)
'''


class House:
    """A copy of the package, and the files of it that were touched."""

    def __init__(self, folder):
        self.folder, self.touched = folder, set()
        for part in ('imu_bench', 'msg_conversions', 'config'):
            shutil.copytree(
                ROOT / part, folder / part, ignore=shutil.ignore_patterns('__pycache__')
            )

    def change(self, file, old, new):
        path = self.folder / 'imu_bench' / file
        text = path.read_text('utf-8')
        assert text.count(old) == 1, f'{file} has changed: {old!r}'
        path.write_text(text.replace(old, new), encoding='utf-8')
        self.touched.add(file)

    def add(self, file, text):
        path = self.folder / 'imu_bench' / file
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding='utf-8')
        self.touched.add(file)

    def run(self, *words):
        assert len(self.touched) <= AT_MOST
        code = 'from imu_bench.cli.main import main; import sys; sys.exit(main())'
        command = [sys.executable, '-P', '-c', code, *map(str, words)]
        environment = {'PYTHONPATH': str(self.folder), 'PATH': '', 'OMP_NUM_THREADS': '1'}
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment, cwd=self.folder, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


@pytest.fixture
def house(tmp_path):
    return House(tmp_path)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / 'chip.npz'
    rng = np.random.default_rng(2)
    turns = rng.normal(0.0, 1e-3, (1000, 3))
    np.savez(path, stamps=np.arange(1000) * 10_000_000, angular_velocity=turns)
    return path


@pytest.mark.slow
def test_a_plan(house, recording):
    house.add('offline/plans/loudness/__init__.py', PLAN)
    page = house.folder / 'page.html'
    said = house.run('analyze', recording, '--plan', 'loudness', '--html', page)
    assert 'It was listened to.' in said
    assert 'Loudness' in page.read_text('utf-8')


@pytest.mark.slow
def test_a_metric_of_the_report(house, recording):
    house.change(
        'offline/analysis/axis_result.py',
        '    @property\n    def letter(self)',
        '    @property\n    def crest(self) -> float:\n'
        '        """Peak to peak over the standard deviation."""\n'
        "        return self.statistics['peak_to_peak'].value / self.statistics['std'].value\n\n"
        '    @property\n    def letter(self)',
    )
    house.change(
        'offline/presentation/axis_tables.py',
        '    if all(axis.outliers is not None for axis in axes):\n',
        "    more.append(('Crest', [round(axis.crest, 3) for axis in axes]))\n"
        '    if all(axis.outliers is not None for axis in axes):\n',
    )
    page = house.folder / 'page.html'
    house.run('analyze', recording, '--html', page)
    assert 'Crest' in page.read_text('utf-8')


@pytest.mark.slow
def test_a_file_format(house, tmp_path):
    house.add('offline/recordings/gyro_text.py', FORMAT)
    house.change(
        'offline/recordings/opening.py',
        '    from imu_bench.offline.recordings import text\n',
        '    from imu_bench.offline.recordings import gyro_text, text\n\n'
        '    if start.startswith(gyro_text.MAGIC):\n'
        '        return gyro_text.open_gyro(path, options)\n',
    )
    rng = np.random.default_rng(2)
    rows = [f'{k * 10_000_000} {turn}' for k, turn in enumerate(rng.normal(0.0, 1e-3, 1000))]
    (tmp_path / 'chip.gyro').write_text('\n'.join(['GYRO1', *rows]))
    result = house.folder / 'result.json'
    house.run('analyze', tmp_path / 'chip.gyro', '--json', result)
    axes = json.loads(result.read_text())['recordings'][0]['axes']
    assert axes['angular_velocity.z']['std']['value'] == pytest.approx(1e-3, rel=0.1)


@pytest.mark.slow
def test_a_plot(house, recording):
    house.change(
        'offline/presentation/analysis_figures.py',
        "        yield 'histogram', histogram(axes, name)\n",
        "        yield 'histogram', histogram(axes, name)\n"
        "    yield 'ends', Figure(f'{name}: ends', 'axis', 'end', tuple(\n"
        "        Series(a.letter, np.zeros(1), np.array([a.statistics['maximum'].value]))\n"
        '        for a in axes\n'
        '    ))\n',
    )
    page = house.folder / 'page.html'
    house.run('analyze', recording, '--html', page)
    assert 'Angular velocity: ends' in page.read_text('utf-8')


@pytest.mark.slow
def test_a_default_for_confidence(house, recording):
    house.change('metrology/estimate.py', 'CONFIDENCE = 0.95\n', 'CONFIDENCE = 0.9\n')
    result = house.folder / 'result.json'
    house.run('analyze', recording, '--json', result)
    text = result.read_text()
    assert '"confidence": 0.9,' in text
    assert '"confidence": 0.95' not in text
