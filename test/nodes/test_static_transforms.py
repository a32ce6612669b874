# SPDX-License-Identifier: Apache-2.0
"""
Where a sensor is, on /tf_static.

tf2_msgs has no wheel.  Where it is not installed another type stands in for it: which bytes go
out, to whom and when is what is looked at.
"""

from importlib.util import find_spec
import sys
from types import ModuleType

from geometry_msgs.msg import TransformStamped
from imu_bench.nodes.discovery import message_class
from imu_bench.nodes.others import BESIDE_BYTES
from imu_bench.nodes.recorder import RecorderNode
from imu_bench.nodes.sensor import SensorNode
from msg_conversions.transforms import TF_STATIC, TF_TYPE
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.typesys import get_typestore, Stores

pytestmark = pytest.mark.ros

SENSOR = {
    'driver': 'generic', 'backend': 'emulated', 'rate_hz': 100.0,
    'simulation.acceleration.noise_density': '60 µg/√Hz',
}  # fmt: skip
PLACE = {'mounting.xyz': ['1 mm', '2 mm', '3 mm'], 'mounting.rpy': ['0 °', '0 °', '180 °']}
LATE = QoSProfile(
    depth=10,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    reliability=ReliabilityPolicy.RELIABLE,
)


@pytest.fixture
def tf2_msgs(monkeypatch):
    """Return the type of /tf_static, or what stands in for it."""
    if find_spec('tf2_msgs') is None:
        module = ModuleType('tf2_msgs.msg')
        module.TFMessage = TransformStamped
        monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', module)
    return message_class(TF_TYPE)


def test_who_comes_later_hears_where_both_sensors_are(ros, tf2_msgs):
    ros.add(SensorNode, 'left', parameters=SENSOR | PLACE)
    ros.add(SensorNode, 'right', parameters=SENSOR | PLACE | {'mounting.parent': 'left_link'})
    ros.add(SensorNode, 'loose', parameters=SENSOR)
    heard = []
    ros.add(Node, 'late').create_subscription(tf2_msgs, TF_STATIC, heard.append, LATE, raw=True)
    ros.spin_until(lambda: len(heard) == 2, 'both transforms')
    store = get_typestore(Stores.ROS2_JAZZY)
    found = [store.deserialize_cdr(blob, TF_TYPE).transforms for blob in heard]
    frames = {each.child_frame_id: each for (each,) in found}
    assert {name: each.header.frame_id for name, each in frames.items()} == {
        'left_link': 'base_link', 'right_link': 'left_link',
    }  # fmt: skip
    left = frames['left_link'].transform
    moved, turned = left.translation, left.rotation
    assert (moved.x, moved.y, moved.z) == pytest.approx((1e-3, 2e-3, 3e-3))
    assert (turned.x, turned.y, turned.z, turned.w) == pytest.approx((0, 0, 1, 0), abs=1e-12)
    assert frames['left_link'].header.stamp.sec > 1_700_000_000


def test_a_sensor_without_a_place_publishes_none(ros, tf2_msgs):
    node = ros.add(SensorNode, 'loose', parameters=SENSOR)
    assert node.count_publishers(TF_STATIC) == 0


def test_without_tf2_msgs_a_sensor_runs_and_says_so(ros, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)
    sensor = ros.add(SensorNode, 'left', parameters=SENSOR | PLACE)
    assert sensor.acquisition is not None
    assert 'no /tf_static: tf2_msgs is not installed here' in capfd.readouterr().err


@pytest.mark.parametrize('more', [{}, {'sensors': ['/bench/left']}, {'all_topics': True}])
def test_a_recorder_takes_it(ros, tmp_path, more):
    node = ros.add(RecorderNode, parameters={'output': str(tmp_path / 'bag')} | more)
    assert node._wants(TF_STATIC)
    assert node._types[TF_STATIC] == TF_TYPE


def test_a_recorder_of_chosen_topics_takes_those_alone(ros, tmp_path):
    topics = ['/bench/left/imu/data_raw']
    node = ros.add(RecorderNode, parameters={'output': str(tmp_path / 'b'), 'topics': topics})
    assert not node._wants(TF_STATIC)


def test_a_flood_of_places_does_not_fill_the_disk(ros, tf2_msgs, tmp_path):
    """Whoever is on the domain may publish there: beside a bench he has the room of others."""
    parameters = {'output': str(tmp_path / 'bag'), 'sensors': ['/bench/left']}
    node = ros.add(RecorderNode, parameters=parameters)
    node._follow(TF_STATIC, TF_TYPE, [])
    many = np.zeros((3000, 1000), np.uint8)
    for start in range(0, len(many), 300):
        node._store(TF_STATIC, np.arange(300), many[start : start + 300])
    assert node._others.beside[TF_STATIC] == len(many) - BESIDE_BYTES // many.shape[1]
