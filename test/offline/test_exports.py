# SPDX-License-Identifier: Apache-2.0
"""
Every export is loaded by the rules of its consumer, and the numbers come back right.

The rules are written down from the consumers' sources and documents:

- Kalibr, kalibr_common/ConfigReader.py, class ImuParameters.
- OpenVINS, ov_msckf/core/VioManagerOptions.h and config/rpng_sim/kalibr_imu_chain.yaml.
- ORB-SLAM3, src/Settings.cc (readIMU, readParameter) and src/Tracking.cc.
- VINS-Mono, vins_estimator/src/factor/integration_base.h.
- GTSAM, navigation/PreintegrationParams.h and PreintegrationCombinedParams.h.
- sensor_msgs/Imu.msg; REP 145; robot_localization, params/ekf.yaml and src/ekf.cpp.
- SDFormat 1.9, element noise; gz-sensors, src/GaussianNoiseModel.cc.
"""

from dataclasses import replace
import math
import sys
import types
from xml.etree import ElementTree

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.fitting.noise_model import FLICKER_FLOOR, GaussMarkov
from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.checks import Checks
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.exports import FORMATS, render
from imu_bench.offline.health.finding import Finding
from imu_bench.samples import Samples
from msg_conversions.quantities import ANGULAR_VELOCITY, LINEAR_ACCELERATION
import numpy as np
import pytest
import yaml

RATE_HZ, N_ACC, K_ACC, N_GYRO = 50.0, 2e-3, 2e-4, 1e-4
DRIFT = Process(1.5e-4, 15.0)
TERMS = {'accelerometer': LINEAR_ACCELERATION, 'gyroscope': ANGULAR_VELOCITY}


@pytest.fixture(scope='module')
def result(recording_of):
    """Return a sensor with a random walk in one axis and a drift with a memory in another."""
    rng = np.random.default_rng(1)
    n = 120_000
    stamps = 1_700_000_000_000_000_000 + np.arange(n) * int(1e9 / RATE_HZ)
    acceleration = rng.normal([0.0, 0.0, 9.8], N_ACC * math.sqrt(RATE_HZ), (n, 3))
    acceleration[:, 0] += np.cumsum(rng.normal(0.0, K_ACC / math.sqrt(RATE_HZ), n))
    gyro = rng.normal(2e-3, N_GYRO * math.sqrt(RATE_HZ), (n, 3))
    gyro[:, 2] += DRIFT.simulate(n, RATE_HZ, rng)
    return analyse(recording_of(Samples(stamps, acceleration, gyro)))


@pytest.fixture(scope='module')
def analysis(result):
    return Analysis((result,))


def without(result, name):
    """Return a result without the axes of one quantity."""
    return replace(
        result, axes={key: axis for key, axis in result.axes.items() if not key.startswith(name)}
    )


def with_coefficient(result, quantity, term, estimate):
    """Return a result with another estimate in every axis of a quantity."""
    axes = {
        name: replace(axis, model=replace(axis.model, **{'gauss_markov': None, term: estimate}))
        if axis.quantity == quantity
        else axis
        for name, axis in result.axes.items()
    }
    return replace(result, axes=axes)


class Kalibr:
    """imu.yaml as Kalibr reads it."""

    def __init__(self, text):
        self.data = yaml.safe_load(text)
        assert isinstance(self.data['rostopic'], str)
        assert self.data['update_rate'] > 0.0
        for sensor in TERMS:
            for name in ('noise_density', 'random_walk'):
                value = self.data[f'{sensor}_{name}']
                assert isinstance(value, float), 'PyYAML takes 2e-5 for a string'
                assert value > 0.0, f'invalid {sensor}_{name}'

    def discrete(self, sensor):
        return self.data[f'{sensor}_noise_density'] / math.sqrt(1.0 / self.data['update_rate'])


