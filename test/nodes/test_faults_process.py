# SPDX-License-Identifier: Apache-2.0
"""A scripted fault through the installed executable: seen on /diagnostics, outlived, counted."""

import os
import shutil
import subprocess
import sys

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu

pytestmark = pytest.mark.ros

EXECUTABLE = 'mpu9250_node'
RATE_HZ = 100.0
SETTINGS = ('backend:=emulated', f'rate_hz:={RATE_HZ}', 'accelerometer_bandwidth:=44.8')


class Listener(Node):
    """Remembers what a sensor says and measures."""

    def __init__(self, **options):
        super().__init__('listener', **options)
        self.said, self.faults, self.stamps = [], [], []
        self.create_subscription(DiagnosticArray, '/diagnostics', self.diagnostics, 50)
        self.create_subscription(Imu, '/bench/shaky/imu/data_raw', self.imu, QoSProfile(depth=999))

    def diagnostics(self, message):
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if status.name.endswith('shaky: acquisition'):
                self.said.append((status.level[0], status.message, values))
            elif status.name.endswith('shaky: faults'):
                self.faults.append((status.level[0], status.message, values))

    def imu(self, message):
        stamp = message.header.stamp
        self.stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec)


@pytest.fixture
def node():
    """Start the executable with a script of faults; end it."""
    installed = [
        f'{each}/lib/imu_bench' for each in os.environ.get('AMENT_PREFIX_PATH', '').split(':')
    ]
    installed.append(os.path.dirname(sys.executable))
    executable = shutil.which(EXECUTABLE, path=os.pathsep.join(installed))
    if executable is None and not os.environ.get('CI'):
        pytest.skip(f'{EXECUTABLE} is not installed')
    running = []

    def start(*faults):
        flags = [f'simulation.faults:={list(faults)}', *SETTINGS]
        command = [executable, '--ros-args', '-r', '__ns:=/bench/shaky']
        command += [part for flag in flags for part in ('-p', flag)]
        running.append(
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        )
        return running[-1]

    yield start
    for process in running:
        with process:
            process.terminate()


def test_an_unplugged_chip_is_named_comes_back_and_what_is_lost_is_counted(ros, node):
    listener = ros.add(Listener)
    process = node('unplugged 3 1')
    ros.spin_until(
        lambda: listener.faults and listener.faults[-1][2]['0.state'] == 'recovered', 'recovery'
    )
    seen = len(listener.stamps)
    ros.spin_until(lambda: len(listener.stamps) > seen + RATE_HZ, 'samples after it')
    ros.spin_until(lambda: listener.said[-1][0] == 0, 'a report that all is well')

    # it is said while it lasts, by name and with what to do
    named = [message for level, message, _ in listener.said if level == 2]
    assert any('nothing answers; check power, wiring and address' in text for text in named)
    assert any('recovering: ' in text for text in named)
    values = listener.said[-1][2]
    assert int(values['error.NoAnswer']) >= 3
    assert int(values['recoveries']) == 1
    assert int(values['bus_errors']) >= 3

    # the fault's own report
    assert any('emulated fault unplugged for 1 s' in text for _, text, _ in listener.faults)
    level, text, fault = listener.faults[-1]
    assert level == 0
    assert 'emulated fault unplugged: recovered after ' in text
    assert fault['0.error'].startswith('NoAnswer: emulated mpu9250 on i2c')

    # as many samples are missing as are said to be
    gaps = np.diff(np.array(listener.stamps)) * 1e-9 * float(values['rate_hz'])
    assert gaps.max() > RATE_HZ
    assert np.rint(gaps - 1).sum() == pytest.approx(int(values['lost']), abs=1)
    assert int(fault['0.lost']) == int(values['lost'])

    process.terminate()
    output, _ = process.communicate()
    assert process.returncode == 0, output
    assert 'faults are scripted: 1' in output
    assert 'emulated fault unplugged: recovered after' in output
    assert 'Traceback' not in output


@pytest.mark.parametrize(
    ('fault', 'says'),
    [
        ('unplugd 1 2', "did you mean 'unplugged'? allowed: no_answer, unplugged, stuck"),
        ('unplugged 1', 'needs a start and a duration'),
        ('half_frame 1', 'half_frame cannot happen to a mpu9250 on i2c; allowed: no_answer'),
    ],
)
def test_a_script_that_makes_no_sense_ends_it_with_one_clear_line(node, fault, says):
    process = node(fault)
    output, _ = process.communicate()
    assert process.returncode == 1
    assert says in output
    assert 'simulation.faults: ' in output
    assert 'Traceback' not in output
