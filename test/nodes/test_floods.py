# SPDX-License-Identifier: Apache-2.0
"""Somebody floods a bench: what he says too much is counted, and fills no disk."""

from collections import Counter

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_bench.account import BESIDE, counts, flooded, LEFT_OUT
from imu_bench.nodes import others
from imu_bench.nodes.others import BESIDE_BYTES, Others
from imu_bench.nodes.recorder import message_class, RecorderNode
from imu_bench.nodes.sensor import SensorNode
from imu_bench.offline.health.check import check
from imu_bench.offline.recordings import load, open_source
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import Imu

pytestmark = pytest.mark.ros

TOPIC = '/bench/left/imu/data_raw'
SENSOR = {
    'driver': 'generic',
    'backend': 'emulated',
    'rate_hz': 200.0,
    'simulation.acceleration.noise_density': '60 µg/√Hz',
}


@pytest.fixture
def recorder(ros, tmp_path):
    """Return the recorder of a bench of one sensor, which runs."""
    made = {'output': str(tmp_path / 'bag'), 'sensors': ['/bench/left']}
    recorder = ros.add(RecorderNode, parameters=made)
    ros.add(SensorNode, 'left', parameters=SENSOR)
    return recorder


def values_of(status):
    return {pair.key: pair.value for pair in status.values}


def passed(recorder, said):
    """Yield whether the sensor has spoken once more, and nothing was left out meanwhile."""
    while True:
        out, heard = recorder._others.left_out, said.get('left: acquisition')
        while said.get('left: acquisition') is heard:
            yield False
        yield recorder._others.left_out == out


def of_sensor(recorder):
    with open_source(recorder.path) as source:
        return load(source, TOPIC)


def array(name, size, hardware_id=''):
    status = DiagnosticStatus(name=name, hardware_id=hardware_id, message='x' * size)
    return DiagnosticArray(status=[status])


def stored_bytes(bag, topic):
    """Return by the first name of /diagnostics, or '', how many bytes are in a bag."""
    found = Counter()
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            if connection.topic == topic:
                message = deserialize_message(bytes(data), message_class(connection.msgtype))
                found[message.status[0].name if topic == '/diagnostics' else ''] += len(data)
    return found


@pytest.mark.parametrize('name', ['foreign', 'left: forged'])
def test_a_flood_on_diagnostics_does_not_fill_the_disk(ros, elsewhere, said, recorder, name):
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    flood = elsewhere.add(Node, 'visitor').create_publisher(DiagnosticArray, '/diagnostics', 1000)
    ros.spin_until(lambda: flood.get_subscription_count() > 1, 'he is heard')
    status, message = 'recorder: recording', serialize_message(array(name, 30_000))
    sent = 0
    while sent < 16 * BESIDE_BYTES or not recorder._others.left_out:
        flood.publish(message)
        sent += len(message)
    ros.spin_until(lambda: LEFT_OUT in values_of(said[status]), 'that is said')
    over = passed(recorder, said)
    for _ in range(3):  # or none of what the sensor says of itself had room in the bag
        ros.spin_until(lambda: next(over), 'the sensor goes on after the flood')
    line = said[status].message
    assert (said[status].level, line) == (b'\x01', flooded(int(values_of(said[status])[LEFT_OUT])))
    recorder.close()
    found = stored_bytes(recorder.path, '/diagnostics')
    own = stored_bytes(recorder.path, TOPIC)['']
    assert BESIDE_BYTES // 2 < found[name] < sent / 2
    if name == 'foreign':
        assert found[name] <= BESIDE_BYTES + own
    recording = of_sensor(recorder)
    assert recording.delivery.missing == 0
    assert 'flooded' in {finding.code for finding in check(recording).findings}


def test_a_flood_on_a_topic_beside_the_bench_does_not_fill_the_disk(
    ros, elsewhere, said, recorder
):
    beside = '/elsewhere/imu/data_raw'
    flood = elsewhere.add(Node, 'visitor').create_publisher(Imu, beside, 5000)
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    ros.spin_until(flood.get_subscription_count, 'he is heard')

    message = serialize_message(Imu())
    while not recorder._others.beside[beside]:
        flood.publish(message)
    status = 'recorder: recording'
    ros.spin_until(lambda: counts(values_of(said[status])).get(BESIDE + beside), 'said')
    before = recorder.received['/diagnostics']
    ros.spin_until(lambda: recorder.received['/diagnostics'] > before + 5, 'the nodes go on')
    recorder.close()
    found, own = (stored_bytes(recorder.path, topic)[''] for topic in (beside, TOPIC))
    assert BESIDE_BYTES - 1000 < found <= BESIDE_BYTES + own
    assert of_sensor(recorder).delivery.missing == 0


def test_the_nodes_have_room_when_a_crowd_has_used_up_its_own():
    others = Others(['/bench/left'], '/bag')

    def rows(*messages):
        return np.array([list(serialize_message(message)) for message in messages], np.uint8)

    crowd = rows(*[array('crowd: left', 1000)] * 2000)
    kept = int(np.count_nonzero(others.recordable(crowd)))
    assert kept == BESIDE_BYTES // crowd.shape[1]
    assert others.left_out == 2000 - kept
    for name in ('left: acquisition', '/bench/left: others', 'analysis_node: load'):
        assert others.recordable(rows(array(name, 1000))).all()
    assert others.recordable(rows(array('recorder: recording', 10, '/bag'))).all()
    assert not others.recordable(rows(array('recorder: recording', 1000, '/else'))).any()
    assert others.bag == '/else'
    assert Others([], '/bag').recordable(crowd).all()  # all of it was asked for


def ask(ros, client):
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
    return ros.call(client, request).success


def test_who_asks_without_end_is_counted_and_fills_no_log(ros, said, recorder, monkeypatch):
    monkeypatch.setattr(others, 'MOST', 3)
    client = ros.add(Node, 'visitor').create_client(
        ChangeState, '/bench/left/sensor_node/change_state'
    )
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    for _ in range(8):
        ask(ros, client)
    ros.spin_until(lambda: values_of(said['left: others']).get('more_asked') == '5', 'counted')
    asked = [key for key in values_of(said['left: others']) if key.startswith('asked.')]
    assert len(asked) == 3