class TestKalibr:
    @pytest.mark.slow
    def test_it_takes_the_file_and_finds_the_noise_of_the_samples(self, analysis, result):
        read = Kalibr(render(analysis, 'kalibr'))
        for sensor, quantity in TERMS.items():
            y = result.axes[f'{quantity.name}.y'].statistics['std'].value
            assert read.discrete(sensor) == pytest.approx(y, rel=0.02)
        assert read.data['accelerometer_random_walk'] == pytest.approx(K_ACC, rel=0.6)
        assert read.data['gyroscope_random_walk'] == pytest.approx(DRIFT.q_c, rel=0.5)
        assert read.data['rostopic'] == '/bench/chip/imu/data_raw'

    def test_noise_with_a_short_memory_is_noise_and_no_walk(self, result):
        """Of a memory of 20 ms; the truth is the deviation at 1 s of samples with such noise."""
        rng = np.random.default_rng(4)
        brief = Process(8e-3, 0.02)
        samples = brief.simulate(400_000, RATE_HZ, rng)
        samples += rng.normal(0.0, N_GYRO * math.sqrt(RATE_HZ), samples.size)
        means = samples.reshape(-1, int(RATE_HZ)).mean(axis=1)
        at_one_second = math.sqrt(0.5 * float(np.mean(np.diff(means) ** 2)))
        fit = GaussMarkov(Estimate(brief.q_c, None, None, '1'), Estimate(0.02, None, None, 's'))
        white = Estimate(N_GYRO, None, None, 'rad/s/√Hz')
        bound = Estimate.not_observable('rad/s²/√Hz', 'record longer', high=3e-6)
        found = result
        for term, value in (('N', white), ('K', bound), ('gauss_markov', fit)):
            found = with_coefficient(found, 'angular_velocity', term, value)
        read = Kalibr(render(Analysis((found,)), 'kalibr')).data
        assert read['gyroscope_noise_density'] == pytest.approx(at_one_second, rel=0.03)
        assert read['gyroscope_random_walk'] == 3e-6
        # of which the strength is not known
        unknown = Estimate.not_observable('1', 'record longer', high=1e-2)
        found = with_coefficient(
            found, 'angular_velocity', 'gauss_markov', replace(fit, q_c=unknown)
        )
        read = Kalibr(render(Analysis((found,)), 'kalibr')).data
        assert read['gyroscope_noise_density'] == pytest.approx(N_GYRO)

    def test_what_is_not_observable_is_an_upper_bound_with_a_word(self, result):
        bound = Estimate.not_observable('m/s³/√Hz', 'record longer', high=3e-5)
        text = render(
            Analysis((with_coefficient(result, 'linear_acceleration', 'K', bound),)), 'kalibr'
        )
        assert Kalibr(text).data['accelerometer_random_walk'] == 3e-5
        [line] = [line for line in text.splitlines() if 'accelerometer_random_walk' in line]
        assert 'UPPER BOUND at 95 %' in line

    def test_conservative_is_never_below_nominal(self, analysis):
        nominal = Kalibr(render(analysis, 'kalibr')).data
        upper = Kalibr(render(analysis, 'kalibr', conservative=True)).data
        for name, value in nominal.items():
            if name not in ('rostopic', 'update_rate'):
                assert upper[name] > value

    def test_the_unit_and_the_convention_stand_beside_every_number(self, analysis):
        for line in render(analysis, 'kalibr').splitlines():
            if 'noise_density:' in line or 'random_walk:' in line:
                assert '/sqrt(Hz), continuous-time, two-sided' in line
                assert 'rms of' in line or ' only, ' in line

    def test_a_missing_sensor_is_named(self, result):
        with pytest.raises(RecordingError, match='no angular_velocity'):
            render(Analysis((without(result, 'angular'),)), 'kalibr')

    @pytest.mark.parametrize('to', ['kalibr', 'openvins', 'orb-slam3'])
    def test_flicker_that_has_no_key_is_told(self, result, to):
        floor = Estimate(1e-2, 9e-3, 1.1e-2, 'm/s²')
        text = render(Analysis((with_coefficient(result, 'linear_acceleration', 'B', floor),)), to)
        [line] = [
            line for line in text.splitlines() if 'flicker noise of the accelerometer' in line
        ]
        walk = float(line.split(' of at least ')[1].split()[0])
        white = Kalibr(render(Analysis((result,)), 'kalibr')).data['accelerometer_noise_density']
        # both lines meet the floor at the same averaging time
        tau = (white / (FLICKER_FLOOR * 1e-2)) ** 2
        assert walk * math.sqrt(tau / 3.0) == pytest.approx(FLICKER_FLOOR * 1e-2, rel=0.01)
        assert 'flicker' not in render(Analysis((result,)), to)

    def test_a_sensor_without_constant_signals_is_not_told_to_record_longer(
        self, result, monkeypatch
    ):
        monkeypatch.setattr(AxisResult, 'shows_constants', False)
        none = Estimate.not_observable('m/s³/√Hz', 'not defined: it shows no constant signal')
        changed = with_coefficient(result, 'linear_acceleration', 'K', none)
        with pytest.raises(RecordingError, match='shows no constant signal') as caught:
            render(Analysis((changed,)), 'kalibr')
        assert 'longer' not in str(caught.value)

    def test_no_bound_at_all_is_an_error_and_not_a_zero(self, result):
        nothing = Estimate.not_observable('m/s³/√Hz', '5 averaging times')
        changed = with_coefficient(result, 'linear_acceleration', 'K', nothing)
        with pytest.raises(RecordingError, match='longer recording'):
            render(Analysis((changed,)), 'kalibr')


