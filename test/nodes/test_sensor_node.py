# SPDX-License-Identifier: Apache-2.0
"""One sensor node in this process: topics, parameters, lifecycle, diagnostics."""

import math
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_bench import bench
from imu_bench.bus.clock import SystemClock
from imu_bench.config import SENSOR_SETTINGS, SensorConfig, SIMULATION_SETTINGS
from imu_bench.drivers import load
from imu_bench.errors import BenchError, BusBusy, ConfigError, PermissionDenied
from imu_bench.nodes.sensor import default_name, executable, SensorNode
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from msg_conversions import reading
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import Imu, MagneticField, Temperature

pytestmark = pytest.mark.ros

GENERIC = {
    'driver': 'generic',
    'backend': 'emulated',
    'rate_hz': 200.0,
    'simulation.seed': 3,
    'simulation.acceleration.noise_density': '60 µg/√Hz',
    'simulation.angular_velocity.noise_density': '0.01 °/s/√Hz',
}
MPU9250 = {'driver': 'mpu9250', 'backend': 'emulated', 'rate_hz': 500.0}


def listen(ros, message, topic):
    node = ros.add(Node, f'listener_{len(ros.nodes)}')
    received = []
    node.create_subscription(message, topic, received.append, 1000)
    return received


def diagnostics(ros, name):
    """Return a list that fills with the statuses of a sensor."""
    found = []

    def keep(array):
        found.extend(status for status in array.status if status.name.startswith(f'{name}:'))

    ros.add(Node, 'monitor').create_subscription(DiagnosticArray, '/diagnostics', keep, 10)
    return found


@pytest.mark.slow
def test_samples_arrive_as_imu_messages_in_their_order(ros):
    received = listen(ros, Imu, '/bench/left/imu/data_raw')
    ros.add(SensorNode, 'left', parameters=GENERIC | {'linear_acceleration_stddev': 0.01})
    ros.spin_until(lambda: len(received) >= 400, '400 messages')
    block = reading.imu(received)
    assert block.frame_ids == ('left_link',)
    assert np.all(np.diff(block.stamps) > 0)
    assert np.median(np.diff(block.stamps)) == pytest.approx(5e6, rel=0.01)
    assert block.acceleration.mean(axis=0) == pytest.approx([0.0, 0.0, 9.80665], abs=0.01)
    assert np.ptp(block.acceleration, axis=0).min() > 0.0
    # REP-145: stddev squared where given, zero for unknown, -1 for not reported
    message = received[0]
    assert message.linear_acceleration_covariance[[0, 4, 8]] == pytest.approx([1e-4] * 3)
    assert message.angular_velocity_covariance.tolist() == [0.0] * 9
    assert message.orientation_covariance[0] == -1.0
    assert message.orientation.w == 1.0


def test_an_accelerometer_of_one_axis_says_what_it_does_not_have(ros):
    received = listen(ros, Imu, '/bench/piezo/imu/data_raw')
    one_axis = {name: value for name, value in GENERIC.items() if 'angular' not in name}
    ros.add(SensorNode, 'piezo', parameters=one_axis | {'simulation.acceleration.axes': 'z'})
    ros.spin_until(lambda: received)
    assert received[0].angular_velocity_covariance[0] == -1.0
    assert math.isnan(received[0].linear_acceleration.x)
    assert not math.isnan(received[0].linear_acceleration.z)


def test_a_chip_on_its_emulated_bus_has_field_and_temperature_too(ros):
    field = listen(ros, MagneticField, '/bench/mpu9250/imu/mag')
    warm = listen(ros, Temperature, '/bench/mpu9250/temperature')
    imu = listen(ros, Imu, '/bench/mpu9250/imu/data_raw')
    parameters = MPU9250 | {'magnetic_field_stddev': 1e-6, 'frame_id': 'chip'}
    ros.add(SensorNode, 'mpu9250', parameters=parameters)
    ros.spin_until(lambda: field and warm and len(imu) > 100, 'all three topics')
    assert 10e-6 < np.linalg.norm(reading.magnetic_field(field).values[0]) < 500e-6
    assert field[0].magnetic_field_covariance[0] == pytest.approx(1e-12)
    assert -40.0 < warm[0].temperature < 85.0
    assert field[0].header.frame_id == warm[0].header.frame_id == 'chip'
    assert set(reading.temperature(warm).stamps[:3]) <= set(reading.imu(imu).stamps)


def test_publishers_keep_what_goes_out_at_once_after_a_recovery(ros):
    # over a second of samples, perhaps twice in a row: see test_aftermath
    node = ros.add(SensorNode, 'left', parameters=GENERIC | {'rate_hz': 200.0})
    publisher = next(p for p in node.publishers if p.topic.endswith('imu/data_raw'))
    depth = node.get_parameter(f'qos_overrides.{publisher.topic_name}.publisher.depth').value
    assert depth >= 2.5 * 200.0


