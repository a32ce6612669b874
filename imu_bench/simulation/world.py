# SPDX-License-Identifier: Apache-2.0
"""From a sensor's configuration to its simulated world: motion, errors, samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from zlib import crc32

from imu_bench.config import SensorConfig
from imu_bench.registers import Typical
from imu_bench.simulation.chip import SensorSource
from imu_bench.simulation.scenario import Motion, Sine, Still, Sum
from imu_bench.simulation.sensor_model import ErrorModel, Errors, QUANTITIES
import numpy as np

_TAKEN_OVER = ('noise_density', 'bias_instability')
_TOLERANCES = {'bias': 'bias', 'scale_error': 'scale_factor'}
"""Limits in a datasheet: a sensor lies anywhere between them, and where is drawn."""


def motion_of(config: SensorConfig) -> Motion:
    """
    Return how the bench moves; every sensor of a bench given the same settings moves alike.

    Examples
    --------
    >>> motion_of(SensorConfig('a', 'generic', 'emulated')).temperature(np.zeros(1))
    array([25.])
    """
    given = config.simulation
    still = Still(
        roll=_number(given, 'roll', 0.0),
        pitch=_number(given, 'pitch', 0.0),
        temperature_c=_number(given, 'temperature', 25.0),
    )
    if given.get('scenario', 'still') == 'still':
        return still
    sine = Sine(
        amplitude=_number(given, 'sine.amplitude', 1.0),
        frequency_hz=_number(given, 'sine.frequency', 10.0),
        axis=given.get('sine.axis', 'z'),
    )
    return Sum((still, sine))


def errors_of(config: SensorConfig, typical: Mapping[str, Typical]) -> dict[str, Errors]:
    """
    Return the errors of a sensor: typical values of its document, replaced by those given.

    A limit of the document, such as a zero offset of ±60 mg, becomes a constant
    of this sensor, drawn per axis between the limits from its seed.

    Parameters
    ----------
    config : SensorConfig
    typical : mapping of str to Typical
        As the driver declares it; empty for a generic source, which has what the
        configuration speaks of.
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
        drawn = {name: rng.uniform(-1.0, 1.0, 3) for name in _TOLERANCES}
        if quantity in typical:
            given = {**_typical_errors(typical[quantity], drawn), **given}
        elif not given:
            continue
        errors[quantity] = Errors(**given)
    return errors


def sensor_source(
    config: SensorConfig,
    typical: Mapping[str, Typical],
    nominal_hz: float,
    start_ns: int,
    quantities: tuple[str, ...] = QUANTITIES,
) -> SensorSource:
    """
    Return the sampling core of an emulated sensor.

    Parameters
    ----------
    config : SensorConfig
    typical : mapping of str to Typical
    nominal_hz : float
    start_ns : int
    quantities : tuple of str
        Those wanted; a chip whose dies sample at different rates has a source for each.

    Notes
    -----
    The seed of a sensor comes from `simulation.seed` and its name, so that
    sensors of one bench are independent, and each is the same in every run.
    """
    errors = errors_of(config, typical)
    wanted = {quantity: errors[quantity] for quantity in quantities if quantity in errors}
    return SensorSource(
        motion_of(config),
        ErrorModel(wanted, _seed(config)),
        nominal_hz,
        rate_error=_number(config.simulation, 'rate_error', 0.0),
        start_ns=start_ns,
    )


def _seed(config: SensorConfig) -> np.random.SeedSequence:
    return np.random.SeedSequence([config.simulation.get('seed', 0), crc32(config.name.encode())])


def _number(given: Mapping[str, Any], name: str, default: float) -> float:
    return float(given.get(name, (default,))[0])


def _typical_errors(typical: Typical, drawn: Mapping[str, Any]) -> dict[str, Any]:
    found = {
        name: getattr(typical, name) for name in _TAKEN_OVER if getattr(typical, name) is not None
    }
    for name, becomes in _TOLERANCES.items():
        limit = getattr(typical, name)
        if limit is not None:
            found[becomes] = drawn[name] * np.asarray(limit)
    return found