def opencv(text):
    """Return a file that cv::FileStorage takes: its own directive first, no tabs."""
    first, _, rest = text.partition('\n')
    assert first == '%YAML:1.0'
    assert '\t' not in text
    return yaml.safe_load(rest)


def test_openvins(analysis):
    imu = opencv(render(analysis, 'openvins'))['imu0']
    kalibr = Kalibr(render(analysis, 'kalibr')).data
    for key in kalibr:
        assert imu[key] == kalibr[key]
    assert np.array(imu['T_i_b']).shape == (4, 4)
    for key in ('Tw', 'R_IMUtoGYRO', 'Ta', 'R_IMUtoACC', 'Tg'):
        assert np.array(imu[key], dtype=float).shape == (3, 3)
    assert imu['model'] in ('calibrated', 'kalibr', 'rpng')
    assert imu['time_offset'] == 0.0


def test_orb_slam3(analysis):
    """Settings.cc refuses what OpenCV does not take for a real number, such as 200."""
    read = opencv(render(analysis, 'orb-slam3'))
    kalibr = Kalibr(render(analysis, 'kalibr')).data
    assert all(isinstance(value, float) for value in read.values())
    assert read == {
        'IMU.NoiseGyro': kalibr['gyroscope_noise_density'],
        'IMU.NoiseAcc': kalibr['accelerometer_noise_density'],
        'IMU.GyroWalk': kalibr['gyroscope_random_walk'],
        'IMU.AccWalk': kalibr['accelerometer_random_walk'],
        'IMU.Frequency': pytest.approx(RATE_HZ),
    }


def test_vins_walks_the_bias_as_measured(analysis):
    """The covariance of the bias grows by (acc_w dt)² per step: K² after one second."""
    read = opencv(render(analysis, 'vins'))
    dt, kalibr = 1.0 / RATE_HZ, Kalibr(render(analysis, 'kalibr')).data
    for prefix, sensor in (('acc', 'accelerometer'), ('gyr', 'gyroscope')):
        grown = sum((read[f'{prefix}_w'] * dt) ** 2 for _ in range(int(RATE_HZ)))
        assert math.sqrt(grown) == pytest.approx(kalibr[f'{sensor}_random_walk'], rel=1e-5)
        sigma = kalibr[f'{sensor}_noise_density'] * math.sqrt(RATE_HZ)
        assert read[f'{prefix}_n'] == pytest.approx(sigma, rel=1e-5)


class CombinedParams:
    """The setters of gtsam.PreintegrationCombinedParams, with the checks of Matrix3."""

    def __init__(self, gravity):
        self.gravity = gravity
        self.set = {}

    @classmethod
    def MakeSharedU(cls, g=9.81):
        return cls((0.0, 0.0, -g))

    def _matrix3(name):
        def setter(self, matrix):
            assert matrix.shape == (3, 3) and matrix.dtype == np.float64
            np.linalg.cholesky(matrix)  # a noise model needs a positive definite covariance
            self.set[name] = matrix

        return setter

    setAccelerometerCovariance = _matrix3('accelerometer')
    setGyroscopeCovariance = _matrix3('gyroscope')
    setBiasAccCovariance = _matrix3('accelerometer bias')
    setBiasOmegaCovariance = _matrix3('gyroscope bias')


def test_gtsam(analysis, monkeypatch):
    library = types.ModuleType('gtsam')
    library.PreintegrationCombinedParams = CombinedParams
    monkeypatch.setitem(sys.modules, 'gtsam', library)
    module = {}
    exec(compile(render(analysis, 'gtsam'), 'imu_params.py', 'exec'), module)
    params = module['imu_params']()
    assert params.gravity == (0.0, 0.0, -9.80665)
    # discrete covariance inside GTSAM: continuous one over dt
    discrete = params.set['accelerometer'][1, 1] * RATE_HZ
    assert discrete == pytest.approx(N_ACC**2 * RATE_HZ, rel=0.02)
    assert params.set['gyroscope'][2, 2] == pytest.approx(N_GYRO**2, rel=0.05)
    assert math.sqrt(params.set['accelerometer bias'][0, 0]) == pytest.approx(K_ACC, rel=0.5)
    assert math.sqrt(params.set['gyroscope bias'][2, 2]) == pytest.approx(DRIFT.q_c, rel=0.4)


