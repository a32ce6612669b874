# SPDX-License-Identifier: Apache-2.0
"""From a sensor's configuration to its simulated world: motion, errors, samples, typical noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TYPE_CHECKING
from zlib import crc32

from imu_bench.config import SensorConfig
from imu_bench.config.beginning import Beginning
from imu_bench.errors import ConfigError
from imu_bench.registers import Field, Fifo, Typical
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.motion import attitude, Changed, Motion, Mounted
from imu_bench.simulation.scenario import load_scenario, Scenario
from imu_bench.simulation.sensor_errors import Array, Errors
from imu_bench.simulation.sensor_model import ErrorModel, QUANTITIES
from imu_bench.units import convert
from msg_conversions.quantities import AXES
import numpy as np

if TYPE_CHECKING:
    from imu_bench.drivers.driver import Driver


@dataclass(frozen=True, eq=False)
class Later(Changed):
    """A still bench that begins to move at some time."""

    still: Motion  # the bench before that
    switched_on_ns: int  # Unix time from which the times given to this motion count
    beginning: Beginning

    def specific_force(self, t: Array) -> Array:
        """Return m/s²."""
        return self._of(t, self.still.specific_force, self.motion.specific_force)

    def angular_velocity(self, t: Array) -> Array:
        """Return rad/s."""
        return self._of(t, self.still.angular_velocity, self.motion.angular_velocity)

    def magnetic_field(self, t: Array) -> Array:
        """Return T."""
        return self._of(t, self.still.magnetic_field, self.motion.magnetic_field)

    def temperature(self, t: Array) -> Array:
        """Return °C."""
        return self._of(t, self.still.temperature, self.motion.temperature)

    def _of(
        self, t: Array, before: Callable[[Array], Array], after: Callable[[Array], Array]
    ) -> Array:
        since = t + (self.switched_on_ns * 1e-9 - self.beginning.at_s)
        begun = since >= 0.0
        if not begun.any():
            return before(t)
        moved = after(np.maximum(since, 0.0))
        if begun.all():
            return moved
        mask = begun if moved.ndim == 1 else begun[:, None]
        return np.asarray(np.where(mask, moved, before(t)))


_TAKEN_OVER = {
    'noise_density': 'noise_density',
    'bias_instability': 'bias_instability',
    'high_pass': 'high_pass',
}
_DIGITAL = {'range': 'range', 'resolution': 'resolution', 'bandwidth': 'low_pass'}
"""What the registers of an emulated chip make on the wire, and else the model."""

_TOLERANCES = {
    'bias': 'bias',
    'scale_error': 'scale_factor',
    'bias_per_kelvin': 'temperature_bias',
    'scale_per_kelvin': 'temperature_scale',
}
"""Limits in a datasheet: a sensor lies anywhere between them, and where is drawn."""

_ROWS = ('cross_axis', 'acceleration_bias')


def scenario_of(config: SensorConfig) -> Scenario:
    """Return the scenario that a sensor's file names."""
    return load_scenario(str(config.simulation.get('scenario', 'still')))


def motion_of(config: SensorConfig, scenario: Scenario) -> Motion:
    """Return how a sensor moves: with the bench, tilted on it, and warm."""
    given = config.simulation
    rotation = attitude(_number(given, 'roll', 0.0), _number(given, 'pitch', 0.0))
    heating, warm_up = _number(given, 'self_heating', 0.0), _number(given, 'warm_up', 60.0)
    if not heating and np.array_equal(rotation, np.eye(3)):
        return scenario.motion
    return Mounted(scenario.motion, rotation, heating, warm_up)


def errors_of(
    config: SensorConfig, typical: Mapping[str, Typical], *, on_wire: bool = False
) -> dict[str, Errors]:
    """
    Return the errors of a sensor: typical values of its document, replaced by those given.

    A limit of the document, such as a zero offset of ±60 mg, becomes a constant
    of this sensor, drawn per axis between the limits from its seed.

    Parameters
    ----------
    typical : mapping of str to Typical
        As the driver declares it; empty for a generic source, which has what the
        configuration speaks of.
    on_wire : bool
        Whether an emulated chip filters and quantises, so that the source must not.

    Raises
    ------
    ConfigError
        If an error makes no sense; the text names the quantity.
    """
    rng = np.random.default_rng(_seed(config).spawn(1)[0])
    errors = {}
    for quantity in QUANTITIES:
        prefix = f'{quantity}.'
        given = {
            key.removeprefix(prefix): value
            for key, value in config.simulation.items()
            if key.startswith(prefix)
        }
        # drawn for every quantity, so that none depends on which others there are
        drawn = {name: rng.uniform(-1.0, 1.0, 3) for name in _TOLERANCES}
        drawn['cross_axis'] = rng.uniform(-1.0, 1.0, (3, 3)) * (1.0 - np.eye(3))
        if quantity not in typical and not given:
            continue
        try:
            values = _with_rows(given)
            if quantity in typical:
                values = {**_typical_errors(typical[quantity], drawn, on_wire), **values}
            errors[quantity] = Errors(**values)
        except ConfigError as error:
            raise ConfigError(f'{config.source}.simulation.{quantity}: {error}') from error
    return errors


