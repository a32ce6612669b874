# SPDX-License-Identifier: Apache-2.0
"""A sensor node that records its wire, and one that plays it."""

import json
import zlib

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_bench import bench
from imu_bench.bus.recording import read_head, recorder
from imu_bench.bus.recording.file import BLOCK, block_of
from imu_bench.config import sensor_from_parameters
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.nodes.sensor import SensorNode
from imu_bench.simulation.clock import SimulatedClock
from msg_conversions import reading
import numpy as np
import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from sensor_msgs.msg import Imu

pytestmark = pytest.mark.ros

SENSOR = 'imu_bench.nodes.sensor_node'
SECOND = 1_000_000_000
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


@pytest.fixture
def wire(tmp_path, monkeypatch):
    """Give a recording of one second of an MPU-9250 at 500 Hz, in several blocks."""
    monkeypatch.setattr(recorder, 'BLOCK_NS', SECOND // 5)
    path = tmp_path / 'mine.wire'
    given = {
        'driver': 'mpu9250', 'backend': 'emulated', 'rate_hz': 500.0, 'wire_recording': str(path),
    }  # fmt: skip
    clock = SimulatedClock()
    sensor = sensor_from_parameters('mine', given, settings_of=bench.settings_of)
    acquisition = bench.build(sensor, clock)
    acquisition.prepare()
    acquisition.advance(clock.now_ns() + SECOND)
    acquisition.finish()
    acquisition.close()
    return path


def of_hardware(path):
    """Let a recording say that it is of hardware."""
    return changed(path, label='hardware mpu9250 i2c-1')


def changed(path, **head):
    """Write a recording anew, with another head."""
    _, line, blocks = path.read_bytes().split(b'\n', 2)
    known = json.loads(line)
    known['settings'] |= head.pop('settings', {})
    line = json.dumps(known | head).encode()
    content = b'imu_bench wire recording 1 %08x\n%s\n' % (zlib.crc32(line), line)
    crc = zlib.crc32(content)
    while blocks:
        end = BLOCK.size + BLOCK.unpack_from(blocks)[0]
        block, crc = block_of(blocks[BLOCK.size : end], crc)
        content, blocks = content + block, blocks[end:]
    path.write_bytes(content)
    return path


def playing(path, **more):
    return {'backend': 'recorded', 'wire_recording': str(path), **more}


def test_what_was_recorded_is_published_with_the_stamps_of_then(ros, wire):
    received, statuses = [], []
    node = ros.add(Node, 'listener')
    node.create_subscription(Imu, '/bench/left/imu/data_raw', received.append, 1000)
    node.create_subscription(
        DiagnosticArray, '/diagnostics', lambda array: statuses.extend(array.status), 10
    )
    played = ros.add(SensorNode, 'left', parameters=playing(of_hardware(wire), autostart=False))
    publisher = '/bench/left/imu/data_raw'
    played.trigger_configure()
    ros.spin_until(lambda: node.count_publishers(publisher), 'the topic')
    ros.spin_until(
        lambda: all(p.get_subscription_count() for p in played.publishers if 'imu/data' in p.topic)
    )
    played.trigger_activate()
    ros.spin_until(played.ended.done, 'the end of the recording')
    assert played.ended.result() is None
    runs, _ = bench.play(wire)
    imu = [run for run in runs if run.acceleration is not None]
    total = sum(map(len, imu))
    ros.spin_until(lambda: len(received) >= total, 'every sample')
    block = reading.imu(received)
    np.testing.assert_array_equal(block.stamps, np.concatenate([run.stamps for run in imu]))
    np.testing.assert_array_equal(
        block.acceleration, np.concatenate([run.acceleration for run in imu])
    )
    ros.spin_until(lambda: any('over after' in status.message for status in statuses))
    status = next(status for status in statuses if 'over after' in status.message)
    assert status.level == DiagnosticStatus.OK
    assert status.hardware_id.startswith('recorded hardware mpu9250 i2c-1, 2023-11-14T22:13:20')
    values = {pair.key: pair.value for pair in status.values}
    assert values['backend'] == 'recorded'
    assert values['wire_recording'].startswith(f'playing {wire}')


def test_parameters_are_those_of_the_recording(ros, wire):
    node = ros.add(SensorNode, 'left', parameters=playing(wire, autostart=False))
    assert node.get_parameter('driver').value == 'mpu9250'
    assert node.get_parameter('rate_hz').value == 500.0


def test_other_settings_are_refused(ros, wire):
    with pytest.raises(ConfigError, match=r'^parameters\.rate_hz: recorded with 500\.0') as caught:
        ros.add(SensorNode, 'left', parameters=playing(wire, rate_hz=1000.0))
    assert '\n' not in str(caught.value)


def test_what_cannot_be_played_ends_the_node_with_the_reason(ros, wire):
    path = changed(wire, settings={'rate_hz': 250.0})
    with pytest.raises(RecordingError, match=r'asked: write .* to register 0x.*; recorded: write'):
        ros.add(SensorNode, 'left', parameters=playing(path))


def test_a_node_records_what_it_can_play(ros, tmp_path):
    path = tmp_path / 'mine.wire'
    node = ros.add(
        SensorNode, 'left',
        parameters={'driver': 'bno055', 'backend': 'emulated', 'wire_recording': str(path)},
    )  # fmt: skip
    ros.spin_until(lambda: node.acquisition.stats.samples > 20)
    assert node.acquisition.stats.tape.startswith(f'recording to {path}')
    node.trigger_deactivate()
    assert node.acquisition.stats.tape.startswith(f'recorded to {path}')
    stats = node.acquisition.stats
    assert read_head(path).label == 'emulated bno055'
    _, again = bench.play(path)
    assert again.counters == stats.counters
    assert again.samples == stats.samples


def test_the_process_ends_when_the_recording_does(start, wire):
    given = ['-p', 'backend:=recorded', '-p', f'wire_recording:={wire}']
    node = start(SENSOR, '--ros-args', *given, '-r', '__ns:=/bench/x')
    assert 'these are not measurements' in node.wait_for('recorded emulated mpu9250')
    code, output = node.finish()
    assert code == 0, output
    assert ': over after ' in output


def test_the_process_says_where_a_recording_is_damaged(start, wire):
    content = bytearray(wire.read_bytes())
    content[-20] ^= 1  # of the last block, before the mark of the end
    wire.write_bytes(content)
    given = ['-p', 'backend:=recorded', '-p', f'wire_recording:={wire}', '--log-level', 'fatal']
    code, output = start(SENSOR, '--ros-args', *given).finish()
    assert code == 1
    assert output.count('\n') == 1, output
    assert f'{wire}: damaged at byte' in output
    # not at its first block, which is read before the node is up
    assert int(output.partition('at byte ')[2].split()[0]) > 2000


def test_who_was_stopped_has_to_be_configured_anew(ros, wire):
    node = ros.add(SensorNode, 'left', parameters=playing(wire))
    assert node.trigger_deactivate() == SUCCESS
    assert node.trigger_activate() == FAILURE
    assert not node.ended.done()
    assert node.trigger_cleanup() == SUCCESS
    assert node.trigger_configure() == SUCCESS
    assert node.trigger_activate() == SUCCESS
    ros.spin_until(node.ended.done, 'the end')


def test_the_process_says_what_it_cannot_play(start, tmp_path):
    path = tmp_path / 'none.wire'
    given = ['-p', 'backend:=recorded', '-p', f'wire_recording:={path}']
    code, output = start(SENSOR, '--ros-args', *given).finish()
    assert code == 1
    assert output.count('\n') == 1, output
    assert f'parameters.wire_recording: {path}: No such file or directory' in output