class TestRos:
    def test_covariances_fit_the_message(self, analysis):
        read = yaml.safe_load(render(analysis, 'sensor_msgs'))
        for name, sigma in (('linear_acceleration', N_ACC), ('angular_velocity', N_GYRO)):
            matrix = np.array(read[f'{name}_covariance']).reshape(3, 3)
            assert np.all(matrix == matrix.T) and np.all(np.linalg.eigvalsh(matrix) > 0.0)
            assert matrix[1, 1] == pytest.approx(sigma**2 * RATE_HZ, rel=0.02)
        assert read['orientation_covariance'] == [-1.0] + [0.0] * 8

    def test_what_was_not_measured_is_minus_one(self, result):
        text = render(Analysis((without(result, 'linear'),)), 'sensor_msgs')
        assert yaml.safe_load(text)['linear_acceleration_covariance'][0] == -1.0

    def test_robot_localization(self, analysis):
        text = render(analysis, 'robot_localization')
        read = yaml.safe_load(text)
        filtered = read['ekf_filter_node']['ros__parameters']
        config = filtered['imu0_config']
        assert len(config) == 15 and all(isinstance(flag, bool) for flag in config)
        assert config == [False] * 9 + [True] * 6
        assert filtered['imu0'] == '/bench/chip/imu/data_raw'
        assert isinstance(filtered['imu0_queue_size'], int)
        driver = read['imu_driver']['ros__parameters']
        variance = driver['linear_acceleration_stddev'] ** 2
        assert variance == pytest.approx(N_ACC**2 * RATE_HZ, rel=0.05)
        # ekf.cpp puts 1e-9 in the place of anything smaller
        assert driver['angular_velocity_stddev'] ** 2 > 1e-9
        assert 'raises its square' not in text

    def test_a_variance_that_the_filter_raises_is_said(self, result):
        tiny = Estimate(1e-7, 0.9e-7, 1.1e-7, 'rad/s/√Hz')
        changed = with_coefficient(result, 'angular_velocity', 'N', tiny)
        text = render(Analysis((changed,)), 'robot_localization')
        assert 'the filter raises its square to 1e-09' in text

    def test_a_gyroscope_alone_fuses_no_acceleration(self, result):
        text = render(Analysis((without(result, 'linear'),)), 'robot_localization')
        read = yaml.safe_load(text)
        assert read['ekf_filter_node']['ros__parameters']['imu0_config'][12:] == [False] * 3
        assert 'linear_acceleration_stddev' not in read['imu_driver']['ros__parameters']


