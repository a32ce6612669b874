# SPDX-License-Identifier: Apache-2.0
"""Every node with the backend hardware, on device files of umockdev: its log and its samples."""

import signal
import time

from imu_bench.drivers import load
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu

pytestmark = [pytest.mark.slow, pytest.mark.ros]

PATIENCE_S = 300.0


@pytest.fixture(scope='module')
def listen():
    """Give a function that returns so many messages of a topic, fewer if it takes too long."""
    context = Context()
    context.init(args=[])
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def listen_to(topic, count):
        heard = []
        subscription = node.create_subscription(Imu, topic, heard.append, qos_profile_sensor_data)
        deadline = time.monotonic() + PATIENCE_S
        while len(heard) < count and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        node.destroy_subscription(subscription)
        return heard

    yield listen_to
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def test_the_node_runs_on_hardware(desk, listen, place):
    driver, device = place
    space = f'/desk/{driver}_{device[:3]}'
    process = desk.start(
        '-m', 'imu_bench.nodes.sensor_node', '--ros-args', '-r', f'__ns:={space}',
        '-p', f'driver:={driver}', '-p', 'backend:=hardware', '-p', f'bus:={device}',
    )  # fmt: skip
    try:
        said = process.stdout.readline()
        heard = listen(f'{space}/imu/data_raw', 20) if 'INFO' in said else []
    finally:
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate()
    assert f'hardware {driver} {device}' in said, said + rest
    assert load(driver).title.split()[-1] in said
    assert (process.returncode, rest) == (0, '')
    assert len(heard) >= 20
    vertical = [message.linear_acceleration.z for message in heard]
    gravity = 0.0 if load(driver).typical['acceleration'].high_pass else 9.8
    assert sum(vertical) / len(vertical) == pytest.approx(gravity, abs=1.5)
