# SPDX-License-Identifier: Apache-2.0
"""Tables and figures of the six-position plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials.six_position import AXES, Calibration, face
from imu_bench.offline.plans.six_position.measuring import Calibrated
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Cell, Column, Table
from imu_bench.version import __version__
import numpy as np

Named = Sequence[tuple[str, Calibrated]]

_NOTES = {
    'faces': (
        'raw = S true + bias, in the frame of the housing. Scale is the diagonal of S less one; '
        '“from y” is what this output shows of acceleration along y, as an angle. How uneven '
        'the faces lay is in the intervals.'
    ),
    'norm': (
        'raw = S true + bias from positions of any kind: only the size of gravity is known, so '
        'the frame is that of the sensor itself (z along its z axis, y in its y, z plane).'
    ),
    'turns': (
        'raw = S true + bias. The interval of the scale is mostly the uncertainty of the angle '
        'of the turns (--set turn_error).'
    ),
}


def tables(sensors: Named) -> Iterator[Table]:
    """Yield the tables of all sensors."""
    for name, sensor in sensors:
        yield _calibration(f'{name}: accelerometer', sensor.accelerometer, 'm/s²')
        if sensor.gyroscope is not None:
            yield _calibration(f'{name}: gyroscope', sensor.gyroscope, '°/s')
        if sensor.rest is not None and sensor.rest.sensitivity:
            yield _sensitivity(name, sensor.rest.sensitivity)
        if sensor.turned:
            yield _turns(name, sensor)
        yield _positions(name, sensor)


def _calibration(title: str, found: Calibration, unit: str) -> Table:
    columns = (
        Column('axis'), Column('bias', unit), Column('scale error', '%'),
        *(Column(f'from {axis}', '°') for axis in AXES),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (axis, found.bias[k], found.scale_error[k],
         *(found.misalignment.get((axis, other)) for other in AXES))
        for k, axis in enumerate(AXES)
    ]  # fmt: skip
    return Table(title, columns, tuple(rows), _NOTES[found.method])


def _sensitivity(name: str, found: dict[tuple[str, str], Estimate]) -> Table:
    columns = (Column('axis'), *(Column(f'to {axis}', 'm°/s/g') for axis in AXES))
    rows: list[tuple[Cell, ...]] = [
        (axis, *(found.get((axis, other)) for other in AXES)) for axis in AXES
    ]
    note = 'What the gyroscope shows of gravity: a turn of the still sensor changes its bias.'
    return Table(f'{name}: gyroscope, sensitivity to acceleration', columns, tuple(rows), note)


def _turns(name: str, sensor: Calibrated) -> Table:
    columns = (Column('turn about'), *(Column(x, '°') for x in AXES), Column('duration', 's'))
    rows: list[tuple[Cell, ...]] = []
    for turn in sensor.turned:
        angles = (round(float(v), 3) for v in np.degrees(turn.measured))
        rows.append((turn.axis, *angles, round(turn.duration_s, 2)))
    note = 'Integral of the angular velocity without its bias, between two still positions.'
    return Table(f'{name}: turns about the vertical', columns, tuple(rows), note)


def _positions(name: str, sensor: Calibrated) -> Table:
    columns = [
        Column('position'), Column('time, s'), Column('up'),
        *(Column(axis, 'm/s²') for axis in AXES), Column('|a| − g', 'mm/s²'),
    ]  # fmt: skip
    columns += [Column('corrected', 'mm/s²')] if sensor.after.size else []
    rows: list[tuple[Cell, ...]] = []
    for index, ((begin, end), held) in enumerate(zip(sensor.spans, sensor.positions, strict=True)):
        row: list[Cell] = [str(index + 1), f'{begin:.1f} to {end:.1f}', face(held.mean) or '–']
        row += [
            Estimate(float(m), float(m - e), float(m + e), 'm/s²')
            for m, e in zip(held.mean, held.error, strict=True)
        ]
        row += [
            Estimate(float(v[index]), float((v - e)[index]), float((v + e)[index]), 'm/s²')
            for v, e in _residuals(sensor)
        ]
        rows.append(tuple(row))
    note = (
        'Size of what was measured less gravity, as it is and after the correction; intervals are '
        'those of the means.'
    )
    return Table(f'{name}: still positions', tuple(columns), tuple(rows), note)


def _residuals(sensor: Calibrated) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield |a| − g at every position and half its interval: as measured, and corrected."""
    yield sensor.before, sensor.before_error
    if sensor.after.size:
        yield sensor.after, sensor.after_error


def figures(sensors: Named) -> Iterator[Figure]:
    """Yield the size of gravity at every position, before and after the correction."""
    for name, sensor in sensors:
        places = np.arange(len(sensor.positions), dtype=np.float64)
        series = [
            Series(label, places, 1e3 * v, 1e3 * (v - e), 1e3 * (v + e), 'bars')
            for label, (v, e) in zip(
                ('as measured', 'corrected'), _residuals(sensor), strict=False
            )
        ]
        labels = tuple(
            f'{index + 1} {face(held.mean) or ""}'.strip()
            for index, held in enumerate(sensor.positions)
        )
        yield Figure(
            f'{name}: |a| − g at every position', 'position', '|a| − g in mm/s²',
            tuple(series), categories=labels,
        )  # fmt: skip
        if sensor.after.size:
            yield Figure(
                f'{name}: what the correction leaves over', 'position', '|a| − g in mm/s²',
                tuple(series[1:]), categories=labels,
            )  # fmt: skip


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
    """Return the text of a ROS parameter file."""
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
