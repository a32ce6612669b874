# SPDX-License-Identifier: Apache-2.0
"""The analysis node: what it finds, what it publishes, what it says of itself."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped
from imu_bench.errors import ConfigError
from imu_bench.metrology.coefficients import noise_density
from imu_bench.metrology.noise_fit import fitted
from imu_bench.nodes import qos
from imu_bench.nodes.analysis import AnalysisNode, SETTINGS
from imu_bench.nodes.sensor import SensorNode
from imu_bench.offline.analysis.recording import analyse, Settings
from imu_bench.offline.recordings import Recording
from imu_bench.samples import Samples
from msg_conversions import blocks, cdr, covariance, reading
from msg_conversions.encoding import ImuTemplate
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import Imu, MagneticField
from std_msgs.msg import Float64MultiArray, UInt8MultiArray
from std_srvs.srv import Trigger

pytestmark = pytest.mark.ros

T0 = 1_790_000_000_000_000_000
RATE_HZ = 100.0
METRICS = ('rms', 'noise_density', 'bias_instability')
QUANTITIES = ('linear_acceleration', 'angular_velocity')


def noise(n, seed=1, rate_hz=RATE_HZ, missing=()):
    """Return samples with white noise, drift, jittering stamps, and some missing."""
    rng = np.random.default_rng(seed)
    stamps = T0 + np.rint((np.arange(n) + rng.uniform(-0.02, 0.02, n)) * 1e9 / rate_hz)
    walk = 2e-3 * np.cumsum(rng.normal(size=(n, 3)), axis=0)
    kept = np.setdiff1d(np.arange(n), missing)
    return Samples(
        stamps=stamps.astype(np.int64)[kept],
        acceleration=(rng.normal(0.0, 0.02, (n, 3)) + walk + [0.0, 0.0, 9.8])[kept],
        angular_velocity=rng.normal(0.0, 0.001, (n, 3))[kept],
    )


class Sensor:
    """A publisher of samples that exist already."""

    def __init__(self, ros, name='left', suffix='imu/data_raw', message=Imu, topic=''):
        self._ros = ros
        self.topic = topic or f'/bench/{name}/{suffix}'
        self.publisher_node = f'publisher_{len(ros.nodes)}'
        node = ros.add(Node, self.publisher_node)
        self.publisher = node.create_publisher(
            message, self.topic, qos.keep_last(100_000, 'reliable')
        )

    def wait(self):
        """Wait for somebody who listens."""
        self._ros.spin_until(self.publisher.get_subscription_count, f'a subscriber {self.topic}')
        return self

    def publish(self, samples, frame_id='left_link'):
        """Publish samples at once, reporting the quantities they carry."""
        present = {
            'acceleration_covariance': samples.acceleration,
            'angular_velocity_covariance': samples.angular_velocity,
        }
        unknown = {k: covariance.UNKNOWN for k, v in present.items() if v is not None}
        template = ImuTemplate(frame_id, **unknown)
        for blob in template.encode_imu(
            samples.stamps, samples.acceleration, samples.angular_velocity
        ):
            self.publisher.publish(blob)


class Listener:
    """Everything the analysis node says of one sensor."""

    def __init__(self, ros, name='left', base=''):
        self.node = ros.add(Node, f'listener_{len(ros.nodes)}')
        self.allan = []
        self.vectors = {(m, q): [] for m in METRICS for q in QUANTITIES}
        self.status = []
        self.load = []
        base = base or f'/bench/{name}/imu'
        self.node.create_subscription(
            Float64MultiArray, f'{base}/allan_deviation', self.allan.append, 100
        )
        for (metric, quantity), received in self.vectors.items():
            self.node.create_subscription(
                Vector3Stamped, f'{base}/{metric}/{quantity}', received.append, 100
            )
        self._name = name
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._keep, 100)

    def _keep(self, array):
        self.status += [s for s in array.status if s.name == f'{self._name}: analysis']
        self.load += [s for s in array.status if s.name == 'analysis_node: load']

    def of_window(self, end_ns):
        """Return curves and vectors of the window that ends at a stamp, or nothing yet."""
        curves = [reading.allan_from_message(message) for message in self.allan]
        curves = [each for each in curves if each.end_ns == end_ns]
        vectors = {
            key: [m for m in received if reading.stamp_ns(m) == end_ns]
            for key, received in self.vectors.items()
        }
        if not curves or not all(vectors.values()):
            return None
        return curves[-1], {
            key: (m[-1].vector.x, m[-1].vector.y, m[-1].vector.z) for key, m in vectors.items()
        }


def values_of(status):
    return {pair.key: pair.value for pair in status.values}


def assert_equal_to_offline(samples, curves, vectors):
    """Compare what was published with what the offline tool says of the same window."""
    recording = Recording(
        source='test', topic='/bench/left/imu/data_raw', samples=samples, receive_ns=None,
        frame_id='left_link', announced=None, stored=len(samples), left_out=0, notes=(),
        stamp_source='header', stamp_reason='',
    )  # fmt: skip
    window = (curves.start_ns, curves.end_ns)
    offline = analyse(recording, Settings(window_ns=window))
    assert set(curves.curves) == set(offline.axes)
    for name, axis in offline.axes.items():
        live = curves.curves[name]
        for field in ('tau', 'deviation', 'low', 'high', 'edf', 'terms', 'alpha'):
            np.testing.assert_allclose(
                live[field], getattr(axis.allan, field), rtol=1e-9, err_msg=f'{name} {field}'
            )
        quantity, _, letter = name.partition('.')
        model = fitted(axis.allan, axis.noise_density.confidence, 'NB')
        estimates = {
            'rms': axis.statistics['rms'],
            'noise_density': noise_density(model, 'one'),
            'bias_instability': model.B,
        }
        for metric, estimate in estimates.items():
            published = vectors[metric, quantity]['xyz'.index(letter)]
            if estimate.value is None:
                assert np.isnan(published), (name, metric)
            else:
                assert published == pytest.approx(estimate.value, rel=1e-9), (name, metric)
        # the likelihood of the samples, asked offline alone, may overrule the fit, and says so
        overruled = any('not from the fit' in flag for flag in axis.model.flags)
        fit = estimates['noise_density'].value
        assert overruled or axis.noise_density.value == pytest.approx(fit, rel=1e-9), name


@pytest.mark.slow
@pytest.mark.parametrize('missing', [(), range(2000, 2037)])
def test_metrics_equal_the_offline_tool_on_the_same_window(ros, missing):
    samples = noise(3000, missing=list(missing))
    listener = Listener(ros)
    sensor = Sensor(ros)
    ros.add(
        AnalysisNode,
        parameters={'window_s': 15.0, 'publish_rate_hz': 5.0},
    )
    sensor.wait().publish(samples)
    end = int(samples.stamps[-1])
    curves, vectors = ros.spin_until(lambda: listener.of_window(end), 'the last window')
    span_s = (curves.end_ns - curves.start_ns) * 1e-9
    assert span_s == pytest.approx(15.0, abs=0.05)
    assert len(curves.curves) == 6
    assert_equal_to_offline(samples, curves, vectors)
    assert not np.isnan(vectors['noise_density', 'linear_acceleration']).any()


@pytest.mark.slow
def test_every_window_of_a_running_sensor_equals_the_offline_tool(ros):
    listener = Listener(ros)
    # of a node that nobody spins
    witness = Node('witness', context=ros.context)
    ros.nodes.append(witness)
    kept = witness.create_subscription(
        Imu, '/bench/left/imu/data_raw', print, qos.keep_last(qos.MOST, 'reliable'), raw=True
    )
    ros.add(AnalysisNode, parameters={'window_s': 3.0, 'publish_rate_hz': 5.0})
    parameters = {
        'driver': 'generic',
        'backend': 'emulated',
        'rate_hz': 200.0,
        'simulation.acceleration.noise_density': '60 µg/√Hz',
        'simulation.angular_velocity.noise_density': '0.01 °/s/√Hz',
    }
    ros.add(SensorNode, 'left', parameters=parameters)
    messages = []

    def take(happened):  # as it comes: the middleware holds a limited number
        with kept.handle:
            taken = iter(lambda: kept.handle.take_message(Imu, True), None)
            messages.extend(data for data, _ in taken)
        return happened()

    ros.spin_until(lambda: take(lambda: len(listener.allan) >= 8), 'eight windows')
    ends = [reading.allan_from_message(message).end_ns for message in listener.allan[:8]]
    ros.spin_until(
        lambda: take(lambda: listener.of_window(ends[-1])), 'all topics of the last window'
    )
    block = cdr.decode_imu(messages)
    assert block.stamps[-1] >= max(ends)
    samples = Samples(block.stamps, block.acceleration, block.angular_velocity)
    for end in sorted(set(ends)):
        assert_equal_to_offline(samples, *listener.of_window(end))


def test_axes_and_quantities_that_are_not_there(ros):
    samples = noise(600)
    one_axis = samples.acceleration.copy()
    one_axis[:, :2] = np.nan
    listener = Listener(ros)
    sensor = Sensor(ros)
    node = ros.add(AnalysisNode, parameters={'publish_rate_hz': 5.0})
    sensor.wait().publish(Samples(samples.stamps, acceleration=one_axis))
    received = listener.vectors['rms', 'linear_acceleration']
    ros.spin_until(lambda: received)
    assert np.isnan([received[-1].vector.x, received[-1].vector.y]).all()
    assert received[-1].vector.z > 0.0
    assert received[-1].header.frame_id == 'left_link'
    names = dict(node.get_topic_names_and_types())
    assert '/bench/left/imu/rms/linear_acceleration' in names
    assert node.count_publishers('/bench/left/imu/rms/angular_velocity') == 0
    ros.spin_until(lambda: listener.allan)
    curves = reading.allan_from_message(listener.allan[-1])
    assert set(curves.curves) == {'linear_acceleration.z'}


def test_what_cannot_be_observed_is_nan_with_the_reason_in_diagnostics(ros):
    listener = Listener(ros)
    sensor = Sensor(ros)
    ros.add(AnalysisNode, parameters={'publish_rate_hz': 5.0})
    sensor.wait().publish(noise(500))
    ros.spin_until(lambda: listener.vectors['bias_instability', 'angular_velocity'])
    assert np.isnan(listener.vectors['bias_instability', 'angular_velocity'][-1].vector.x)
    key = 'bias_instability.angular_velocity.x'
    status = ros.spin_until(lambda: [s for s in listener.status if key in values_of(s)])[0]
    assert values_of(status)[key].startswith('not observable: ')


def test_broken_messages_and_numbers_are_counted_and_left_out(ros):
    samples = noise(600)
    holes = samples.acceleration.copy()
    holes[[300, 301], 1] = np.nan
    holes[400, 2] = np.inf
    listener = Listener(ros)
    sensor = Sensor(ros)
    node = ros.add(AnalysisNode, parameters={'publish_rate_hz': 5.0})
    sensor.wait()
    sensor.publisher.publish(b'\x00\x01\x00\x00 this is no Imu')
    sensor.publish(Samples(samples.stamps, holes, samples.angular_velocity))
    end = int(samples.stamps[-1])
    ros.spin_until(lambda: listener.of_window(end))
    status = ros.spin_until(
        lambda: [s for s in listener.status if values_of(s).get('not_finite') == '3']
    )[0]
    values = values_of(status)
    assert values['malformed'] == '1'
    assert status.level == DiagnosticStatus.WARN
    status = ros.spin_until(
        lambda: [s for s in listener.status if values_of(s).get('window_samples') == '597']
    )[0]
    values = values_of(status)
    assert (values['window_missing'], values['received']) == ('3', '600')
    assert node.watches[sensor.topic].result.window.samples == 597


def test_it_finds_imu_topics_by_name_and_type(ros):
    wanted = [Sensor(ros, name) for name in ('left', 'right')]
    Sensor(ros, 'left', 'imu/data')
    Sensor(ros, 'other', 'imu/data_raw', MagneticField)
    node = ros.add(AnalysisNode)
    for sensor in wanted:
        sensor.wait()
    assert sorted(node.watches) == ['/bench/left/imu/data_raw', '/bench/right/imu/data_raw']
    late = Sensor(ros, 'late').wait()
    assert late.topic in node.watches


def test_it_takes_a_list_and_no_more(ros):
    listed = Sensor(ros, 'left', 'imu/data')
    Sensor(ros, 'right')
    parameters = {'topics': [listed.topic], 'publish_rate_hz': 5.0}
    listener = Listener(ros, base=listed.topic)
    node = ros.add(AnalysisNode, parameters=parameters)
    listed.wait().publish(noise(500))
    ros.spin_until(lambda: listener.load)
    assert list(node.watches) == [listed.topic]
    ros.spin_until(lambda: listener.allan, 'metrics below the topic')


def test_foreign_topics_are_found_by_type_and_have_metrics_of_their_own(ros):
    topics = ['/imu0', '/imu1', '/robot/imu/data_raw', '/other/imu/data']
    sensors = [Sensor(ros, topic=topic) for topic in topics]
    Sensor(ros, topic='/robot/imu/data')
    bases = ['/imu0', '/imu1', '/robot/imu', '/other/imu/data']
    listeners = [Listener(ros, topic, base) for topic, base in zip(topics, bases, strict=True)]
    node = ros.add(AnalysisNode, parameters={'publish_rate_hz': 5.0})
    for scale, sensor in enumerate(sensors, 1):
        samples = noise(600, seed=scale)
        sensor.wait().publish(
            Samples(samples.stamps, angular_velocity=scale * samples.angular_velocity)
        )
    for scale, listener in enumerate(listeners, 1):
        received = listener.vectors['rms', 'angular_velocity']
        ros.spin_until(lambda received=received: received)
        assert received[-1].vector.x == pytest.approx(scale * 0.001, rel=0.1)
        ros.spin_until(lambda listener=listener: listener.status, 'diagnostics of its own')
    assert sorted(node.watches) == sorted(topics)


def test_topics_can_be_restricted_by_patterns(ros):
    wanted = Sensor(ros, topic='/robot/left/imu')
    Sensor(ros, topic='/robot/right/imu')
    Sensor(ros, 'left')
    node = ros.add(AnalysisNode, parameters={'topics': ['/robot/l*']})
    wanted.wait()
    listener = Listener(ros)
    ros.spin_until(lambda: listener.load)
    assert list(node.watches) == [wanted.topic]


def test_what_falls_silent_is_not_published_any_more_and_a_reset_empties_the_window(ros):
    listener, sensor = Listener(ros), Sensor(ros)
    node = ros.add(AnalysisNode, parameters={'publish_rate_hz': 5.0})
    samples = noise(1000)
    sensor.wait().publish(samples[:700])
    ros.spin_until(lambda: listener.of_window(int(samples.stamps[699])))
    listener.status.clear()
    ros.spin_until(lambda: [s for s in listener.status if s.level == DiagnosticStatus.STALE])
    ends = [reading.allan_from_message(message).end_ns for message in listener.allan]
    assert ends.count(int(samples.stamps[699])) == 1
    client = ros.add(Node, 'asks').create_client(Trigger, '/analysis_node/reset')
    answer = ros.call(client, Trigger.Request())
    assert (answer.success, answer.message) == (True, '1 windows begin anew')
    ros.spin_until(lambda: node.watches[sensor.topic].result is None)
    sensor.publish(samples[700:])
    curves, _ = ros.spin_until(lambda: listener.of_window(int(samples.stamps[999])))
    assert curves.start_ns == samples.stamps[700]


@pytest.mark.parametrize(
    ('wrong', 'says'),
    [
        (lambda stamps: 0 * stamps, '600 stamps of zero'),
        (lambda stamps: stamps + 3_600_000_000_000 * (np.arange(600) > 400), '1 jumps'),
        (lambda stamps: stamps - 3_600_000_000_000 * (np.arange(600) > 400), '1 jumps'),
    ],
)
def test_stamps_that_are_not_set_or_jump_are_told(ros, wrong, says):
    listener, sensor = Listener(ros), Sensor(ros)
    ros.add(AnalysisNode)
    samples = noise(600)
    sensor.wait().publish(
        Samples(wrong(samples.stamps), samples.acceleration, samples.angular_velocity)
    )
    status = ros.spin_until(
        lambda: [s for s in listener.status if says in s.message], 'a word about the stamps'
    )[0]
    assert status.level == DiagnosticStatus.WARN


def test_subscriptions_ask_for_all_there_is_unless_told_otherwise(ros):
    sensors = [Sensor(ros, name) for name in ('left', 'right')]
    override = f'qos_overrides.{sensors[1].topic}.subscription'
    node = ros.add(
        AnalysisNode,
        parameters={f'{override}.reliability': 'best_effort', f'{override}.depth': 70},
    )
    for sensor in sensors:
        sensor.wait()
    found = [
        node.get_subscriptions_info_by_topic(sensor.topic)[0].qos_profile.reliability
        for sensor in sensors
    ]
    assert found == [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT]
    depths = {s.topic: s.qos_profile.depth for s in node.subscriptions if 'bench' in s.topic}
    assert depths == {sensors[0].topic: qos.MOST, sensors[1].topic: 70}


@pytest.mark.slow
def test_diagnostics_tell_how_much_and_how_hard(ros):
    listener = Listener(ros)
    ros.add(AnalysisNode, parameters={'window_s': 10.0})
    nothing = ros.spin_until(lambda: listener.load)[0]
    assert nothing.level == DiagnosticStatus.WARN
    assert nothing.message == 'no Imu topic found yet'
    sensor = Sensor(ros).wait()
    sensor.publish(noise(600, missing=[100, 101]))
    status = ros.spin_until(
        lambda: [s for s in listener.status if values_of(s).get('window_samples') == '598'],
        'a window with all of them',
    )[-1]
    values = values_of(status)
    assert status.hardware_id == sensor.topic
    assert values['received'] == '598'
    assert values['window_missing'] == '2'
    assert float(values['window_filled']) == pytest.approx(0.6, abs=0.01)
    assert float(values['rate_hz']) == pytest.approx(RATE_HZ, rel=1e-3)
    assert float(values['rms.angular_velocity.x']) == pytest.approx(0.001, rel=0.1)
    load = values_of(listener.load[-1])
    assert load['topics'] == '1'
    assert 0.0 <= float(load['analysis_share']) <= 1.0
    assert {'cpu_share', 'messages_per_s'} <= load.keys()
    # a sensor that falls silent is told from one that is well
    ros.spin_until(lambda: listener.status[-1].level == DiagnosticStatus.STALE, 'silence')


def test_two_publishers_on_one_topic_are_an_error(ros):
    listener = Listener(ros)
    first, second = Sensor(ros), Sensor(ros)
    ros.add(AnalysisNode)
    first.wait().publish(noise(10))
    second.wait()
    status = ros.spin_until(
        lambda: [s for s in listener.status if s.level == DiagnosticStatus.ERROR], 'an error'
    )[0]
    names = [f'/{each.publisher_node}' for each in (first, second)]
    assert status.message == f'several publish {first.topic}: {", ".join(names)}'


def test_every_parameter_is_described(ros):
    node = ros.add(AnalysisNode)
    for setting in SETTINGS:
        described = node.describe_parameter(setting.name)
        assert described.description
        assert described.read_only
    assert node.describe_parameter('window_s').floating_point_range[0].from_value == 1.0
    assert node.get_parameter('topics').value == []


@pytest.mark.parametrize(
    ('wrong', 'says'),
    [
        ({'window_s': 0.0}, 'parameters.window_s: 0 is not allowed; allowed: 1 to 86400 s'),
        ({'window': 60.0}, "parameters.window: unknown; did you mean 'window_s'?"),
        ({'confidence': 95}, 'parameters.confidence: 95 is no number with a decimal point'),
        ({'publish_rate_hz': 100.0}, 'allowed: 0.01 to 5 Hz'),
        ({'topics': 'imu'}, "parameters.topics: 'imu' is not a list of texts"),
    ],
)
def test_a_wrong_parameter_is_refused_with_what_is_allowed(ros, wrong, says):
    with pytest.raises(ConfigError) as caught:
        ros.add(AnalysisNode, parameters=wrong)
    assert says in str(caught.value)


def test_a_sensor_of_the_bench_is_heard_in_blocks(ros):
    samples = noise(600)
    listener, sensor = Listener(ros), Sensor(ros)
    carrier = ros.add(Node, 'carrier', namespace='/bench/left')
    publisher = carrier.create_publisher(UInt8MultiArray, blocks.TOPIC, 1000)
    ros.add(AnalysisNode, parameters={'publish_rate_hz': 5.0})
    ros.spin_until(publisher.get_subscription_count, 'the blocks are heard')
    template = ImuTemplate('left_link', acceleration_covariance=covariance.UNKNOWN)
    rows = template.imu_rows(samples.stamps, samples.acceleration)

    def publish(first, last):
        part = blocks.Part('imu/data_raw', first, T0, rows[first:last])
        publisher.publish(blocks.encode(1, [part]))

    publish(0, 300)
    publish(310, 600)
    status = ros.spin_until(
        lambda: [s for s in listener.status if values_of(s).get('window_samples') == '590']
    )[-1]
    warnings = [s.message for s in listener.status if s.level == DiagnosticStatus.WARN]
    assert any('10 not arrived' in message for message in warnings)
    values = values_of(status)
    assert (values['missed'], values['first_sequence'], values['received']) == ('10', '0', '590')
    assert sensor.publisher.get_subscription_count() == 0
    ros.spin_until(lambda: listener.vectors['rms', 'linear_acceleration'], 'metrics')
    assert not listener.vectors['rms', 'angular_velocity']