def test_publishers_are_reliable_and_can_be_overridden(ros):
    topic = '/bench/left/imu/data_raw'
    override = {f'qos_overrides.{topic}.publisher.depth': 17}
    node = ros.add(SensorNode, 'left', parameters=GENERIC | override)
    endpoint = node.get_publishers_info_by_topic(topic)[0]
    assert endpoint.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert node.get_parameter(f'qos_overrides.{topic}.publisher.depth').value == 17
    assert next(p for p in node.publishers if p.topic == 'imu/data_raw').qos_profile.depth == 17


@pytest.mark.parametrize(
    ('policy', 'value'), [('reliability', 'perhaps'), ('depth', 'deep'), ('depth', -3)]
)
def test_an_impossible_override_is_refused(ros, policy, value):
    name = f'qos_overrides./bench/left/imu/data_raw.publisher.{policy}'
    with pytest.raises(ConfigError, match=r'qos_overrides\./bench/left/imu/data_raw') as caught:
        ros.add(SensorNode, 'left', parameters=GENERIC | {name: value})
    assert str(value) in str(caught.value)
    assert 'reliable or best_effort' in str(caught.value)


def test_every_parameter_is_described_and_limited(ros):
    node = ros.add(SensorNode, 'mpu9250', parameters=MPU9250 | {'autostart': False})
    client = ros.add(Node, 'client')
    path = f'/bench/mpu9250/{node.get_name()}'
    listed = ros.call(
        client.create_client(ListParameters, f'{path}/list_parameters'), ListParameters.Request()
    )
    names = listed.result.names
    assert {setting.name for setting in (*SENSOR_SETTINGS, *SIMULATION_SETTINGS)} <= set(names)
    described = ros.call(
        client.create_client(DescribeParameters, f'{path}/describe_parameters'),
        DescribeParameters.Request(names=names),
    )
    by_name = {each.name: each for each in described.descriptors}
    own = [each for each in described.descriptors if 'type_description' not in each.name]
    assert [
        each.name for each in own if not each.description and each.name != 'use_sim_time'
    ] == []
    stddev = by_name['linear_acceleration_stddev']
    assert stddev.read_only
    assert stddev.type == ParameterType.PARAMETER_DOUBLE
    assert '[m/s²]' in stddev.description
    assert stddev.floating_point_range[0].from_value == 0.0
    assert by_name['address'].integer_range[0].to_value == 0x77
    assert by_name['backend'].additional_constraints == 'hardware, emulated, recorded, iio'
    assert by_name['accelerometer_range'].additional_constraints == '2, 4, 8, 16 g'
    values = ros.call(
        client.create_client(GetParameters, f'{path}/get_parameters'),
        GetParameters.Request(names=['rate_hz', 'driver', 'accelerometer_range']),
    ).values
    assert (values[0].double_value, values[1].string_value) == (500.0, 'mpu9250')


def test_a_setting_cannot_be_changed_while_it_runs(ros):
    node = ros.add(SensorNode, 'left', parameters=GENERIC)
    client = ros.add(Node, 'client').create_client(
        SetParameters, f'/bench/left/{node.get_name()}/set_parameters'
    )
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=100.0)
    request = SetParameters.Request(parameters=[Parameter(name='rate_hz', value=value)])
    result = ros.call(client, request).results[0]
    assert not result.successful
    assert 'read-only' in result.reason


@pytest.mark.parametrize(('waits', 'largest'), [(True, 2 * 9.8), (False, 9.8)])
def test_a_scenario_begins_when_the_node_is_told_unless_it_has_begun(ros, waits, largest):
    begin = {'simulation.scenario': 'sine', 'simulation.begin': 1e10} if waits else {}
    received = listen(ros, Imu, '/bench/left/imu/data_raw')
    node = ros.add(SensorNode, 'left', parameters=GENERIC | begin)
    client = ros.add(Node, 'client').create_client(
        SetParameters, f'/bench/left/{node.get_name()}/set_parameters'
    )
    ros.spin_until(lambda: len(received) >= 50, 'samples at rest')
    assert max(message.linear_acceleration.z for message in received) < 10.0
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=time.time() + 0.5)
    request = SetParameters.Request(parameters=[Parameter(name='simulation.begin', value=value)])
    result = ros.call(client, request).results[0]
    assert result.successful == waits
    assert ('it began when it was switched on' in result.reason) != waits
    received.clear()
    ros.spin_until(lambda: len(received) >= 300, 'samples of 1.5 s')
    # 1 g at 10 Hz on top of gravity; of 20 samples a period one is within 1.3 % of the top
    found = max(message.linear_acceleration.z for message in received)
    assert found == pytest.approx(largest, abs=0.5)


