# SPDX-License-Identifier: Apache-2.0
"""
Inclination: a tilt table in steps, each sensor's angle against the one that was set.

The test of section 4.2.2 of the MSc thesis on two MEMS inclinometers for antenna masts (SCL3300,
IIM-42652), tables 3 and 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from imu_bench.config.schema import parse_quantity, Setting
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.metrology.trials.inclination import ANGLES, Turn
from imu_bench.offline.health import Finding
from imu_bench.offline.notation import number, text
from imu_bench.offline.plans.inclination import measuring as tilt
from imu_bench.offline.plans.inclination.comparing import DEGREE, judge, Judged, multiples
from imu_bench.offline.plans.inclination.presenting import figures, tables
from imu_bench.offline.plans.plan import named, Plan, rate_of
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.recordings import Recording

AUTO = 'auto'

_SOON_S = 1.0
"""Averaging time of the smallest step in the summary."""

_ON_CHIP_LSB = 90.0 / 2**14 / DEGREE
"""rad; step of the SCL3300's angle outputs (Doc 4921 rev. 2): a disagreement below is rounding."""


class Inclination(Plan[tuple[tilt.Tilted, ...]]):
    """Angles from gravity on a tilt table."""

    name = 'inclination'
    title = 'Inclination on a tilt table'
    document = (
        'the MSc thesis on two MEMS inclinometers for antenna masts (SCL3300, IIM-42652), '
        'section 4.2.2'
    )
    SETTINGS = (
        Setting('angles', (), 'Set angles in their order, ° unless a unit is given.'),
        Setting(
            'step', None, 'Step of the table: set angles are its multiples.', (),
            (1e-9, 1.6), 'rad', 'quantity',
        ),
        Setting('axis', AUTO, 'Angle that is raised.', (AUTO, *ANGLES)),
        Setting('times', (), 'Begin and end of every step in s, as 0-20,23-43.'),
        Setting(
            'dwell', (5.0,), 'Shortest time at one angle.', (), (0.1, 1e6), 's', 'quantity'
        ),
        Setting(
            'settle', (1.0,), 'Time left out around every move.', (), (0.0, 1e4), 's', 'quantity'
        ),
        Setting('probability', 0.95, 'With which a step is found.', bounds=(0.51, 0.9999)),
    )  # fmt: skip

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given_angles = self._angles()
        self._given_spans = self._spans()

    def measure(self, source: str, recordings: Sequence[Recording]) -> tuple[tilt.Tilted, ...]:
        """Return what every accelerometer of a recording shows at each step."""
        spans: Sequence[tuple[float, float]] = self._given_spans
        usable = [r for r in recordings if r.samples.acceleration is not None]
        if not usable:
            raise RecordingError(f'{source}: no sensor of it has an accelerometer')
        start_ns = int(recordings[0].samples.stamps[0])
        axes = {r.topic: self.settings['axis'] for r in usable}
        if not spans or AUTO in axes.values():
            spans = self._found(usable, axes, start_ns, spans)
        return tuple(
            tilt.measure(r, axes[r.topic], spans, start_ns, self.confidence) for r in usable
        )

    def _found(
        self,
        usable: Sequence[Recording],
        axes: dict[str, str],
        start_ns: int,
        spans: Sequence[tuple[float, float]],
    ) -> Sequence[tuple[float, float]]:
        """Return the steps of the sensor that shows them best; choose axes not given."""
        best: Sequence[tuple[float, float]] = spans
        contrast = -1.0
        problems = []
        dwell, settle = self.settings['dwell'][0], self.settings['settle'][0]
        for recording in usable:
            try:
                if axes[recording.topic] == AUTO:
                    axis, stands = tilt.choose_axis(recording, dwell, settle)
                else:
                    axis = axes[recording.topic]
                    stands = tilt.find(recording, axis, dwell, settle)
            except RecordingError as problem:
                problems.append(problem)
                continue
            axes[recording.topic] = axis
            if not spans and len(stands.stands) > 1 and stands.contrast > contrast:
                since = 1e-9 * (int(recording.samples.stamps[0]) - start_ns)
                period = 1.0 / rate_of(recording)
                contrast = stands.contrast
                best = [
                    (since + stand.begin * period, since + stand.end * period)
                    for stand in stands.stands
                ]
        if not best:
            if problems:
                raise problems[0]
            raise RecordingError(
                f'{usable[0].source}: no steps found in the angle of {self.settings["axis"]}; '
                'choose another --set axis, or give the times with --set times=0-20,23-43,…'
            )
        # a sensor that does not show the steps is asked about the axis of the others
        chosen = next((axis for axis in axes.values() if axis != AUTO), 'x')
        axes.update({topic: chosen for topic, axis in axes.items() if axis == AUTO})
        return best

    def _spans(self) -> list[tuple[float, float]]:
        spans = []
        for part in self.settings['times']:
            begin, _, end = part.partition('-')
            try:
                span = float(begin), float(end)
            except ValueError:
                raise ConfigError(
                    f'--set times: {part!r} is no begin and end in s; write 0-20,23-43'
                ) from None
            if not 0.0 <= span[0] < span[1]:
                raise ConfigError(f'--set times: {part!r} does not end after it begins')
            spans.append(span)
        for before, after in pairwise(spans):
            if after[0] < before[1]:
                raise ConfigError(
                    f'--set times: {after[0]:g}-{after[1]:g} begins before the one before ends'
                )
        return spans

    def _angles(self) -> list[float]:
        """Return the set angles in rad."""
        found = [_angle(part) for part in self.settings['angles']]
        if found and self.settings['step'] is not None:
            raise ConfigError('--set angles and --set step say the same: give one of them')
        return found

    def conclude(self, measured: Sequence[tuple[tilt.Tilted, ...]]) -> PlanResult:
        """Return the errors of all sensors."""
        sensors = named([one for part in measured for one in part], self.reference)
        wanted = {name: tuple(self._given_angles) for name, _ in sensors}
        if self.settings['step'] is not None:
            for source in {tilted.source for _, tilted in sensors}:
                here = [pair for pair in sensors if pair[1].source == source]
                wanted |= multiples(here, self.settings['step'][0])
        probability = self.settings['probability']
        judged = [
            judge(name, tilted, wanted[name], probability, self.confidence)
            for name, tilted in sensors
        ]
        return PlanResult(
            self.name,
            self.title,
            tuple(line for sensor in judged for line in _summary(sensor, probability)),
            tuple(tables(judged, probability)),
            tuple(figures(judged)),
            tuple(_findings(judged)),
            {sensor.name: sensor.to_json() for sensor in judged},
        )


