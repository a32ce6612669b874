# SPDX-License-Identifier: Apache-2.0
"""
Six-position calibration: bias, scale and misalignment of an accelerometer and a gyroscope.

The sensor lies still on its six faces, or in a dozen and more positions of any kind; for the
scale of the gyroscope it is turned by a known angle about the vertical between two of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from imu_bench.config.schema import Setting
from imu_bench.errors import os_error_text, RecordingError
from imu_bench.metrology.trials import six_position
from imu_bench.metrology.trials.six_position import Calibration
from imu_bench.offline.health import Finding
from imu_bench.offline.notation import text
from imu_bench.offline.plans.plan import named, Plan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.plans.six_position.measuring import (
    calibrate,
    Calibrated,
    Choice,
    LARGE,
    lay,
    METHODS,
    StillPositions,
    together,
)
from imu_bench.offline.plans.six_position.presenting import figures, parameters, tables
from imu_bench.offline.recordings import Recording
from imu_bench.offline.whole_files import write_text
from imu_bench.units import DEGREE, STANDARD_GRAVITY
import numpy as np

FACE = 10.0 * DEGREE
"""How far a housing leans on its face at most: twice of what a case that is not square does."""


class SixPosition(Plan[tuple[StillPositions, ...]]):
    """Calibration from still positions and turns."""

    name = 'six-position'
    title = 'Calibration from still positions'
    SETTINGS = (
        Setting('method', 'auto', 'Six faces, or only the size of gravity.', METHODS),
        Setting(
            'gravity', (STANDARD_GRAVITY,), 'Gravity at the place of the test.', (),
            (9.7, 9.9), 'm/s²', 'quantity',
        ),
        Setting(
            'shortest', (1.0,), 'Shortest position.', (), (0.5, 3600.0), 's', 'quantity'
        ),
        Setting(
            'turn', (360.0 * DEGREE,), 'Angle of one turn about the vertical.', (),
            (45.0 * DEGREE, 7200.0 * DEGREE), 'rad', 'quantity',
        ),
        Setting(
            'turn_error', (1.0 * DEGREE,), 'Standard uncertainty of that angle.', (),
            (0.0, 45.0 * DEGREE), 'rad', 'quantity',
        ),
        Setting('yaml', '', 'File for the correction, as parameters of a sensor node.'),
    )  # fmt: skip

    @property
    def _choice(self) -> Choice:
        return Choice(
            self.settings['method'], self.settings['gravity'][0], self.settings['shortest'][0],
            self.settings['turn'][0], self.settings['turn_error'][0], self.confidence,
        )  # fmt: skip

    def measure(self, source: str, recordings: Sequence[Recording]) -> tuple[StillPositions, ...]:
        """Return the positions of every sensor of a recording with an accelerometer."""
        usable = [
            r
            for r in recordings
            if r.samples.acceleration is not None or r.samples.angular_velocity is not None
        ]
        if not usable:
            raise RecordingError(f'{source}: no sensor of it has an accelerometer')
        return tuple(lay(recording, self._choice) for recording in usable)

    def conclude(self, measured: Sequence[tuple[StillPositions, ...]]) -> PlanResult:
        """Return the calibrations of all sensors; write the YAML."""
        laid = together([one for part in measured for one in part], self._choice)
        sensors = named([calibrate(one, self._choice) for one in laid], self.reference)
        summary = [line for name, one in sensors for line in _summary(name, one)]
        if self.settings['yaml']:
            summary.append(self._written(sensors))
        return PlanResult(
            self.name,
            self.title,
            tuple(summary),
            tuple(tables(sensors)),
            tuple(figures(sensors)),
            tuple(finding for name, one in sensors for finding in _findings(name, one, self)),
            {name: one.to_json() for name, one in sensors},
        )

    def _written(self, sensors: Sequence[tuple[str, Calibrated]]) -> str:
        """Write the YAML of the only sensor, or of the reference, and say so."""
        chosen = [one for name, one in sensors if name == self.reference]
        chosen = chosen or [one for _, one in sensors]
        if len(chosen) > 1:
            names = ', '.join(name for name, _ in sensors)
            raise RecordingError(
                f'--set yaml: a file holds one sensor, here are {names}: choose with --reference'
            )
        path = Path(self.settings['yaml'])
        try:
            write_text(path, parameters(chosen[0]))
        except OSError as error:
            raise RecordingError(f'--set yaml: {os_error_text(error)}') from error
        return f'The correction of {chosen[0].topic} is in {path}.'


def _summary(name: str, sensor: Calibrated) -> Iterator[str]:
    found = sensor.accelerometer
    count = len(sensor.positions)
    before = float(np.sqrt(np.mean(sensor.before**2)))
    if sensor.after.size:
        after = float(np.sqrt(np.mean(sensor.after**2)))
        yield (
            f'{name}: over {count} still positions the size of gravity is off by '
            f'{1e3 * before:.3g} mm/s² as measured, by {1e3 * after:.3g} mm/s² corrected.'
        )
    biases = ', '.join(
        f'{axis} {text(bias)}' for axis, bias in zip('xyz', found.bias, strict=True)
    )
    scales = ', '.join(
        f'{axis} {text(scale, "%")}' for axis, scale in zip('xyz', found.scale_error, strict=True)
    )
    yield f'{name}: accelerometer bias {biases}; scale error {scales}.'
    if sensor.gyroscope is not None:
        rates = ', '.join(
            f'{axis} {text(bias, "°/s")}'
            for axis, bias in zip('xyz', sensor.gyroscope.bias, strict=True)
        )
        yield f'{name}: gyroscope bias {rates}; {_turned(sensor.gyroscope)}.'


def _turned(gyroscope: Calibration) -> str:
    """Say what the turns tell about the scale of a gyroscope."""
    scales = list(zip('xyz', gyroscope.scale_error, strict=True))
    known = [f'{axis} {text(scale, "%")}' for axis, scale in scales if scale.observable]
    return f'scale error {", ".join(known)}' if known else 'scale not known, for it was not turned'


def _findings(name: str, sensor: Calibrated, plan: SixPosition) -> Iterator[Finding]:
    missing = [bias.reason for bias in sensor.accelerometer.bias if not bias.observable]
    if missing:
        yield Finding(
            'warning', 'positions_missing', f'{name}: {"; ".join(missing)}.',
            'Bias and scale of those axes cannot be told apart; no correction is made.',
            'Lay the sensor on these faces, too.',
        )  # fmt: skip
    if sensor.gyroscope is not None and sensor.gyroscope.matrix is None:
        scales = zip('xyz', sensor.gyroscope.scale_error, strict=True)
        absent = [axis for axis, scale in scales if not scale.observable]
        these = '' if len(absent) == len(sensor.gyroscope.scale_error) else ' about these axes'
        angle = np.degrees(plan.settings['turn'][0])
        yield Finding(
            'info', 'turns_missing',
            f'{name}: no turn about {", ".join(absent)} by a multiple of {angle:g}° '
            'between still positions.',
            f'The bias of the gyroscope is known, its scale and misalignment{these} are not.',
            'Turn the sensor about the vertical on each face; for another angle, --set turn.',
        )  # fmt: skip
    limit = LARGE * plan.settings['gravity'][0]
    if sensor.after.size and float(np.abs(sensor.after).max()) > limit:
        worst = int(np.argmax(np.abs(sensor.after)))
        leans = max(six_position.lean(held.mean) for held in sensor.positions)
        no_faces = sensor.accelerometer.method == 'faces' and leans > FACE
        yield Finding(
            'severe' if no_faces else 'warning',
            'no_faces' if no_faces else 'large_residual',
            f'{name}: at position {worst + 1} gravity is still off by '
            f'{float(sensor.after[worst]):.3f} m/s²'
            + (
                f'; the positions lean up to {np.degrees(leans):.0f}° from those of six faces.'
                if no_faces
                else '.'
            ),
            'The numbers are those of another arrangement than the one taken: use none of them.'
            if no_faces
            else 'The sensor moved there, or is not linear.',
            f'Take {six_position.FEWEST_POSITIONS} positions or more of any kind '
            '(--set method=norm), or put the housing on its faces.'
            if no_faces
            else 'Repeat the test; lay it still for longer.',
        )
