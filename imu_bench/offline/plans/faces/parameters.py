# SPDX-License-Identifier: Apache-2.0
"""The calibration of a sensor as ROS parameters of its node."""

from __future__ import annotations

from imu_bench import __version__
from imu_bench.errors import RecordingError
from imu_bench.metrology.trials.six_position import Calibration
from imu_bench.offline.plans.faces.calibrated import Calibrated

_HEAD = """\
# Calibration by imu-bench {version}, plan six-position, from
# {source}, {topic}
# true = matrix (raw - bias).  Give it to the sensor's node beside its own file:
#   sensor_node --ros-args --params-file SENSOR.yaml --params-file THIS.yaml
# or copy what is below ros__parameters into that file.
/**:
  ros__parameters:
    calibration:
"""


def parameters(sensor: Calibrated) -> str:
    """
    Return the text of a ROS parameter file.

    Raises
    ------
    RecordingError
        If not even the accelerometer is completely known.
    """
    if sensor.accelerometer.matrix is None:
        missing = next(b.reason for b in sensor.accelerometer.bias if not b.observable)
        raise RecordingError(
            f'{sensor.source}, {sensor.topic}: no YAML is written, for the calibration is not '
            f'complete: {missing}'
        )
    # a topic of a damaged bag must not end the comment
    source, topic = (repr(name)[1:-1] for name in (sensor.source, sensor.topic))
    text = _HEAD.format(version=__version__, source=source, topic=topic)
    text += _block('acceleration', sensor.accelerometer, 'm/s²')
    if sensor.gyroscope is not None:
        text += _block('angular_velocity', sensor.gyroscope, 'rad/s')
    return text


def _block(quantity: str, calibration: Calibration, unit: str) -> str:
    bias = [f'"{estimate.value or 0.0:.9g} {unit}"' for estimate in calibration.bias]
    lines = [f'      {quantity}:', f'        bias: [{", ".join(bias)}]']
    if calibration.matrix is not None:
        lines.append('        matrix:')
        for name, row in zip('xyz', calibration.matrix.tolist(), strict=True):
            values = ', '.join(f'"{value:.9g}"' for value in row)
            lines.append(f'          {name}: [{values}]')
    return '\n'.join(lines) + '\n'
