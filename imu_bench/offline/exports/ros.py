# SPDX-License-Identifier: Apache-2.0
"""ROS 2: covariances of sensor_msgs/Imu, and robot_localization."""

from __future__ import annotations

import math

from imu_bench.offline.exports.header import commented, exponent, lines, notes, topic_line
from imu_bench.offline.exports.numbers import Numbers
from imu_bench.samples import ANGULAR_VELOCITY, LINEAR_ACCELERATION, Quantity

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
