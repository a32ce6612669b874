# SPDX-License-Identifier: Apache-2.0
"""What our nodes publish, decoded by an independent DDS implementation."""

import json
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

from imu_bench.nodes.analysis import AnalysisNode
from imu_bench.nodes.sensor import SensorNode
from msg_conversions import reading
import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu

pytestmark = pytest.mark.ros

SENSOR = {
    'driver': 'generic',
    'backend': 'emulated',
    'rate_hz': 200.0,
    'simulation.acceleration.noise_density': '60 µg/√Hz',
    'simulation.angular_velocity.noise_density': '0.01 °/s/√Hz',
}


class ForeignClient:
    """The client in a process of its own: two DDS libraries do not share one."""

    def __init__(self, folder, kind, topic, count):
        script = Path(__file__).with_name('foreign_client.py')
        self._output = folder / f'{kind}.jsonl'
        with self._output.open('wb') as output:
            self._process = subprocess.Popen(
                [sys.executable, str(script), kind, topic, str(count)], stdout=output
            )

    @property
    def done(self):
        return self._process.poll() is not None

    def messages(self):
        assert self._process.returncode == 0, 'the foreign client did not get its messages'
        lines = self._output.read_text().splitlines()
        return [json.loads(line, object_hook=plain) for line in lines]


def plain(fields):
    return SimpleNamespace(**fields)


def test_imu_messages_are_decoded_alike(ros, tmp_path):
    ours = []
    ros.add(Node, 'listener').create_subscription(
        Imu, '/bench/left/imu/data_raw', ours.append, 5000
    )
    foreign = ForeignClient(tmp_path, 'Imu', '/bench/left/imu/data_raw', 100)
    ros.add(SensorNode, 'left', parameters=SENSOR | {'linear_acceleration_stddev': 0.125})
    ros.spin_until(lambda: foreign.done, 'the foreign client has 100 messages')
    theirs = reading.imu(foreign.messages())
    last = theirs.stamps[-1]
    ros.spin_until(lambda: ours and reading.stamp_ns(ours[-1]) >= last)
    known = reading.imu(ours)
    found = np.isin(known.stamps, theirs.stamps)
    assert found.sum() == 100
    assert np.all(np.diff(theirs.stamps) > 0)
    assert np.array_equal(known.acceleration[found], theirs.acceleration)
    assert np.array_equal(known.angular_velocity[found], theirs.angular_velocity)
    assert theirs.acceleration_covariance.tolist() == [0.125**2] * 100
    assert theirs.frame_ids == ('left_link',)


@pytest.mark.slow
def test_metrics_are_decoded(ros, tmp_path):
    allan = ForeignClient(tmp_path, 'Float64MultiArray', '/bench/left/imu/allan_deviation', 2)
    rms = ForeignClient(tmp_path, 'Vector3Stamped', '/bench/left/imu/rms/angular_velocity', 2)
    ros.add(AnalysisNode, parameters={'publish_rate_hz': 2.0})
    ros.add(SensorNode, 'left', parameters=SENSOR)
    ros.spin_until(lambda: allan.done and rms.done, 'the foreign clients have their messages')
    first, second = (reading.allan_from_message(message) for message in allan.messages())
    assert first.start_ns <= second.start_ns
    assert first.end_ns < second.end_ns
    assert len(second.curves) == 6
    curve = second.curves['angular_velocity.x']
    assert np.all(curve['low'] < curve['deviation'])
    assert np.all(curve['deviation'] < curve['high'])
    vectors = reading.vector3(rms.messages())
    # white noise of 0.01 °/s/√Hz one-sided at 200 Hz: 0.01 √100 °/s
    assert vectors.values[-1] == pytest.approx(np.full(3, np.radians(0.1)), rel=0.2)
