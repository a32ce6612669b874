# SPDX-License-Identifier: Apache-2.0
"""Others on the domain of a bench: they publish on its topics, or ask its nodes to change."""

from functools import partial
from pathlib import Path
from types import SimpleNamespace

from imu_bench.nodes import sensor_topics
from imu_bench.nodes.analysis import AnalysisNode
from imu_bench.nodes.others import ForeignMessages, full_name
from imu_bench.nodes.recorder import message_class, RecorderNode
from imu_bench.nodes.sensor import SensorNode
from imu_bench.nodes.sequences import Sequences
from imu_bench.offline.health.check import check
from imu_bench.offline.recordings import load, load_all, open_source
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
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
    return ros.add(RecorderNode, parameters={'output': str(tmp_path / 'bag')})


@pytest.fixture
def start_visitor(start):
    """Start a program on Cyclone DDS: two DDS libraries do not share a process."""
    return partial(start, Path(__file__).with_name('visitor.py'))


def values(status):
    return {pair.key: pair.value for pair in status.values}


def wrong(number):
    message = Imu()
    message.header.frame_id = 'left_link'  # he gives himself out for the sensor
    message.header.stamp.sec = number
    message.linear_acceleration.x = 1e6
    return message


def recorded(recorder):
    with open_source(recorder.path) as source:
        recording = load(source, TOPIC)
    return recording, check(recording)


def test_what_a_visitor_publishes_is_counted_named_and_kept_out(ros, elsewhere, said, recorder):
    ros.add(SensorNode, 'left', parameters=SENSOR)
    ros.add(AnalysisNode)
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    publisher = elsewhere.add(Node, 'visitor').create_publisher(Imu, TOPIC, 1000)
    names = '/bench/left/sensor_node, /visitor'
    line = f'several publish {TOPIC}: {names}'
    for name in ('recorder: recording', 'left: others', 'left: analysis'):
        ros.spin_until(lambda name=name: said[name].message == line, name)
        assert said[name].level == b'\x02'
        assert values(said[name])[f'several.{TOPIC}'] == names
    ros.spin_until(lambda: publisher.get_subscription_count() > 1, 'recorder and analysis count')
    for number in range(500):
        publisher.publish(wrong(number))
        ros.executor.spin_once(timeout_sec=0.0)
    key = f'foreign.{TOPIC}'
    ros.spin_until(
        lambda: values(said['recorder: recording']).get(key) == '500', 'all are counted'
    )
    recorder.close()
    recording, health = recorded(recorder)
    assert np.abs(recording.samples.acceleration).max() < 100.0
    (finding,) = [each for each in health.findings if each.severity == 'severe']
    assert finding.code == 'several_publishers'
    assert finding.text == f'{line}; 500 messages not of the sensor kept out of the bag.'


def test_a_second_node_of_the_same_name_is_a_second_sensor(
    ros, elsewhere, said, recorder, monkeypatch
):
    first = ros.add(SensorNode, 'left', parameters=SENSOR)
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    monkeypatch.setattr(sensor_topics, '_PROCESS', 7)
    second = {**SENSOR, 'frame_id': 'another_link'}
    elsewhere.add(SensorNode, 'left', parameters=second)
    line = f'several publish {TOPIC}: /bench/left/sensor_node, twice'
    name = 'recorder: recording'
    ros.spin_until(lambda: said[name].message == line, line)
    recorder.close()
    recording, health = recorded(recorder)
    assert (recording.frame_id, recording.notes[0].startswith(line)) == ('left_link', True)
    assert health.severity == 'severe'
    assert first.acquisition.stats.lost == 0