class TestGzSim:
    ELEMENTS = (
        'mean', 'stddev', 'bias_mean', 'bias_stddev', 'dynamic_bias_stddev',
        'dynamic_bias_correlation_time', 'precision',
    )  # fmt: skip

    def noise(self, text, quantity, letter):
        sensor = ElementTree.fromstring(text)
        assert sensor.tag == 'sensor' and sensor.get('type') == 'imu'
        block = sensor.find(f'imu/{quantity}/{letter}/noise')
        assert block.get('type') in ('gaussian', 'gaussian_quantized')
        found = {element.tag: float(element.text) for element in block}
        assert set(found) <= set(self.ELEMENTS)
        assert all(value >= 0.0 for value in found.values())
        return found

    def test_the_simulated_noise_is_the_measured_one(self, analysis, result):
        text = render(analysis, 'gz-sim')
        found = self.noise(text, 'linear_acceleration', 'y')
        assert found['stddev'] == pytest.approx(N_ACC * math.sqrt(RATE_HZ), rel=0.02)
        found = self.noise(text, 'angular_velocity', 'z')
        time, s = found['dynamic_bias_correlation_time'], found['dynamic_bias_stddev']
        # GaussianNoiseModel.cc: stationary variance of its recursion is s² T/2
        step = 1.0 / RATE_HZ
        added = -(s**2) * time / 2.0 * math.expm1(-2.0 * step / time)
        stationary = math.sqrt(added / (1.0 - math.exp(-step / time) ** 2))
        assert stationary == pytest.approx(DRIFT.sigma, rel=0.3)
        assert found['bias_mean'] == pytest.approx(2e-3, rel=0.1)

    def test_a_random_walk_has_the_length_of_the_recording(self, result):
        seen = Estimate(2e-4, 1.5e-4, 2.5e-4, 'm/s³/√Hz')
        axis = result.axes['linear_acceleration.x']
        plain = replace(
            axis, checks=Checks(), model=replace(axis.model, K=seen, gauss_markov=None)
        )
        changed = replace(result, axes=dict(result.axes) | {axis.name: plain})
        found = self.noise(render(Analysis((changed,)), 'gz-sim'), 'linear_acceleration', 'x')
        assert found['dynamic_bias_stddev'] == 2e-4
        assert found['dynamic_bias_correlation_time'] == pytest.approx(2400.0, rel=0.01)

    def test_no_drift_is_said_and_left_out_unless_conservative(self, analysis):
        nominal = render(analysis, 'gz-sim')
        assert 'dynamic_bias_stddev' not in self.noise(nominal, 'angular_velocity', 'x')
        assert 'no change of the bias was observable' in nominal
        upper = render(analysis, 'gz-sim', conservative=True)
        assert self.noise(upper, 'angular_velocity', 'x')['dynamic_bias_stddev'] > 0.0

    def test_text_from_a_bag_cannot_break_the_document(self, result):
        evil = replace(result, source='a-->b--c\n<x>', topic='/a&b<c>')
        ElementTree.fromstring(render(Analysis((evil,)), 'gz-sim'))


def test_kalman_models_are_consistent(analysis):
    read = yaml.safe_load(render(analysis, 'kalman'))
    step = read['step']
    z = read['angular_velocity.z']
    assert z['model'] == 'gauss_markov'
    assert z['transition'] == pytest.approx(math.exp(-step / z['correlation_time']), rel=1e-9)
    assert z['sigma'] == pytest.approx(DRIFT.sigma, rel=0.3)
    stationary = z['driving_variance'] / (1.0 - z['transition'] ** 2)
    assert math.sqrt(stationary) == pytest.approx(z['sigma'], rel=1e-3)
    assert z['measurement_variance'] == pytest.approx(N_GYRO**2 * RATE_HZ, rel=0.02)
    assert read['angular_velocity.x']['model'] == 'constant'
    upper = yaml.safe_load(render(analysis, 'kalman', conservative=True))['angular_velocity.x']
    assert upper['model'] == 'random_walk'
    assert upper['correlation_time'] == math.inf and upper['transition'] == 1.0
    assert upper['driving_variance'] == pytest.approx(upper['strength'] ** 2 * step, rel=1e-5)


class TestChoice:
    def test_every_format_says_where_it_comes_from(self, analysis):
        for name in FORMATS:
            text = render(analysis, name)
            assert 'night.mcap' in text, name
            text.encode('utf-8' if name == 'csv' else 'ascii')

    def test_several_sensors_need_a_choice(self, result):
        both = Analysis((result, replace(result, topic='/bench/other/imu/data_raw')))
        with pytest.raises(RecordingError, match=r'chip .*other'):
            render(both, 'kalibr')
        text = render(both, 'kalibr', 'other')
        assert Kalibr(text).data['rostopic'] == '/bench/other/imu/data_raw'
        by_topic = render(both, 'kalibr', '/bench/other/imu/data_raw')
        assert by_topic == text
        with pytest.raises(RecordingError, match="no sensor 'third'"):
            render(both, 'kalibr', 'third')

    def test_unknown_format(self, analysis):
        with pytest.raises(RecordingError, match='known are kalibr'):
            render(analysis, 'matlab')

    def test_a_topic_cannot_add_lines(self, result):
        evil = replace(result, topic='/a"\ngyroscope_noise_density: 1.0', source='x\ny: 1')
        read = Kalibr(render(Analysis((evil,)), 'kalibr')).data
        assert read['gyroscope_noise_density'] < 1e-3
        assert 'y' not in read

    def test_severe_findings_stand_on_top(self, result):
        moved = Finding('severe', 'motion', 'It moved.', 'All of it.', 'Record again.')
        health = replace(result.health, findings=(moved,))
        text = render(Analysis((replace(result, health=health),)), 'kalibr')
        assert text.startswith('# WARNING: NOT TO BE TRUSTED (motion): It moved. All of it.\n')