def _angle(given: str) -> float:
    """Return one set angle in rad; a number alone is in degrees."""
    try:
        return parse_quantity(given if ' ' in given.strip() else f'{given} °', 'rad')
    except ConfigError as error:
        raise ConfigError(f'--set angles: {error}') from error


def _summary(sensor: Judged, probability: float) -> list[str]:
    count, axis = len(sensor.tilted.steps), sensor.tilted.axis
    lines = []
    if sensor.statistics is not None:
        rest = max(abs(e.value or 0.0) for e in sensor.compensated)
        lines.append(
            f'{sensor.name}: over {count} angles of {axis} the error is '
            f'{text(sensor.statistics.mean, "°")} in the mean, the largest '
            f'{sensor.statistics.largest * DEGREE:.4f} °; without the offset of the first angle '
            f'the largest is {rest * DEGREE:.4f} °.'
        )
    if sensor.turns:
        lines.append(f'{sensor.name}: {_hysteresis(sensor.turns)}')
    if sensor.detectable:
        tau, smallest = min(sensor.detectable, key=lambda pair: abs(pair[0] - _SOON_S))
        lines.append(
            f'{sensor.name}: a step of {text(smallest, "°")} is found with '
            f'{100 * probability:g} % after averaging for {tau:.2g} s.'
        )
    return lines


def _hysteresis(turns: Sequence[Turn]) -> str:
    """Return the largest that is not zero within its interval, or the bound of all."""
    ends = [(turn, turn.hysteresis.low or 0.0, turn.hysteresis.high or 0.0) for turn in turns]
    seen = [(turn, high) for turn, low, high in ends if low > 0.0 or high < 0.0]
    if not seen:
        bound = max(max(-low, high) for _, low, high in ends)
        return f'no hysteresis is seen; it is below {number(bound * DEGREE, 2)} °.'
    worst, high = max(seen, key=lambda pair: abs(pair[0].hysteresis.value or 0.0))
    found, way = worst.hysteresis, 'more'
    if high < 0.0:  # its size, and its sign in words
        found, way = found.scaled(-1.0, found.unit), 'less'
    return (
        f'hysteresis up to {text(found, "°")}, at {worst.angle * DEGREE:.4g} °: reached from '
        f'above it shows {way}.'
    )


def _findings(sensors: Sequence[Judged]) -> list[Finding]:
    found = []
    if not any(sensor.wanted for sensor in sensors):
        text_ = 'The angles that were set are not known.'
        effect = 'Errors, scale and hysteresis cannot be given.'
        action = 'Name them: --set angles=0,0.58139,… or --set "step=0.58139 °".'
        found.append(Finding('info', 'no_set_angles', text_, effect, action))
    for sensor in sensors:
        apart = [s.disagreement.value for s in sensor.tilted.steps if s.disagreement is not None]
        worst = max((abs(value or 0.0) for value in apart), default=0.0)
        if worst > 2.0 * _ON_CHIP_LSB:
            text_ = (
                f"{sensor.name}: the chip's own angle is up to {worst * DEGREE:.4f}° from that of "
                'its acceleration.'
            )
            action = 'Check the mode of the sensor, and that no offset is taken off one only.'
            effect = 'One of the two is wrong.'
            found.append(Finding('warning', 'on_chip_disagrees', text_, effect, action))
    return found