def sensor_source(
    config: SensorConfig,
    typical: Mapping[str, Typical],
    nominal_hz: float,
    start_ns: int,
    quantities: tuple[str, ...] = QUANTITIES,
    *,
    scenario: Scenario | None = None,
    run: int = 0,
    on_wire: bool = False,
    beginning: Beginning | None = None,
) -> SensorSource:
    """
    Return the sampling core of an emulated sensor.

    Parameters
    ----------
    typical : mapping of str to Typical
        By quantity, as the driver is set.
    quantities : tuple of str
        Those wanted; a chip whose dies sample at different rates has a source for each.
    scenario : Scenario, optional
        How the bench moves; what the sensor's file says by default.
    run : int
        Another run gives other noise and another turn-on bias of the same sensor.
    on_wire : bool
        Whether an emulated chip filters and quantises what the source makes.
    beginning : Beginning, optional
        When the scenario of the sensor's file begins; as the file says by default.

    Raises
    ------
    ConfigError
        If there is no such scenario, or an error makes no sense.

    Notes
    -----
    The seed of a sensor comes from `simulation.seed` and its name, so that
    sensors of one bench are independent, and each is the same in every run.
    """
    errors = errors_of(config, typical, on_wire=on_wire)
    wanted = {quantity: errors[quantity] for quantity in quantities if quantity in errors}
    if scenario is None:
        scenario = scenario_of(config)
        beginning = beginning or Beginning(config.simulation.get('begin', 0.0))
        if beginning.at_s:
            later = Later(scenario.motion, scenario.still, start_ns, beginning)
            scenario = replace(scenario, motion=later)
    return SensorSource(
        motion_of(config, scenario),
        ErrorModel(wanted, _seed(config, run)),
        nominal_hz,
        rate_error=_number(config.simulation, 'rate_error', 0.0),
        start_ns=start_ns,
    )


def _seed(config: SensorConfig, run: int = 0) -> np.random.SeedSequence:
    numbers = [config.simulation.get('seed', 0), crc32(config.name.encode())]
    return np.random.SeedSequence([*numbers, run] if run else numbers)


def _number(given: Mapping[str, Any], name: str, default: float) -> float:
    return float(given.get(name, (default,))[0])


def _with_rows(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings with the rows of a matrix, 'cross_axis.x' and so on, put together."""
    values = {name: value for name, value in given.items() if '.' not in name}
    for name in _ROWS:
        if any(f'{name}.{axis}' in given for axis in AXES):
            rows = [given.get(f'{name}.{axis}', (0.0, 0.0, 0.0)) for axis in AXES]
            for axis, row in zip(AXES, rows, strict=True):
                if len(row) != len(AXES):
                    raise ConfigError(f'{name}.{axis}: give three values, for true x, y and z')
            values[name] = rows
    return values


def _typical_errors(typical: Typical, drawn: Mapping[str, Any], on_wire: bool) -> dict[str, Any]:
    taken = _TAKEN_OVER if on_wire else {**_TAKEN_OVER, **_DIGITAL}
    found = {
        becomes: getattr(typical, name)
        for name, becomes in taken.items()
        if getattr(typical, name) is not None
    }
    for name, becomes in {**_TOLERANCES, 'cross_axis': 'cross_axis'}.items():
        limit = getattr(typical, name)
        if limit is not None:
            found[becomes] = drawn[name] * np.asarray(limit)
    return found


def as_set(driver: Driver) -> dict[str, Typical]:
    """Return the typical values of a driver, with range, resolution and filter as it is set."""
    found = dict(driver.typical)
    names = {id(field): name for name, field in driver.declared(Field).items()}
    channels = driver.channels().values()
    quantities = [channel.quantity for channel in channels]
    for channel in channels:
        # of a quantity with words of several lengths the document's own values are kept
        if channel.quantity not in found or quantities.count(channel.quantity) > 1:
            continue
        setting = names.get(id(channel.scaled_by), '')
        full_scale = driver.values.get(setting)
        changed: dict[str, Any] = {}
        if channel.quantised:
            changed['resolution'] = tuple(channel.resolution(full_scale))
        if channel.scaled_by is not None and isinstance(full_scale, float):
            changed['range'] = convert(full_scale, channel.scaled_by.unit, channel.unit)
        bandwidth = driver.values.get(setting.replace('_range', '_bandwidth'))
        if setting and isinstance(bandwidth, float) and bandwidth > 0.0:
            changed['bandwidth'] = bandwidth
        found[channel.quantity] = replace(found[channel.quantity], **changed)
    for fifo in driver.declared(Fifo).values():
        for quantity in set(fifo.frame.dtype.names or ()) & set(found):
            corner = fifo.low_pass * driver.rate_hz
            found[quantity] = replace(found[quantity], bandwidth=corner)
    return found