def test_a_visitor_who_was_there_first_is_not_taken_for_the_sensor(ros, elsewhere, said, tmp_path):
    publisher = elsewhere.add(Node, 'visitor').create_publisher(Imu, TOPIC, 100)
    recorder = ros.add(
        RecorderNode, parameters={'output': str(tmp_path / 'bag'), 'sensors': ['/bench/left']}
    )
    ros.spin_until(lambda: recorder.count_publishers(TOPIC), 'he is seen')
    for number in range(100):
        publisher.publish(wrong(number))
    ros.add(SensorNode, 'left', parameters=SENSOR)
    ros.spin_until(lambda: recorder.received[TOPIC] > 100, 'the sensor is recorded')
    key = f'several.{TOPIC}'
    ros.spin_until(lambda: key in values(said['recorder: recording']), 'that is said')
    before = recorder.received['/diagnostics']
    ros.spin_until(lambda: recorder.received['/diagnostics'] > before + 3, 'and recorded')
    recorder.close()
    recording, health = recorded(recorder)
    assert np.abs(recording.samples.acceleration).max() < 100.0
    assert 'several_publishers' in {finding.code for finding in health.findings}


def test_two_drivers_on_one_topic_are_named(ros, elsewhere, said, recorder):
    for host, name in ((ros, 'one'), (elsewhere, 'two')):
        host.add(Node, name).create_publisher(Imu, '/camera/imu/data_raw', 10)
    line = 'several publish /camera/imu/data_raw: /one, /two'
    ros.spin_until(lambda: 'recorder: recording' in said, 'the recorder')
    ros.spin_until(lambda: said['recorder: recording'].message == line, line)


def hears(said, line):
    """Return whether a recorder says this now, as an error."""
    status = said['recorder: recording']
    return (status.message, status.level) == (line, b'\x02')


def spin_both(ros, elsewhere, happened, what):
    """Spin two processes until something is true."""

    def turned():
        elsewhere.executor.spin_once(timeout_sec=0.0)
        return happened()

    ros.spin_until(turned, what)


def test_two_recorders_name_each_other_and_each_has_all(ros, elsewhere, said, recorder, tmp_path):
    ros.add(SensorNode, 'left', parameters=SENSOR)
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    second = elsewhere.add(RecorderNode, parameters={'output': str(tmp_path / 'second')})
    ros.spin_until(lambda: second.received[TOPIC] > 20, 'twice')
    line = 'several record this: /recorder, /recorder, another into '
    for other in (recorder, second):
        spin_both(ros, elsewhere, lambda path=str(other.path): hears(said, line + path), line)
    before = recorder.received['/diagnostics']
    ros.spin_until(lambda: recorder.received['/diagnostics'] > before + 3, 'and recorded')
    second.close()
    recorder.close()
    for each, other in ((recorder, second), (second, recorder)):
        recording, health = recorded(each)
        (finding,) = [found for found in health.findings if found.code == 'several_recorders']
        whole = f'the samples themselves are whole: {recording.delivery.published} of '
        assert finding.severity == 'severe'
        assert finding.text.replace('\u202f', '').startswith(f'{line}{other.path}; {whole}')
        assert recording.delivery.missing == 0


def test_another_programs_recorder_is_named_and_no_fault(ros, elsewhere, said, recorder):
    ros.add(SensorNode, 'left', parameters=SENSOR)
    elsewhere.add(Node, 'rosbag2_recorder').create_subscription(Imu, TOPIC, lambda _: None, 10)
    name, names = 'recorder: recording', '/recorder, /rosbag2_recorder'
    ros.spin_until(lambda: values(said[name]).get('recorders') == names, 'that is said')
    assert said[name].level == b'\x00'


def replay(ros, host, bag, name='rosbag2_player'):
    """Publish what is in a bag once more, on its topics, as `ros2 bag play` does."""
    node = host.add(Node, name)
    with Reader(bag) as reader:
        made = {
            each.topic: node.create_publisher(message_class(each.msgtype), each.topic, 1000)
            for each in reader.connections
        }
        messages = [(each.topic, bytes(data)) for each, _, data in reader.messages()]
    for topic, publisher in made.items():
        ros.spin_until(publisher.get_subscription_count, topic)
    for topic, data in messages:
        made[topic].publish(data)
        ros.executor.spin_once(timeout_sec=0.0)


