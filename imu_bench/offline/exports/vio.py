# SPDX-License-Identifier: Apache-2.0
"""Visual-inertial estimators: Kalibr, OpenVINS, VINS-Mono and VINS-Fusion, GTSAM."""

from __future__ import annotations

from imu_bench.offline.exports.numbers import (
    commented,
    exponent,
    lines,
    notes,
    Numbers,
    topic_line,
)
from msg_conversions.quantities import ANGULAR_VELOCITY, LINEAR_ACCELERATION
import numpy as np

_CONTINUOUS = (
    'densities are continuous-time and two-sided: sigma of a sample = density * sqrt(rate)',
)
_QUANTITIES = (
    ('accelerometer', LINEAR_ACCELERATION, 'm/s^2', 'm/s^3'),
    ('gyroscope', ANGULAR_VELOCITY, 'rad/s', 'rad/s^2'),
)
_KIND = 'continuous-time, two-sided'


def kalibr(numbers: Numbers) -> str:
    """
    Return imu.yaml of Kalibr.

    Kalibr (kalibr_common/ConfigReader.py, class ImuParameters) wants the six keys below, takes
    sigma_discrete = density/√(1/rate), so N itself, and refuses what is not above zero.
    """
    heading = lines(
        numbers,
        'Kalibr imu.yaml',
        *_CONTINUOUS,
        'Kalibr refuses 0: what could not be observed is its upper bound',
        *_flicker(numbers),
    )
    return commented(heading) + _densities(numbers) + _topic_and_rate(numbers)


def openvins(numbers: Numbers) -> str:
    """
    Return kalibr_imu_chain.yaml of OpenVINS, without intrinsics.

    Keys as OpenVINS reads them below ``imu0`` (ov_msckf VioManagerOptions.h: continuous-time),
    for a file that OpenCV parses, which must begin with its own %YAML directive.
    """
    heading = lines(
        numbers,
        'OpenVINS kalibr_imu_chain.yaml',
        *_CONTINUOUS,
        'intrinsics are those of an ideal IMU: replace them by those of a calibration',
        *_flicker(numbers),
    )
    eye3, eye4 = np.eye(3), np.eye(4)
    parts = [
        '%YAML:1.0\n\n',
        commented(heading),
        'imu0:\n',
        _matrix('T_i_b', eye4),
        _indented(_densities(numbers) + _topic_and_rate(numbers)),
        '  time_offset: 0.0\n  model: "kalibr"\n',
        _matrix('Tw', eye3),
        _matrix('R_IMUtoGYRO', eye3),
        _matrix('Ta', eye3),
        _matrix('R_IMUtoACC', eye3),
        _matrix('Tg', np.zeros((3, 3))),
    ]
    return ''.join(parts)


def orb_slam3(numbers: Numbers) -> str:
    """
    Return the IMU part of the settings of ORB-SLAM3, without the place of the camera.

    ORB-SLAM3 (src/Tracking.cc) multiplies noise with √IMU.Frequency and divides walks by it, so
    these are N and K; src/Settings.cc takes only what OpenCV reads as a real number.
    """
    heading = lines(
        numbers,
        'ORB-SLAM3 settings, IMU part',
        *_CONTINUOUS,
        'IMU.T_b_c1 comes from a calibration of camera and IMU',
        'IMU.Frequency is a real number, as File.version "1.0" wants it; older files want a whole '
        'one',
        *_flicker(numbers),
    )
    text = ''
    for name, quantity, unit, per_second in _QUANTITIES:
        short = {'accelerometer': 'Acc', 'gyroscope': 'Gyro'}[name]
        white, walk = numbers.white_noise(quantity), numbers.random_walk(quantity)
        text += _line(f'IMU.Noise{short}', white.value, f'{unit}/sqrt(Hz), {_KIND}', white.note)
        text += _line(f'IMU.{short}Walk', walk.value, f'{per_second}/sqrt(Hz), {_KIND}', walk.note)
    text += f'IMU.Frequency: {numbers.rate:.4f}  # Hz, measured\n'
    return '%YAML:1.0\n\n' + commented(heading) + text


