# SPDX-License-Identifier: Apache-2.0
"""Temperature and angles beside an Imu topic are found, those of another sensor are not."""

from dataclasses import replace

from imu_bench.bags.topic_info import describe, OfferedQos
from imu_bench.bags.writer import BagWriter
from imu_bench.offline.recordings import cache, load_all, open_source, ReadOptions
from imu_bench.offline.recordings.companions import companion
from msg_conversions import cdr
from msg_conversions.encoding import ImuTemplate, Template
import numpy as np
import pytest

STAMPS = np.arange(1, 11) * 100_000_000
FORCE = np.tile([0.0, 0.0, 9.8], (10, 1))


def write(folder, topics, storage='mcap'):
    """Write a bag with these topics: name to kind and first value."""
    with BagWriter(folder, storage) as bag:
        for name, (kind, first) in topics.items():
            bag.add_topic(describe(name, kind, [OfferedQos()]))
            values = first + np.arange(10.0)
            if kind.endswith('Imu'):
                rows = ImuTemplate('link').imu_rows(STAMPS, FORCE, None)
            elif kind.endswith('Temperature'):
                part = (cdr.TEMPERATURE_VALUE, values[:, None])
                rows = Template('link', (0.0, 0.0)).rows(STAMPS, part)
            else:
                part = (cdr.VECTOR3_VECTOR, np.repeat(values[:, None], 3, axis=1))
                rows = Template('link', (0.0, 0.0, 0.0)).rows(STAMPS, part)
            bag.write_many(name, STAMPS + 5, rows)
    return folder


IMU = 'sensor_msgs/msg/Imu'
TEMPERATURE = 'sensor_msgs/msg/Temperature'
VECTOR = 'geometry_msgs/msg/Vector3Stamped'


def recordings(path):
    with open_source(path, ReadOptions()) as source:
        return {r.topic: r for r in load_all(source, source.select())}


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_each_sensor_has_its_own(tmp_path, storage):
    bag = write(
        tmp_path / 'bag',
        {
            '/bench/a/imu/data_raw': (IMU, 0.0),
            '/bench/a/temperature': (TEMPERATURE, 20.0),
            '/bench/b/imu/data_raw': (IMU, 0.0),
            '/bench/b/temperature': (TEMPERATURE, 40.0),
            '/bench/b/inclination': (VECTOR, 0.5),
        },
        storage,
    )
    found = recordings(bag)
    first = companion(found['/bench/a/imu/data_raw'], 'temperature')
    assert first.topic == '/bench/a/temperature'
    assert first.values[:, 0].tolist() == list(range(20, 30))
    assert first.stamps.tolist() == STAMPS.tolist()
    assert companion(found['/bench/a/imu/data_raw'], 'inclination') is None
    second = found['/bench/b/imu/data_raw']
    assert companion(second, 'temperature').values[0, 0] == 40.0
    assert companion(second, 'inclination').values.shape == (10, 3)
    # a recording on the recorder's clock has companions on the same
    late = companion(replace(second, stamp_source='receive'), 'temperature')
    assert late.stamps.tolist() == (STAMPS + 5).tolist()


def test_without_a_namespace_the_only_one_counts(tmp_path):
    one = {'/imu': (IMU, 0.0), '/room/temperature': (TEMPERATURE, 20.0)}
    found = recordings(write(tmp_path / 'one', one))['/imu']
    assert companion(found, 'temperature').values[0, 0] == 20.0
    two = {**one, '/oven/temperature': (TEMPERATURE, 80.0)}
    found = recordings(write(tmp_path / 'two', two))['/imu']
    assert companion(found, 'temperature') is None


def test_of_text_it_is_in_the_table(tmp_path):
    file = tmp_path / 'log.csv'
    rows = '\n'.join(f'{k},0,0,9.8,{20 + k}' for k in range(10))
    file.write_text(
        'stamp_s,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,temperature\n'
        f'{rows}\n'
    )
    with open_source(file, ReadOptions(units='temperature=degC')) as source:
        [found] = load_all(source, source.select())
    assert companion(found, 'temperature').values[:, 0].tolist() == list(range(20, 30))
    assert companion(found, 'inclination') is None


def test_the_cache_keeps_the_temperature(tmp_path, monkeypatch):
    """And reading it costs no second pass over the bag."""
    topics = {'/bench/a/imu/data_raw': (IMU, 0.0), '/bench/a/temperature': (TEMPERATURE, 20.0)}
    bag = write(tmp_path / 'bag', topics)
    monkeypatch.setattr(cache, 'LARGE', 1)
    for _ in range(2):
        with cache.columns(bag, ReadOptions(), keep=tmp_path / 'kept') as read:
            [recording] = read.recordings
            warm = companion(recording, 'temperature')
            assert warm.values[:, 0].tolist() == list(range(20, 30))
            assert warm.stamps.tolist() == STAMPS.tolist()
            late = companion(replace(recording, stamp_source='receive'), 'temperature')
            assert late.stamps.tolist() == (STAMPS + 5).tolist()
