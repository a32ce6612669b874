# SPDX-License-Identifier: Apache-2.0
"""
Chips seen from the wire: the same driver runs on them as on the hardware.

A sensor with behaviour of its own (FIFO, modes, pages) has a file here with the name of its
driver and a function `create`; for any other the declared register map is run backwards.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from imu_bench.bus.interface import Clock, DATA_READY, RESET_LINE
from imu_bench.drivers import load
from imu_bench.emulators.ahead import Source
from imu_bench.emulators.line import Line, Timing, Wire
from imu_bench.emulators.pin import EmulatedPin, EmulatedReset
from imu_bench.emulators.socket import Socket
from imu_bench.errors import ConfigError

TIMINGS = {
    'i2c': Timing.i2c,
    'spi': Timing.spi,
    'frame': Timing.frames,
    'serial': Timing.serial,
    'daqhat': Timing.spi,  # a board's library hides what the wire costs
}


def create(
    driver_name: str,
    bus_kind: str,
    source: Source,
    clock: Clock,
    *,
    line: Line | None = None,
    wire: Wire | None = None,
    speed_hz: float | None = None,
    lines: Collection[str] = (),
    addresses: Mapping[str, int] | None = None,
    **options: Any,
) -> Mapping[str, Any]:
    """
    Return the emulated buses of a sensor, one for each die, to be handed to its driver.

    Parameters
    ----------
    driver_name : str
        As `imu_bench.drivers.names` lists it.
    bus_kind : str
        One of the driver's `bus_kinds`.
    source : Source
        What the chip samples: `imu_bench.simulation.chip.SensorSource`.
    clock : Clock
        The bus takes its time on this clock.
    line : Line, optional
        The wire with its speed, to let several sensors share one.
    wire : Wire, optional
        The wire alone, to share it at a speed of its own; one of its own by default.
    speed_hz : float, optional
        Clock of the wire; by default 400 kHz on I²C, 1 MHz on SPI (with frames the usual
        one of the chip), 115200 baud.
    lines : collection of str
        Lines of the computer at pins of the chip, of `LINES`; they are among the buses.
    addresses : mapping of part name to int, optional
        Where its dies answer on I²C: those of one wire with the same address answer at once.
        By default each die is alone.
    **options
        For the chip's own emulator.

    Raises
    ------
    ConfigError
        If the driver is not known or does not do such a bus.
    """
    driver = load(driver_name)
    if bus_kind not in driver.bus_kinds:
        raise ConfigError(
            f'{driver_name} cannot be on {bus_kind!r}; it can be on {", ".join(driver.bus_kinds)}'
        )
    if line is None:
        timing = TIMINGS[bus_kind]
        if bus_kind == 'frame':
            speed_hz = speed_hz or driver.wiring[''].spi_clock_hz
        line = Line(clock, timing(speed_hz) if speed_hz else timing(), wire)
    own = {module.name for module in iter_modules(__path__)}
    module = import_module(f'{__name__}.{driver_name if driver_name in own else "generic"}')
    name = f'emulated {driver_name} on {bus_kind}'
    socket = Socket(driver, bus_kind, name, source, clock, line, addresses or {})
    buses = dict(module.create(socket, **options))
    if DATA_READY in lines:
        pin = EmulatedPin(f'emulated line at {driver_name}')
        buses[''].chip.pin = buses[DATA_READY] = pin
    if RESET_LINE in lines:
        name = f'emulated line at the reset of {driver_name}'
        buses[RESET_LINE] = EmulatedReset(name, buses[''].chip, clock)
    return buses