def vins(numbers: Numbers) -> str:
    """
    Return the IMU part of a VINS-Mono or VINS-Fusion configuration.

    Their integration_base.h multiplies these with dt in every step: the noise of a sample, and
    the change of the bias per step over dt.  Both are discrete, at the rate of the IMU: N √rate
    and K √rate.
    """
    root = numbers.rate**0.5
    heading = lines(
        numbers,
        'VINS-Mono / VINS-Fusion configuration, IMU part',
        f'discrete-time at {numbers.rate:.4f} Hz: acc_n = N sqrt(rate), acc_w = K sqrt(rate)',
        'another rate needs other numbers; VINS is often run with ten times more, for what is '
        'not noise of the IMU',
    )
    text = ''
    for name, quantity, unit, per_second in _QUANTITIES:
        prefix = name[:3]
        white, walk = numbers.white_noise(quantity), numbers.random_walk(quantity)
        text += _line(f'{prefix}_n', white.value * root, f'{unit}, discrete-time', white.note)
        text += _line(f'{prefix}_w', walk.value * root, f'{per_second}, discrete-time', walk.note)
    topic = f'imu_topic: {topic_line(numbers.recording)}\n'
    return '%YAML:1.0\n\n' + commented(heading) + topic + text


def gtsam(numbers: Numbers) -> str:
    """
    Return a Python module that sets the preintegration parameters of GTSAM.

    Covariances are continuous-time (gtsam PreintegrationParams.h and
    PreintegrationCombinedParams.h): squares of N and K of each axis.
    """
    heading = lines(
        numbers,
        'GTSAM preintegration parameters',
        'covariances are continuous-time and two-sided: squares of N and K of x, y and z',
    )
    text = commented(heading) + _GTSAM_BEGIN
    for setter, quantity, term, unit in (
        ('setAccelerometerCovariance', LINEAR_ACCELERATION, 'N', '(m/s^2)^2/Hz'),
        ('setGyroscopeCovariance', ANGULAR_VELOCITY, 'N', '(rad/s)^2/Hz'),
        ('setBiasAccCovariance', LINEAR_ACCELERATION, 'K', '(m/s^3)^2/Hz'),
        ('setBiasOmegaCovariance', ANGULAR_VELOCITY, 'K', '(rad/s^2)^2/Hz'),
    ):
        found = numbers.per_axis(quantity, term)
        values = ', '.join(exponent(number.value**2) for number in found)
        text += f'    # {unit}, {_KIND}; {notes(found)}\n'
        text += f'    params.{setter}(np.diag([{values}]))\n'
    return text + '    return params\n'


_GTSAM_BEGIN = '''\
import gtsam
import numpy as np


def imu_params(gravity: float = 9.80665) -> "gtsam.PreintegrationCombinedParams":
    """Return the parameters for a navigation frame with z up."""
    params = gtsam.PreintegrationCombinedParams.MakeSharedU(gravity)
'''


def _flicker(numbers: Numbers) -> list[str]:
    """Return what a model of white noise and a random walk leaves out."""
    told = []
    for name, quantity, _, per_second in _QUANTITIES:
        needed = numbers.flicker_walk(quantity)
        if needed is not None and needed > numbers.random_walk(quantity).value:
            told.append(
                f'flicker noise of the {name} (B) has no key here: to allow for it take a '
                f'random walk of at least {exponent(needed)} {per_second}/sqrt(Hz)'
            )
    return told


def _densities(numbers: Numbers) -> str:
    text = ''
    for name, quantity, unit, per_second in _QUANTITIES:
        white, walk = numbers.white_noise(quantity), numbers.random_walk(quantity)
        density, drive = f'{unit}/sqrt(Hz), {_KIND}', f'{per_second}/sqrt(Hz), {_KIND}'
        text += _line(f'{name}_noise_density', white.value, density, white.note)
        text += _line(f'{name}_random_walk', walk.value, drive, walk.note)
    return text


def _topic_and_rate(numbers: Numbers) -> str:
    return (
        f'rostopic: {topic_line(numbers.recording)}\n'
        f'update_rate: {numbers.rate:.4f}  # Hz, measured\n'
    )


def _line(key: str, value: float, unit: str, note: str) -> str:
    return f'{key}: {exponent(value)}  # {unit}; {note}\n'


def _indented(text: str) -> str:
    return ''.join(f'  {line}\n' for line in text.splitlines())


def _matrix(name: str, rows: np.ndarray) -> str:
    body = ''.join(f'    - [{", ".join(f"{v:.1f}" for v in row)}]\n' for row in rows)
    return f'  {name}:\n{body}'