def test_a_bag_that_is_played_onto_live_topics_is_kept_out(ros, elsewhere, said, tmp_path):
    first = ros.add(RecorderNode, parameters={'output': str(tmp_path / 'old')})
    sensor = ros.add(SensorNode, 'left', parameters=SENSOR)
    ros.spin_until(lambda: first.received[TOPIC] > 300, 'something to play')
    first.close()
    again = ros.add(
        RecorderNode, parameters={'output': str(tmp_path / 'new'), 'sensors': ['/bench/left']}
    )
    ros.add(AnalysisNode)
    ros.spin_until(lambda: again.received[TOPIC] > 20, 'the sensor is recorded')
    replay(ros, elsewhere, tmp_path / 'old')
    names = '/bench/left/sensor_node, /rosbag2_player'
    line = f'several publish {TOPIC}: {names}'
    for name in ('recorder: recording', 'left: others', 'left: analysis'):
        ros.spin_until(lambda name=name: said[name].message == line, name)
    key = f'foreign.{TOPIC}'
    ros.spin_until(lambda: key in values(said['recorder: recording']), 'it is counted')
    again.close()
    recording, health = recorded(again)
    assert sensor.acquisition.stats.lost == 0
    # no stamp of the old bag is in the new one
    with Reader(tmp_path / 'old') as reader:
        last = max(stamp for each, stamp, _ in reader.messages() if each.topic == TOPIC)
    assert recording.samples.stamps.min() > last - 1_000_000_000
    assert np.all(np.diff(recording.samples.stamps) > 0)
    assert recording.delivery.missing == 0
    assert 'several_publishers' in {finding.code for finding in health.findings}


def test_two_benches_on_one_domain_do_not_mix(ros, elsewhere, said, tmp_path):
    spaces = {'left': '/bench/left', 'right': '/bench/right'}
    benches = {
        name: host.add(
            RecorderNode, parameters={'output': str(tmp_path / name), 'sensors': [space]}
        )
        for host, (name, space) in zip((ros, elsewhere), spaces.items(), strict=True)
    }
    for host, name in zip((ros, elsewhere), spaces, strict=True):
        host.add(SensorNode, name, parameters=SENSOR)
    for name, recorder in benches.items():
        for space in spaces.values():
            topic = f'{space}/imu/data_raw'
            ros.spin_until(lambda r=recorder, t=topic: r.received[t] > 50, f'{name}: {topic}')
    for recorder in benches.values():
        line = f'several record this: /recorder, /recorder, another into {recorder.path}'
        spin_both(ros, elsewhere, lambda line=line: hears(said, line), line)
    for name, recorder in benches.items():
        recorder.close()
        with open_source(recorder.path) as source:
            found = {each.topic: each.foreign for each in load_all(source, source.select())}
        assert found == {f'{space}/imu/data_raw': other != name for other, space in spaces.items()}


def test_names_and_types_that_are_none_of_ros_end_nothing(ros, start_visitor, said, tmp_path):
    # one that no node may have; that of the diagnostics with another type; one as it should be
    names = '/1a/imu/data_raw', '/diagnostics', '/ok/imu/data_raw'
    visitor = start_visitor('publish', 'cyclone', *names)
    visitor.wait_for('up')
    made = {'output': str(tmp_path / 'bag'), 'sensors': ['/bench/left']}
    recorder = ros.add(RecorderNode, parameters=made)
    ros.add(AnalysisNode)
    ros.spin_until(lambda: names[2] in recorder._others.beside, 'what he publishes is seen')
    ros.add(SensorNode, 'left', parameters=SENSOR)
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    before = recorder.received['/diagnostics']
    ros.spin_until(lambda: recorder.received['/diagnostics'] > before + 3, 'and what is said')
    recorder.close()
    recording, _ = recorded(recorder)
    assert recording.delivery.missing == 0
    with Reader(recorder.path) as reader:
        assert names[0] not in reader.topics


@pytest.mark.parametrize('unknown', ['_NODE_NAME_UNKNOWN_', '_CREATED_BY_BARE_DDS_APP_'])
def test_a_program_without_a_node_is_named_in_words(unknown):
    endpoint = SimpleNamespace(node_name=unknown, node_namespace=unknown)
    assert full_name(endpoint) == 'a program that is no node of ROS 2'


