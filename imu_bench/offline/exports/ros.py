# SPDX-License-Identifier: Apache-2.0
"""ROS 2: covariances of sensor_msgs/Imu, robot_localization, URDF; gz-sim; any Kalman filter."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape  # that of xml.sax imports what opens web pages
import math
from xml.etree import ElementTree

from imu_bench.config import BenchConfig
from imu_bench.errors import ConfigError
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.exports.numbers import (
    commented,
    exponent,
    lines,
    notes,
    Numbers,
    plain,
    topic_line,
)
from msg_conversions.quantities import (
    ANGULAR_VELOCITY,
    IMU_QUANTITIES,
    LINEAR_ACCELERATION,
    Quantity,
)

_FIELDS = (
    ('linear_acceleration', LINEAR_ACCELERATION, '(m/s^2)^2', 'm/s^2'),
    ('angular_velocity', ANGULAR_VELOCITY, '(rad/s)^2', 'rad/s'),
)
_FLOOR = 1e-9
"""Variance below which robot_localization (ekf.cpp) puts this in its place."""

_FILTER_HZ = 30.0
"""Default of its parameter `frequency`."""


def sensor_msgs(numbers: Numbers) -> str:
    """
    Return the covariances of sensor_msgs/Imu.

    Row-major 3 × 3, variance of a sample on the diagonal; -1 in the first element of a quantity
    that is not measured (sensor_msgs/Imu.msg).
    """
    heading = lines(
        numbers,
        'covariances of sensor_msgs/Imu',
        f'discrete-time at {numbers.rate:.4f} Hz: N^2 * rate, the variance of a sample of white '
        'noise',
        'another rate needs other numbers; row-major x, y, z; -1 means not measured',
    )
    text = commented(heading)
    for name, quantity, unit, _ in _FIELDS:
        text += _covariance(numbers, name, quantity, unit)
    return text + f'orientation_covariance: {_row([-1.0] + [0.0] * 8)}  # not measured\n'


def robot_localization(numbers: Numbers) -> str:
    """
    Return the IMU part of the parameters of robot_localization, and those of the driver.

    The filter takes covariances from the messages only, so the driver must write them: with the
    parameters of REP 145 here.  It ignores a quantity with -1 and raises variances below 1e-9
    (ros_filter.cpp, ekf.cpp).
    """
    recording = numbers.recording
    heading = lines(
        numbers,
        'robot_localization (ROS 2)',
        'the filter takes its covariances from the messages: the driver has to write them',
        f'stddev: discrete-time at {numbers.rate:.4f} Hz, N sqrt(rate); another rate needs others',
    )
    used = [bool(recording.of(quantity.name)) for _, quantity, _, _ in _FIELDS]
    config = [False] * 9 + 3 * [used[1]] + 3 * [used[0]]
    rows = [', '.join(str(v).lower() for v in config[i : i + 3]) for i in range(0, 15, 3)]
    queue = max(10, math.ceil(2.0 * numbers.rate / _FILTER_HZ))
    table = ',\n                  '.join(rows)
    text = (
        f'ekf_filter_node:\n  ros__parameters:\n    imu0: {topic_line(recording)}\n'
        f'    # x y z, roll pitch yaw, vx vy vz, vroll vpitch vyaw, ax ay az\n'
        f'    imu0_config: [{table}]\n'
        f'    imu0_queue_size: {queue}  # two cycles at {_FILTER_HZ:g} Hz\n'
        f'    imu0_differential: false\n    imu0_relative: false\n'
        f'    imu0_remove_gravitational_acceleration: {str(used[0]).lower()}\n\n'
        '# parameters of the driver after REP 145; imu_bench sensor nodes have them\n'
        'imu_driver:\n  ros__parameters:\n'
    )
    return commented(heading) + text + _deviations(numbers)


def _deviations(numbers: Numbers) -> str:
    text = ''
    for name, quantity, _, unit in _FIELDS:
        if not numbers.recording.of(quantity.name):
            continue
        white = numbers.white_noise(quantity)
        value = white.value * math.sqrt(numbers.rate)
        note = f'{unit}, discrete-time; {white.note}'
        if value**2 < _FLOOR:
            note += f'; the filter raises its square to {_FLOOR:g}'
        text += f'    {name}_stddev: {exponent(value)}  # {note}\n'
    return text


def _covariance(numbers: Numbers, name: str, quantity: Quantity, unit: str) -> str:
    if not numbers.recording.of(quantity.name):
        return f'{name}_covariance: {_row([-1.0] + [0.0] * 8)}  # not measured\n'
    found = numbers.per_axis(quantity, 'N')
    matrix = [0.0] * 9
    matrix[::4] = [number.value**2 * numbers.rate for number in found]
    return f'{name}_covariance: {_row(matrix)}  # {unit}, discrete-time; {notes(found)}\n'


def _row(values: list[float]) -> str:
    return f'[{", ".join(exponent(v) if v not in (0.0, -1.0) else f"{v:.1f}" for v in values)}]'


_UNITS = {
    'linear_acceleration': ('m/s^2', 'm/s^3'),
    'angular_velocity': ('rad/s', 'rad/s^2'),
}
_KIND = 'continuous-time, two-sided'
_START = 'how it differs from start to start is not in one recording'


def gz_sim(numbers: Numbers) -> str:
    """
    Return an SDF sensor element with the noise of each axis.

    gz-sensors (GaussianNoiseModel.cc) adds normal numbers with `stddev` to every sample, and a
    bias that a step dt takes from b to b e^(−dt/T) plus normal numbers of the variance
    s² T/2 (1 − e^(−2dt/T)): s is the strength q_c of the process, not its standard deviation.
    """
    heading = lines(
        numbers,
        'gz-sim (SDF) IMU noise',
        f'stddev is discrete-time at update_rate: N sqrt(rate), rate {numbers.rate:.4f} Hz',
        'dynamic_bias_stddev is continuous-time: q_c of a Gauss-Markov process, not its sigma',
        'bias_mean of the gyroscope is the measured mean without its sign, which gz-sim draws; '
        'that of the accelerometer is 0, because it cannot be told from gravity and tilt',
    )
    comment = '\n'.join(f'  {line.replace("--", "- -")}' for line in heading)
    text = f'<!--\n{comment}\n-->\n<sensor name="imu" type="imu">\n  <always_on>true</always_on>\n'
    text += f'  <update_rate>{numbers.rate:.4f}</update_rate>\n'
    topic = plain(numbers.recording.topic)
    if topic.startswith('/'):
        text += f'  <topic>{escape(topic, quote=False)}</topic>\n'
    text += '  <imu>\n'
    for quantity in (ANGULAR_VELOCITY, LINEAR_ACCELERATION):
        axes = numbers.recording.of(quantity.name)
        if axes:
            blocks = ''.join(_noise(numbers, axis) for axis in axes)
            text += f'    <{quantity.name}>\n{blocks}    </{quantity.name}>\n'
    return text + '  </imu>\n</sensor>\n'


def _noise(numbers: Numbers, axis: AxisResult) -> str:
    (unit, per_second), letter = _UNITS[axis.quantity], axis.letter
    white = numbers.axis(axis, 'N')
    mean = abs(axis.statistics['mean'].value or 0.0) if unit == 'rad/s' else 0.0
    rows = [
        ('mean', 0.0, unit),
        ('stddev', white.value * math.sqrt(numbers.rate), f'{unit}, discrete-time; {white.note}'),
        ('bias_mean', mean, unit),
        ('bias_stddev', 0.0, f'{unit}; {_START}'),
    ]
    bias = numbers.bias(axis)
    if bias is not None:
        time, note = bias.correlation_time, bias.note
        if math.isinf(time):
            # a random walk over the recording; SDF has no other way to say it
            time = numbers.recording.health.duration_s
            note += '; correlation time: length of the recording'
        rows += [
            ('dynamic_bias_stddev', bias.strength, f'{per_second}/sqrt(Hz), {_KIND}; {note}'),
            ('dynamic_bias_correlation_time', time, 's'),
        ]
    inner = ''.join(
        f'          <{name}>{exponent(value)}</{name}> <!-- {comment.replace("--", "- -")} -->\n'
        for name, value, comment in rows
    )
    if bias is None:
        inner += '          <!-- no change of the bias was observable -->\n'
    return (
        f'      <{letter}>\n        <noise type="gaussian">\n{inner}        </noise>\n'
        f'      </{letter}>\n'
    )


def kalman(numbers: Numbers) -> str:
    """
    Return the models of a Kalman filter for the bias of each axis, continuous and discrete.

    State b, b' = transition b + normal numbers of `driving_variance`, measured with white noise
    of `measurement_variance`; for a step of one sample.
    """
    step = 1.0 / numbers.rate
    heading = lines(
        numbers,
        'bias models for a Kalman filter',
        f'discrete numbers are for a step of one sample, {step:.9g} s; continuous ones do not '
        'depend on it',
        'white noise N is two-sided: measurement_variance = N^2 * rate',
        'a random walk has an infinite correlation time',
    )
    text = commented(heading) + f'step: {exponent(step)}  # s\n'
    for quantity in IMU_QUANTITIES:
        for axis in numbers.recording.of(quantity.name):
            text += _model(numbers, axis, step)
    return text


def _model(numbers: Numbers, axis: AxisResult, step: float) -> str:
    unit, per_second = _UNITS[axis.quantity]
    white, bias = numbers.axis(axis, 'N'), numbers.bias(axis)
    rows = [
        ('white_noise', exponent(white.value), f'{unit}/sqrt(Hz), {_KIND}; {white.note}'),
        ('measurement_variance', exponent(white.value**2 * numbers.rate),
         f'({unit})^2, discrete-time'),
    ]  # fmt: skip
    if bias is None:
        rows.append(('model', 'constant', 'no change of the bias was observable'))
    else:
        walk = math.isinf(bias.correlation_time)
        time = '.inf' if walk else exponent(bias.correlation_time)
        sigma = '.inf' if walk else exponent(bias.sigma)
        rows += [
            ('model', 'random_walk' if walk else 'gauss_markov', bias.note),
            ('correlation_time', time, 's'),
            ('sigma', sigma, f'{unit}, of the process'),
            ('strength', exponent(bias.strength), f'{per_second}/sqrt(Hz), {_KIND}: q_c or K'),
            ('transition', f'{bias.transition(step):.12f}', 'discrete-time: exp(-step/T_c)'),
            (
                'driving_variance',
                exponent(bias.driving_variance(step)),
                f'({unit})^2, discrete-time',
            ),
        ]
    body = ''.join(f'  {name}: {value}  # {note}\n' for name, value, note in rows)
    return f'{axis.name}:\n{body}'


def urdf(bench: BenchConfig) -> str:
    """
    Return the sensors of a bench that have a place, as fixed joints of a robot.

    Links and joints as in the XML specification of URDF: a tree with one root, lengths in m, roll,
    pitch and yaw in rad about fixed axes.

    Raises
    ------
    ConfigError
        If no sensor has a place, or their places are no tree.

    Examples
    --------
    >>> from imu_bench.config import SensorConfig
    >>> from msg_conversions.transforms import Mounting
    >>> left = SensorConfig('left', 'mpu9250', 'emulated', mounting=Mounting('base_link'))
    >>> print(urdf(BenchConfig('mine', sensors=(left,))).splitlines()[2].strip())
    <link name="base_link" />
    """
    placed = [(one, one.mounting) for one in bench.sensors if one.mounting is not None]
    if not placed:
        raise ConfigError(
            f'bench {bench.name}: no sensor has a place; give entries mounting: {{xyz: …, rpy: …}}'
        )
    parents = {sensor.frame_id: place.parent for sensor, place in placed}
    roots = sorted({_root(frame, parents, bench.name) for frame in parents})
    if len(roots) > 1:
        raise ConfigError(
            f'bench {bench.name}: mounting.parent leads to {" and ".join(roots)}; a URDF has one '
            'root'
        )
    robot = ElementTree.Element('robot', name=bench.name)
    for link in dict.fromkeys([*roots, *parents]):
        ElementTree.SubElement(robot, 'link', name=link)
    for sensor, place in placed:
        joint = ElementTree.SubElement(robot, 'joint', name=f'{sensor.name}_mounting')
        joint.set('type', 'fixed')
        ElementTree.SubElement(joint, 'parent', link=place.parent)
        ElementTree.SubElement(joint, 'child', link=sensor.frame_id)
        ElementTree.SubElement(joint, 'origin', xyz=_three(place.xyz), rpy=_three(place.rpy))
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, "unicode")}\n'


def _root(frame: str, parents: dict[str, str], bench: str) -> str:
    """Return where the parents of a frame lead."""
    passed = [frame]
    while passed[-1] in parents:
        passed.append(parents[passed[-1]])
        if passed[-1] in passed[:-1]:
            raise ConfigError(
                f'bench {bench}: mounting.parent goes round in a circle: {" to ".join(passed)}'
            )
    return passed[-1]


def _three(values: Iterable[float]) -> str:
    return ' '.join(f'{value:.9g}' for value in values)