@pytest.mark.parametrize(
    ('wrong', 'says'),
    [
        ({'rate_hz': 0.0}, 'parameters.rate_hz: 0 is not allowed; allowed: 0.1 to 50000 Hz'),
        ({'rate_hz': 100}, 'parameters.rate_hz: 100 is no number with a decimal point'),
        ({'rate_hz': 'fast'}, "parameters.rate_hz: 'fast' is not a finite number"),
        ({'rate_hx': 1.0}, "parameters.rate_hx: unknown; did you mean 'rate_hz'?"),
        ({'backend': 'real'}, 'parameters.backend: real is not allowed; allowed: hardware, emul'),
        ({'driver': 'mpu9255'}, "no driver 'mpu9255'; did you mean 'mpu9250'?"),
        ({'address': 300}, 'parameters.address: 300 is not allowed; allowed: -1 to 119'),
        ({'simulation.acceleration.noise_density': '60'}, 'simulation.acceleration.noise_density'),
        ({'backend': 'hardware'}, 'parameters.bus: missing'),
    ],
)
def test_a_wrong_parameter_is_refused_with_what_is_allowed(ros, wrong, says):
    with pytest.raises(ConfigError) as caught:
        ros.add(SensorNode, 'left', parameters=GENERIC | wrong)
    assert says in str(caught.value)


def test_all_wrong_parameters_are_named_at_once(ros):
    wrong = {'rate_hz': -1.0, 'address': 300, 'colour': 'red'}
    with pytest.raises(ConfigError) as caught:
        ros.add(SensorNode, 'left', parameters=GENERIC | wrong)
    assert all(f'parameters.{name}: ' in str(caught.value) for name in wrong)


def test_without_backend_nothing_is_emulated_by_accident(ros):
    with pytest.raises(ConfigError, match=r'backend: missing; allowed: hardware, emulated'):
        ros.add(SensorNode, 'left', parameters={'driver': 'generic', 'rate_hz': 10.0})


def test_a_bus_that_is_not_there_is_named(ros):
    parameters = {'driver': 'mpu9250', 'backend': 'hardware', 'bus': 'i2c-99'}
    with pytest.raises(BenchError, match='i2c-99'):
        ros.add(SensorNode, 'left', parameters=parameters)


def test_the_executable_picks_the_driver(ros, monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['/opt/lib/imu_bench/mpu9250_node'])
    node = ros.add(SensorNode, parameters={'backend': 'emulated', 'autostart': False})
    assert node.config.driver == 'mpu9250'
    assert node.get_fully_qualified_name() == '/bench/mpu9250/mpu9250_node'
    with pytest.raises(ConfigError, match='mpu9250_node runs mpu9250, use sensor_node'):
        ros.add(SensorNode, parameters=GENERIC)


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [
        (['lsm9ds1_node'], 'lsm9ds1'),
        (['/x/sensor_node.py', '--ros-args', '--params-file', '/y/bno055.yaml'], 'bno055'),
        (['sensor_node', '--ros-args', '--params-file', '9 axes.yaml'], '_9_axes'),
        (['sensor_node', '--params-file'], 'sensor'),
        (['pytest'], 'sensor'),
    ],
)
def test_a_sensor_without_namespace_gets_a_name(monkeypatch, arguments, name):
    monkeypatch.setattr(sys, 'argv', arguments)
    assert default_name(arguments) == name


def test_other_programs_are_no_executable_of_a_sensor(monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['/usr/bin/pytest'])
    assert executable() == ''