def test_a_node_whose_name_would_steer_a_terminal_is_named_in_text():
    endpoint = SimpleNamespace(node_name='a\x1b]0;owned\x07', node_namespace='/')
    assert full_name(endpoint) == '/a\\x1b]0;owned\\x07'


def test_messages_that_came_in_turn_are_of_two():
    topic = Sequences(lambda: 2)
    topic.take([0, 1, 2])
    assert not topic.interleaved
    topic.take([0, 1])  # one that was started again
    assert not topic.interleaved
    topic.take([3])
    assert topic.interleaved
    far = Sequences(lambda: 2)
    far.take([0, 1, 2, 300, 3])  # 300 is of somebody not heard before
    assert far.interleaved


def test_what_the_sensor_sent_both_ways_is_no_visitors():
    apart = ForeignMessages()
    rows = np.arange(40, dtype=np.uint8).reshape(10, 4)
    singles = [row.tobytes() for row in rows]
    apart.heard(singles[:5], 0.0)  # before their block
    apart.own(rows, 0.05)
    apart.heard(singles[5:], 0.1)
    apart.heard([b'else', singles[0]], 0.1)  # a relay of the sensor's own is foreign, too
    apart.settle(5.0)
    assert apart.foreign == 2


def ask(ros, client_of, node, transition):
    client = client_of.create_client(ChangeState, f'/bench/left/{node}/change_state')
    request = ChangeState.Request(transition=Transition(id=transition))
    return ros.call(client, request).success


@pytest.mark.parametrize(
    ('transition', 'words'),
    [
        (Transition.TRANSITION_DEACTIVATE, 'stop it'),
        (Transition.TRANSITION_ACTIVE_SHUTDOWN, 'shut it down'),
    ],
)
def test_a_sensor_that_is_recorded_is_not_stopped(ros, said, recorder, transition, words):
    sensor = ros.add(SensorNode, 'left', parameters=SENSOR)
    stranger = ros.add(Node, 'stranger')
    ros.spin_until(lambda: recorder.received[TOPIC] > 20, 'the sensor is recorded')
    ask(ros, stranger, 'sensor_node', transition)
    before = recorder.received[TOPIC]
    ros.spin_until(lambda: recorder.received[TOPIC] > before + 100, 'it goes on')
    assert sensor.acquisition.stats.state == 'running'
    line = f'{words}: refused, recorded by /recorder'
    ros.spin_until(lambda: said['left: others'].message == line, line)
    ros.spin_until(lambda: recorder.received['/diagnostics'] > 3, 'that is recorded, too')
    recorder.close()
    recording, _ = recorded(recorder)
    (note,) = [note for note in recording.notes if 'asked' in note]
    assert note.startswith('somebody asked of the sensor: 20')
    assert note.endswith(line)


def test_a_sensor_that_nobody_records_is_stopped_and_that_is_written_down(ros, said):
    ros.add(SensorNode, 'left', parameters=SENSOR)
    stranger = ros.add(Node, 'stranger')
    assert ask(ros, stranger, 'sensor_node', Transition.TRANSITION_DEACTIVATE)
    state = stranger.create_client(GetState, '/bench/left/sensor_node/get_state')
    found = ros.call(state, GetState.Request()).current_state.id
    assert found == State.PRIMARY_STATE_INACTIVE
    ros.spin_until(lambda: said['left: others'].message == 'stop it: done', 'said')


@pytest.mark.parametrize('node', ['bench/left/sensor_node', 'recorder'])
def test_nobody_moves_the_clock_of_a_node(ros, recorder, node):
    ros.add(SensorNode, 'left', parameters=SENSOR)
    client = ros.add(Node, 'stranger').create_client(SetParameters, f'/{node}/set_parameters')
    value = ParameterValue(type=1, bool_value=True)
    request = SetParameters.Request(parameters=[Parameter(name='use_sim_time', value=value)])
    (result,) = ros.call(client, request).results
    assert not result.successful
    assert 'for the start of the node' in result.reason
