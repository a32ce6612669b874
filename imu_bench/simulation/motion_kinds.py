# SPDX-License-Identifier: Apache-2.0
"""The kinds of motion a scenario file may name: their settings, and how each is made."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from imu_bench.config import REQUIRED, Setting
from imu_bench.errors import ConfigError
from imu_bench.simulation.lift import LiftRide
from imu_bench.simulation.motion import along, Motion, Part, Seed, Still, Sum
from imu_bench.simulation.random_vibration import RandomVibration
from imu_bench.simulation.sensor_errors import Array
from imu_bench.simulation.tilt_table import TiltSteps
from imu_bench.simulation.tones import engine, mains_hum, Sine, SteppedSine, Sweep
from msg_conversions.quantities import AXES
import numpy as np

_POSITIVE = (0.0, inf)
_DENSITY = '(m/s²)²/Hz'


@dataclass(frozen=True)
class Given:
    """Checked settings of one motion, and where it is to happen."""

    values: Mapping[str, Any]  # quantities are tuples in SI units
    base: Still  # the bench without the motion
    seed: Seed

    def number(self, name: str) -> float:
        """Return a quantity that has one value."""
        values = self.values[name]
        if len(values) != 1:
            raise ConfigError(f'{name}: {len(values)} values are given; give one')
        return float(values[0])

    def three(self, name: str) -> tuple[float, float, float]:
        """Return a quantity along x, y and z; a single value holds for all."""
        x, y, z = np.broadcast_to(self.values[name], (3,)).tolist()
        return x, y, z

    def word(self, name: str) -> Any:
        """Return a text, an integer, or true or false."""
        return self.values[name]


@dataclass(frozen=True)
class Kind:
    """A kind of motion."""

    settings: tuple[Setting, ...]
    make: Callable[[Given], Motion]
    zoned: bool = False  # whether it can be confined to zones of the scenario
    anew: bool = True  # whether it then begins anew in each


def _q(
    name: str,
    default: Any,
    unit: str,
    description: str,
    bounds: tuple[float, float] | None = _POSITIVE,
) -> Setting:
    """Return the setting of a quantity; defaults are in SI units."""
    known = default if default is REQUIRED or isinstance(default, tuple) else (default,)
    return Setting(name, known, description, (), bounds, unit, 'quantity')


def _axis(*allowed: str) -> Setting:
    return Setting('axis', '', "Axis; the scenario's by default.", ('', *allowed))


def _sine(given: Given) -> Motion:
    return Sine(
        given.number('amplitude'),
        given.number('frequency'),
        given.word('axis'),
        given.number('phase'),
    )


def _sweep(given: Given) -> Motion:
    return Sweep(
        given.number('amplitude'),
        given.number('low'),
        given.number('high'),
        given.number('rate'),
        given.word('axis'),
        given.word('returns'),
    )


def _stepped_sine(given: Given) -> Motion:
    return SteppedSine(
        given.number('amplitude'),
        given.number('low'),
        given.number('high'),
        given.number('step'),
        given.number('hold'),
        given.word('axis'),
    )


def _random(given: Given) -> Motion:
    axes = np.sum([along(axis) for axis in given.word('axis')], axis=0)
    density = axes * np.array(given.three('density'))
    return RandomVibration(
        density.tolist(), given.number('low'), given.number('high'), seed=given.seed
    )


def _engine(given: Given) -> Motion:
    tones = engine(
        given.number('speed'),
        given.word('cylinders'),
        given.three('firing'),
        given.three('valves'),
        unbalance=given.number('unbalance'),
        decay=given.number('decay'),
        harmonics=given.word('harmonics'),
        rocking=given.number('rocking'),
        wander=given.number('wander'),
        wander_period_s=given.number('wander_period'),
        seed=given.seed,
    )
    density = given.three('random_density')
    if not any(density):
        return tones
    band = (given.number('random_low'), given.number('random_high'))
    return Sum((tones, RandomVibration(density, *band, seed=given.seed, name='engine')))


def _lift(given: Given) -> Motion:
    return LiftRide(
        given.number('distance'),
        given.number('speed'),
        given.number('acceleration'),
        given.number('jerk'),
        wait_s=given.number('wait'),
        door_thud=given.number('door_thud'),
        guide_vibration=given.number('guide_vibration'),
        rail_length=given.number('rail_length'),
        joint_thud=given.number('joint_thud'),
        seed=given.seed,
    )


def _tilt(given: Given) -> Motion:
    return TiltSteps(
        given.base,
        given.number('step'),
        given.word('steps'),
        given.word('returns'),
        given.number('dwell'),
        given.number('move'),
        given.word('axis'),
        given.number('knob_error'),
        given.number('tremor'),
        given.seed,
    )


def _ramp(given: Given) -> Motion:
    return TemperatureRamp(
        given.number('begin'),
        given.base.temperature_c,
        given.number('to'),
        given.number('rate'),
        given.number('soak'),
        given.word('returns'),
    )


def _hum(given: Given) -> Motion:
    return mains_hum(given.number('frequency'), given.three('amplitude'), given.number('third'))


KINDS: Mapping[str, Kind] = {
    'sine': Kind(
        (
            _q('amplitude', REQUIRED, 'm/s²', 'Peak.'),
            _q('frequency', REQUIRED, 'Hz', 'It may lie above half the rate of a sensor.'),
            _q('phase', 0.0, 'rad', 'Phase at the beginning.', None),
            _axis(*AXES),
        ),
        _sine,
        zoned=True,
    ),
    'sweep': Kind(
        (
            _q('amplitude', REQUIRED, 'm/s²', 'Peak, the same at every frequency.'),
            _q('low', REQUIRED, 'Hz', 'Where the sweep begins.'),
            _q('high', REQUIRED, 'Hz', 'Where it turns.'),
            _q('rate', REQUIRED, 'oct/s', 'Sweep rate.'),
            Setting('returns', True, 'Sweeps down again; otherwise begins anew.'),
            _axis(*AXES),
        ),
        _sweep,
        zoned=True,
    ),
    'stepped_sine': Kind(
        (
            _q('amplitude', REQUIRED, 'm/s²', 'Peak, the same at every frequency.'),
            _q('low', REQUIRED, 'Hz', 'First frequency.'),
            _q('high', REQUIRED, 'Hz', 'None is above it.'),
            _q('step', REQUIRED, 'Hz', 'Between two frequencies.'),
            _q('hold', REQUIRED, 's', 'How long each is held.'),
            _axis(*AXES),
        ),
        _stepped_sine,
        zoned=True,
    ),
    'random': Kind(
        (
            _q('density', REQUIRED, _DENSITY, 'Acceleration spectral density, one-sided.'),
            _q('low', REQUIRED, 'Hz', 'Lower end of the band.'),
            _q('high', REQUIRED, 'Hz', 'Upper end of the band.'),
            _axis(*AXES, 'xyz'),
        ),
        _random,
        zoned=True,
        anew=False,
    ),
    'engine_idle': Kind(
        (
            _q('speed', 800.0 / 60.0, 'Hz', 'Speed of the crank shaft, such as 800 rpm.'),
            Setting('cylinders', 4, 'Of a four-stroke engine.', bounds=(1, 24)),
            _q('firing', REQUIRED, 'm/s²', 'Peak at the firing frequency.'),
            _q('valves', REQUIRED, 'm/s²', 'Peak at twice the firing frequency.'),
            _q('unbalance', 0.0, '1', 'Peak at the speed itself over that of the firing.'),
            _q('decay', 0.5, '1', 'Peak of a higher harmonic over the one before.'),
            Setting('harmonics', 8, 'Harmonics of the firing frequency.', bounds=(2, 100)),
            _q('rocking', 0.0, 'rad/s', 'Peak turning about x at the firing frequency.'),
            _q('wander', 0.0, '1', 'Peak relative change of the speed.', (0.0, 0.5)),
            _q('wander_period', 10.0, 's', 'Period of that change.', (1e-3, inf)),
            _q('random_density', 0.0, _DENSITY, 'Acceleration spectral density, one-sided.'),
            _q('random_low', 5.0, 'Hz', 'Lower end of the random part.'),
            _q('random_high', 500.0, 'Hz', 'Upper end of the random part.'),
        ),
        _engine,
        zoned=True,
        anew=False,
    ),
    'lift_ride': Kind(
        (
            _q('distance', REQUIRED, 'm', 'Way up, negative for down.', None),
            _q('speed', 1.0, 'm/s', 'Limit.'),
            _q('acceleration', 0.8, 'm/s²', 'Limit.'),
            _q('jerk', 1.0, 'm/s³', 'Limit.'),
            _q('wait', 20.0, 's', 'Time before the start and after the stop.'),
            _q('door_thud', 0.0, 'm/s²', 'Peak when the doors close and open.'),
            _q('guide_vibration', 0.0, _DENSITY, 'Across the rails at full speed, 2 to 30 Hz.'),
            _q('rail_length', 5.0, 'm', 'From joint to joint.'),
            _q('joint_thud', 0.0, 'm/s²', 'Peak at a joint.'),
        ),
        _lift,
    ),
    'tilt_steps': Kind(
        (
            _q('step', REQUIRED, 'rad', 'Angle of one step.', None),
            Setting('steps', 6, 'Steps away from zero.', bounds=(1, 1000)),
            Setting('returns', True, 'Goes back to zero by the same steps.'),
            _q('dwell', 60.0, 's', 'Time at each angle.'),
            _q('move', 3.0, 's', 'Time from one angle to the next.'),
            _q('knob_error', 0.0, 'rad', 'σ of an angle set by hand; 0 for a motor.'),
            _q('tremor', 0.0, _DENSITY, 'Of the hand on the knob, 2 to 15 Hz.'),
            _axis('x', 'y'),
        ),
        _tilt,
    ),
    'temperature_ramp': Kind(
        (
            _q('begin', 0.0, 's', 'When it begins.'),
            _q('to', REQUIRED, '°C', 'Where it leads.', None),
            _q('rate', REQUIRED, 'K/s', 'Steepness.'),
            _q('soak', 0.0, 's', 'Time there.'),
            Setting('returns', True, 'Goes back as steeply after that.'),
        ),
        _ramp,
    ),
    'mains_hum': Kind(
        (
            _q('frequency', 50.0, 'Hz', 'Of the mains.'),
            _q('amplitude', REQUIRED, 'm/s²', 'Peak along each axis.'),
            _q('third', 0.0, '1', 'Third harmonic over the first.'),
        ),
        _hum,
        zoned=True,
        anew=False,
    ),
}
"""Every kind of motion by its name in a scenario file."""


@dataclass(frozen=True)
class TemperatureRamp(Part):
    """What an oven adds to the temperature of the bench."""

    begin_s: float  # when the ramp begins
    # start_c, to_c: temperature before, and at the end of the ramp, °C
    start_c: float
    to_c: float
    kelvin_per_s: float  # steepness, without sign
    soak_s: float = 0.0  # time at the end of the ramp
    returns: bool = True  # whether it goes back after that, as steeply

    def __post_init__(self) -> None:
        if self.to_c == self.start_c or not self.kelvin_per_s > 0.0:
            raise ConfigError(
                f'temperature_ramp: from {self.start_c:g} °C to {self.to_c:g} °C at '
                f'{60 * self.kelvin_per_s:g} K/min is none; it must lead to another temperature'
            )

    @property
    def _corners(self) -> tuple[list[float], list[float]]:
        """Times, and how much warmer it is."""
        change = self.to_c - self.start_c
        up = self.begin_s + abs(change) / self.kelvin_per_s
        times, changes = [self.begin_s, up, up + self.soak_s], [0.0, change, change]
        if self.returns:
            times.append(times[-1] + up - self.begin_s)
            changes.append(0.0)
        return times, changes

    @property
    def duration_s(self) -> float | None:
        """Until the last corner."""
        return self._corners[0][-1]

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """The corners of the profile."""
        return [
            {'begin_s': time, 'temperature': {'value': self.start_c + change, 'unit': '°C'}}
            for time, change in zip(*self._corners, strict=True)
        ]

    def temperature(self, t: Array) -> Array:
        """Return how much warmer it is, K, shape (n,)."""
        return np.interp(t, *self._corners)
