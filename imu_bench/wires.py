# SPDX-License-Identifier: Apache-2.0
"""Which wire a sensor is on, and with whom it shares it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any, TYPE_CHECKING
from weakref import WeakKeyDictionary

from imu_bench import drivers
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.interface import Clock
from imu_bench.bus.opening import at_addresses, kind_among
from imu_bench.config import SensorConfig
from imu_bench.errors import ConfigError

if TYPE_CHECKING:
    from imu_bench.emulators.line import Wire

_WIRES: WeakKeyDictionary[Any, dict[str, Wire]] = WeakKeyDictionary()
"""Those of emulated sensors that name the same bus, by the clock on which they are busy."""


def kind_of_bus(sensor: SensorConfig) -> str:
    """
    Return by which of its driver's kinds of bus a sensor is reached.

    Raises
    ------
    ConfigError
        If the name of its bus tells none.

    Examples
    --------
    >>> kind_of_bus(SensorConfig('tilt', 'scl3300', 'hardware', bus='spidev0.0'))
    'frame'
    """
    kinds = drivers.load(sensor.driver).bus_kinds
    kind = sensor.bus if sensor.bus in ('', *kinds) else kind_among(sensor.bus, kinds)
    return kind or kinds[0]


def addresses_of(sensor: SensorConfig) -> dict[str, int]:
    """
    Return at which address each die of a sensor answers; nothing on another wire than I²C.

    Raises
    ------
    ConfigError
        If its chip cannot have such an address.

    Examples
    --------
    >>> addresses_of(SensorConfig('a', 'lsm9ds1', 'emulated', 'i2c-1', second_address=0x1E))
    {'': 106, 'magnetometer': 30}
    """
    if kind_of_bus(sensor) != 'i2c':
        return {}
    wiring = drivers.load(sensor.driver).wiring
    try:
        meant = at_addresses(wiring, sensor.address, sensor.second_address)
    except ConfigError as error:
        raise ConfigError(f'{sensor.name}: {error}') from error
    return {
        part: one.i2c_addresses[0]
        for part, one in meant.items()
        if one.i2c_addresses and (not one.only_with or sensor.settings.get(one.only_with))
    }


def wire_of(sensor: SensorConfig) -> str:
    """
    Return the wire a sensor shares with those that name the same bus; '' for one of its own.

    Examples
    --------
    >>> wire_of(SensorConfig('a', 'mpu9250', 'emulated', bus='/dev/i2c-1'))
    'i2c-1'
    >>> wire_of(SensorConfig('tilt', 'scl3300', 'hardware', bus='spidev0.1'))
    'spidev0'
    >>> wire_of(SensorConfig('a', 'mpu9250', 'emulated', bus='spi'))
    ''
    """
    if sensor.driver not in drivers.names():  # no wire that anybody here knows
        return ''
    if sensor.bus in ('', *drivers.load(sensor.driver).bus_kinds):
        return ''
    name = PurePosixPath(sensor.bus).name
    # chip selects share the wires of one controller
    return name.partition('.')[0] if kind_of_bus(sensor) in ('spi', 'frame') else name


def spread(sensors: Sequence[SensorConfig], processes: int) -> list[int]:
    """
    Return which of so many processes reads each sensor: one for all that share a wire.

    Examples
    --------
    >>> a, b = (SensorConfig(n, 'mpu9250', 'emulated', bus='i2c-1') for n in 'ab')
    >>> spread([a, SensorConfig('c', 'generic', 'emulated'), b], 2)
    [0, 1, 0]
    """
    wires = [wire_of(sensor) or f'of {number}' for number, sensor in enumerate(sensors)]
    readers, busy = dict[str, int](), [0] * processes
    for wire, shared in Counter(wires).items():
        readers[wire] = busy.index(min(busy))
        busy[readers[wire]] += shared
    return [readers[wire] for wire in wires]


def shared_wire(sensor: SensorConfig, clock: Clock) -> Wire | None:
    """Return the wire of an emulated sensor, the same for all of this process that name it."""
    from imu_bench.emulators.line import Wire

    name = wire_of(sensor)
    if not name:
        return None
    # there is one real time, whoever shows it
    key = SystemClock if isinstance(clock, SystemClock) else clock
    return _WIRES.setdefault(key, {}).setdefault(name, Wire())