class Lifecycle:
    """The services of a lifecycle node."""

    def __init__(self, ros, path):
        client = ros.add(Node, 'manager')
        self._ros = ros
        self._change = client.create_client(ChangeState, f'{path}/change_state')
        self._get = client.create_client(GetState, f'{path}/get_state')

    @property
    def state(self):
        return self._ros.call(self._get, GetState.Request()).current_state.id

    def change(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return self._ros.call(self._change, request).success


def test_without_autostart_it_waits_to_be_managed(ros):
    received = listen(ros, Imu, '/bench/left/imu/data_raw')
    node = ros.add(SensorNode, 'left', parameters=GENERIC | {'autostart': False})
    node_state = Lifecycle(ros, f'/bench/left/{node.get_name()}')
    assert node_state.state == State.PRIMARY_STATE_UNCONFIGURED
    assert node.acquisition is None
    assert node_state.change(Transition.TRANSITION_CONFIGURE)
    assert node_state.state == State.PRIMARY_STATE_INACTIVE
    assert node.acquisition.stats.state == 'stopped'
    assert node_state.change(Transition.TRANSITION_ACTIVATE)
    assert node_state.state == State.PRIMARY_STATE_ACTIVE
    ros.spin_until(lambda: received, 'samples of an active sensor')
    assert node_state.change(Transition.TRANSITION_DEACTIVATE)
    assert node.acquisition.stats.state == 'stopped'
    samples = node.acquisition.stats.samples
    ros.spin_until(lambda: len(received) == samples, 'every sample read was published')
    assert node_state.change(Transition.TRANSITION_ACTIVATE)
    ros.spin_until(lambda: len(received) > samples, 'samples after a restart')
    assert node_state.change(Transition.TRANSITION_DEACTIVATE)
    assert node_state.change(Transition.TRANSITION_CLEANUP)
    assert node_state.state == State.PRIMARY_STATE_UNCONFIGURED
    assert node.acquisition is None
    assert node_state.change(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert node_state.state == State.PRIMARY_STATE_FINALIZED


def test_a_sensor_that_is_not_there_stays_unconfigured(ros):
    parameters = {
        'driver': 'mpu9250', 'backend': 'hardware', 'bus': 'i2c-99', 'autostart': False,
    }  # fmt: skip
    node = ros.add(SensorNode, 'left', parameters=parameters)
    node_state = Lifecycle(ros, f'/bench/left/{node.get_name()}')
    assert not node_state.change(Transition.TRANSITION_CONFIGURE)
    assert node_state.state == State.PRIMARY_STATE_UNCONFIGURED


def test_diagnostics_tell_rate_losses_and_that_it_is_emulated(ros):
    statuses = diagnostics(ros, 'left')
    ros.add(SensorNode, 'left', parameters=GENERIC)

    def measured():
        return [
            status
            for status in statuses
            if any(pair.key == 'rate_hz.low' for pair in status.values)
        ]

    status = ros.spin_until(measured, 'a measured rate')[0]
    values = {pair.key: pair.value for pair in status.values}
    assert status.level == DiagnosticStatus.OK, status.message
    assert status.hardware_id == 'emulated generic as left'
    assert (
        float(values['rate_hz.low']) <= float(values['rate_hz']) <= float(values['rate_hz.high'])
    )
    assert float(values['nominal_hz']) == 200.0
    assert int(values['samples']) > 0
    assert values['lost'] == values['bus_errors'] == values['counter.fifo_overflows'] == '0'
    assert {'jitter_s', 'rate_error_ppm', 'recoveries', 'state', 'backend'} <= values.keys()
    assert int(values['published.imu/data_raw']) > 0


def test_an_unconfigured_sensor_is_stale(ros):
    statuses = diagnostics(ros, 'left')
    ros.add(SensorNode, 'left', parameters=GENERIC | {'autostart': False})
    status = ros.spin_until(lambda: statuses)[0]
    assert status.level == DiagnosticStatus.STALE
    assert status.message == 'not configured'


@pytest.mark.parametrize('kind', [PermissionDenied, BusBusy])
def test_what_others_have_to_put_right_is_waited_for(ros, monkeypatch, kind):
    statuses = diagnostics(ros, 'left')
    closed = True

    def hardware(device, *_, **__):
        if closed:
            raise kind(f'/dev/{device}: not for you')
        clock = SystemClock()
        buses = bench.emulated_buses(SensorConfig('left', 'mpu9250', 'emulated'), clock)
        clock.sleep(load('mpu9250').start_up_s)
        return buses

    monkeypatch.setattr(bench, 'open_bus', hardware)
    received = listen(ros, Imu, '/bench/left/imu/data_raw')
    parameters = {'driver': 'mpu9250', 'backend': 'hardware', 'bus': 'i2c-1'}
    ros.add(SensorNode, 'left', parameters=parameters)

    def tried_again():
        values = {pair.key: pair.value for s in statuses for pair in s.values}
        return int(values.get(f'refused.{kind.__name__}', '0')) >= 2

    ros.spin_until(tried_again, 'a second attempt')
    assert statuses[-1].level == DiagnosticStatus.ERROR
    assert statuses[-1].message == '/dev/i2c-1: not for you'
    assert not received
    closed = False
    ros.spin_until(lambda: len(received) >= 100, 'samples')
    statuses.clear()
    ros.spin_until(lambda: statuses, 'diagnostics')
    assert statuses[-1].message != '/dev/i2c-1: not for you'


def test_the_last_samples_are_published_when_it_closes(ros):
    received = listen(ros, Imu, '/bench/left/imu/data_raw')
    node = ros.add(SensorNode, 'left', parameters=GENERIC)
    ros.spin_until(lambda: received)
    acquisition = node.acquisition
    node.close()
    assert acquisition.stats.state == 'stopped'
    samples = acquisition.stats.samples
    ros.spin_until(lambda: len(received) == samples, 'every sample read was published')
    node.close()
