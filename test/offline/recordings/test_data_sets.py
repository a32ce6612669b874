# SPDX-License-Identifier: Apache-2.0
"""
docs/data_sets.md says what is read of every data set there is: compared with what is read.

`IMU_BENCH_WRITE_DOCS=1 ./run test test/offline/recordings/test_data_sets.py` writes the table.
"""

from __future__ import annotations

from collections import defaultdict
import json
import os
from pathlib import Path

from imu_bench.bags.bag import Bag
from imu_bench.bags.ros1 import Ros1File
from imu_bench.errors import RecordingError
from imu_bench.metrology.stamps.timing import analyse
from imu_bench.offline.analysis.axes import axes
from imu_bench.offline.analysis.recording import analyse as measured
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.notation import count, duration, number
from imu_bench.offline.recordings import find_recordings, load_all, open_source, ReadOptions
import pytest

pytestmark = pytest.mark.data

PAGE = Path(__file__).parents[3] / 'docs' / 'data_sets.md'
MARK = '<!-- made by test/offline/recordings/test_data_sets.py -->\n'
COUNTS = 'linear_acceleration=g/16384,angular_velocity=deg/s/131'
FERRARIS = 'linear_acceleration=m/s^2,angular_velocity=deg/s'
OPTIONS = {
    'mpu6050_static': {'rate_hz': 100.0, 'units': COUNTS},
    'mpu9150_five_units': {'rate_hz': 100.0, 'columns': 'ax,ay,az,wx,wy,wz', 'units': 'SI'},
    'ferraris_session/example': {'rate_hz': 102.4, 'units': FERRARIS},
    'ferraris_session/annotated': {
        'rate_hz': 102.4,
        'units': 'linear_acceleration=g/2048,angular_velocity=deg/s/16.4',
    },
    'nbs14/nbs14_1000_frequency': {
        'rate_hz': 1.0,
        'columns': 'angular_velocity.x',
        'units': 'SI',
    },
    'elevator_phone': {'units': 'stamp=ms,linear_acceleration=m/s^2'},
}
"""What the user has to say, by how the path begins."""

NOT_IMU = ('characterization result data', 'optmization result data')
"""Folders of tables that are results, not recordings."""


def recordings(folder: Path) -> list[Path]:
    """Return everything of a data set that may be a recording, and what pretends to be one."""
    if folder.name == 'nbs14':  # single columns, which nobody takes for an IMU
        return sorted(folder.glob('*.csv'))
    found = {path for path in find_recordings(folder) if path.parent.name not in NOT_IMU}
    if folder.name == 'rosbag1_samples':
        found |= {path for path in folder.rglob('*') if path.parent.name == 'fixtures'}
    return sorted(found)


def row(data: Path, path: Path) -> tuple[str, str, str]:
    """Return format, what the user has to say, and what is read."""
    place = str(path.relative_to(data))
    given = next((o for begin, o in OPTIONS.items() if place.startswith(begin)), {})
    try:
        with open_source(path, ReadOptions(**given)) as source:
            if not any(topic.is_imu for topic in source.topics):
                return source.format, '', without_imu(path, source.format)
            found = [described(one) for one in load_all(source, source.select())]
            return source.format, options(given), '; '.join(found)
    except RecordingError as problem:
        return '', options(given), f'refused: {str(problem).partition(": ")[2]}'


def options(given: dict[str, object]) -> str:
    shown = {name.removesuffix('_hz'): value for name, value in given.items()}
    return ' '.join(f'`--{name} {value}`' for name, value in sorted(shown.items()))


def described(recording) -> str:
    timing = analyse(recording.samples.stamps)
    where = f'`{recording.topic}`, ' if recording.topic.startswith('/') else ''
    there = len(list(axes(recording.samples)))
    left = f', {recording.left_out} left out' if recording.left_out else ''
    return (
        f'{where}{len(recording)} samples of {there} {"axis" if there == 1 else "axes"}{left}, '
        f'{duration(timing.duration_s)} at {number(1 / timing.period_s, 4)} Hz'
    )


def without_imu(path: Path, form: str) -> str:
    """Return what a bag without Imu holds, by reading every message of it."""
    bag = Ros1File(path) if form == 'rosbag1' else Bag(path)
    names = {channel.topic for channel in bag.channels}
    read = sum(len(block) for block in bag.blocks(names))
    stored = sum(bag.counts.values())
    bag.close()
    assert read == stored
    return (
        'no Imu topic: refused with the list of topics; '
        f'all {count(read, "message")} of {count(len(names), "topic")} can be read'
    )


def table(data: Path) -> str:
    """Return the table of every recording; alike ones of one folder share a row."""
    lines = [
        '| data set | licence | recording | format | options | result |',
        '|---|---|---|---|---|---|',
    ]
    for folder in sorted(path for path in data.iterdir() if path.is_dir()):
        source = dict(
            line.split(': ', 1)
            for line in (folder / 'SOURCE.txt').read_text().splitlines()
            if ': ' in line
        )
        alike: dict[tuple[str, str, str], list[str]] = defaultdict(list)
        for path in recordings(folder):
            alike[row(data, path)].append(str(path.relative_to(folder)))
        for (form, given, result), names in alike.items():
            named = ', '.join(f'`{name}`' for name in names)
            licence = source.get('licence', 'public domain')
            cells = (folder.name, licence, named, form or 'none', given or 'none needed', result)
            lines.append('| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |')
    return '\n'.join(lines) + '\n'


@pytest.mark.slow
def test_the_table_is_what_is_read(shared_data):
    before, mark, written = PAGE.read_text('utf-8').partition(MARK)
    now = table(shared_data)
    if os.environ.get('IMU_BENCH_WRITE_DOCS'):
        PAGE.write_text(before + MARK + now, 'utf-8')
        return
    assert mark
    assert written.splitlines() == now.splitlines()


def test_every_data_set_is_in_the_table(shared_data):
    page = PAGE.read_text('utf-8')
    for folder in shared_data.iterdir():
        if folder.is_dir():
            assert f'| {folder.name} |' in page


def test_the_reference_series_of_nist_comes_out_as_published(shared_data):
    """Riley, NIST SP 1065 (2008), section 12.4: the way from a text file to the deviation."""
    folder = shared_data / 'nbs14'
    published = json.loads((folder / 'nbs14.json').read_text())['nbs14_1000']
    given = OPTIONS['nbs14/nbs14_1000_frequency']
    with open_source(folder / 'nbs14_1000_frequency.csv', ReadOptions(**given)) as source:
        [recording] = load_all(source, source.select())
    result = measured(recording, Settings(taus=tuple(published['tau_s'])))
    curve = result.axes['angular_velocity.x'].allan
    assert [float(f'{value:.7g}') for value in curve.deviation] == published['oadev']
