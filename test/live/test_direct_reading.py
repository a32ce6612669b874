# SPDX-License-Identifier: Apache-2.0
"""Recording without a middleware: what is in the bag, read by libraries of others."""

from collections import Counter
import subprocess
import sys
import threading

from imu_bench import bench
from imu_bench.config import sensor_from_parameters
from imu_bench.errors import NoAnswer, RecordingError
from imu_bench.live import direct
from msg_conversions import reading
import numpy as np
import pytest
from rosbags.highlevel import AnyReader


def sensor(name, driver='generic', **given):
    given = {'driver': driver, 'backend': 'emulated', **given}
    if driver == 'generic':
        given = {'rate_hz': 200.0, 'simulation.acceleration.noise_density': '60 µg/√Hz', **given}
    return sensor_from_parameters(name, given, settings_of=bench.settings_of)


def record(bag, sensors, samples=300, storage='mcap'):
    """Record until every sensor has given so many samples."""
    recording = direct.DirectRecording(bag, sensors, storage)
    recording.start()

    def fewest():
        said = recording.statuses
        return min(said[s.name].values['samples'] for s in sensors) if said else 0

    while fewest() < samples:
        threading.Event().wait(0.1)  # the pace of looking
    recording.close()
    return recording


@pytest.mark.slow
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_every_sample_is_in_the_bag_with_the_counts_that_say_so(tmp_path, storage):
    sensors = [sensor('left'), sensor('chip', 'mpu9250')]
    said = record(tmp_path / 'bag', sensors, storage=storage).statuses
    stored = Counter()
    values = {}
    with AnyReader([tmp_path / 'bag']) as reader:
        for connection, _, raw in reader.messages():
            stored[connection.topic] += 1
            if connection.topic == '/diagnostics':
                for status in reader.deserialize(raw, connection.msgtype).status:
                    values[status.name] = {pair.key: pair.value for pair in status.values}
        kinds = {each.topic: each.msgtype for each in reader.connections}
    assert kinds['/bench/chip/imu/mag'] == 'sensor_msgs/msg/MagneticField'
    for name in ('left', 'chip'):
        counted = values[f'{name}: acquisition']
        assert counted == {key: str(value) for key, value in said[name].values.items()}
        assert int(counted['published.imu/data_raw']) == stored[f'/bench/{name}/imu/data_raw']
        assert int(counted['samples']) == stored[f'/bench/{name}/imu/data_raw']
    assert values['recorder: recording']['missed./bench/left/imu/data_raw'] == '0'


@pytest.mark.slow
def test_the_messages_are_what_the_node_publishes(tmp_path):
    given = {'linear_acceleration_stddev': 0.01, 'frame_id': 'there'}
    record(tmp_path / 'bag', [sensor('left', **given)])
    with AnyReader([tmp_path / 'bag']) as reader:
        connection = next(c for c in reader.connections if c.topic.endswith('data_raw'))
        raws = [raw for _, _, raw in reader.messages([connection])]
        messages = [reader.deserialize(raw, connection.msgtype) for raw in raws]
    found = reading.imu(messages)
    assert found.frame_ids == ('there',)
    steps = np.diff(found.stamps)
    assert steps.min() > 0
    assert np.median(steps) == pytest.approx(5e6, rel=0.02)
    assert found.acceleration.mean(axis=0) == pytest.approx([0.0, 0.0, 9.80665], abs=0.02)
    message = messages[0]
    assert message.linear_acceleration_covariance[[0, 4, 8]] == pytest.approx([1e-4] * 3)
    assert message.angular_velocity_covariance[0] == -1.0


@pytest.mark.slow
def test_a_sensor_that_is_not_there_ends_it_before_it_begins(tmp_path):
    absent = sensor('left', 'mpu9250', **{'simulation.faults': ['unplugged 0 600']})
    with pytest.raises(NoAnswer):
        direct.DirectRecording(tmp_path / 'bag', [absent])


def test_a_bag_is_never_overwritten(tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(RecordingError, match='exists already'):
        direct.DirectRecording(tmp_path / 'bag', [sensor('left')])


def test_it_needs_no_ros(tmp_path):
    code = (
        'import sys\n'
        'for name in ("rclpy", "std_msgs", "sensor_msgs"): sys.modules[name] = None\n'
        'from imu_bench.live import direct, reading_child\n'
    )
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
