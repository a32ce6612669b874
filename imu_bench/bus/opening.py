# SPDX-License-Identifier: Apache-2.0
"""From the name of a device to an open bus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePosixPath

from imu_bench.bus.claim import PATIENCE_S
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.daqhat import DaqHat
from imu_bench.bus.gpio import GpioLine, GpioOutput
from imu_bench.bus.i2c import I2cBus
from imu_bench.bus.interface import (
    ByteStream,
    Clock,
    DaqBoard,
    DATA_READY,
    EdgeLine,
    FrameBus,
    OutputLine,
    RegisterBus,
    RESET_LINE,
)
from imu_bench.bus.serial_port import SerialPort
from imu_bench.bus.spi import SpiFrameBus, SpiRegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.errors import ConfigError

Bus = RegisterBus | FrameBus | ByteStream | DaqBoard | EdgeLine | OutputLine


def kind_of(device: str) -> str:
    """
    Return 'i2c', 'spi', 'serial' or 'daqhat' for the name of a device.

    Raises
    ------
    ConfigError
        If the name tells none of them.

    Examples
    --------
    >>> kind_of('/dev/i2c-1'), kind_of('spidev0.0'), kind_of('/dev/ttyUSB0')
    ('i2c', 'spi', 'serial')
    """
    stem = PurePosixPath(device).name
    for kind, prefixes in (
        ('i2c', ('i2c-',)),
        ('spi', ('spidev',)),
        ('serial', ('tty', 'serial', 'pts')),
        ('daqhat', ('daqhat-',)),
    ):
        if stem.startswith(prefixes):
            return kind
    if PurePosixPath(device).parent.name in ('pts', 'by-id', 'by-path'):
        return 'serial'
    raise ConfigError(
        f'bus {device!r} is not known; write it like /dev/i2c-1, /dev/spidev0.0, /dev/ttyUSB0 '
        'or daqhat-0'
    )


def kind_among(device: str, kinds: tuple[str, ...]) -> str:
    """
    Return what a device is to a sensor that can talk `kinds`: SPI may carry its frames.

    Examples
    --------
    >>> kind_among('spidev0.0', ('frame',)), kind_among('spidev0.0', ('i2c', 'spi'))
    ('frame', 'spi')
    """
    kind = kind_of(device)
    return 'frame' if kind == 'spi' and 'frame' in kinds else kind


def open_bus(
    device: str,
    wiring: Mapping[str, Wiring],
    kinds: tuple[str, ...],
    *,
    address: int | None = None,
    second_address: int | None = None,
    spi_hz: int | None = None,
    data_ready: str = '',
    reset_line: str = '',
    clock: Clock | None = None,
    patience_s: float = PATIENCE_S,
) -> dict[str, Bus]:
    """
    Open the bus of every die of a sensor.

    Parameters
    ----------
    device : str
        Path or its last part: 'i2c-1', '/dev/spidev0.0'.  A second die on SPI has the next
        chip select of the same bus.  A board of the MCC DAQ HAT family is 'daqhat-' and its
        address.
    wiring : mapping of part name to Wiring
        As the driver declares it; the main die is ''.
    kinds : tuple of str
        What the driver can talk: 'i2c', 'spi' (registers), 'frame' (SPI frames), 'serial',
        'daqhat'.
    address : int, optional
        I²C address of the main die, where it is not the usual one.  Another die follows it:
        it takes the address at the same place of its own list.
    second_address : int, optional
        That of another die, where its strap is not set like that of the first.
    spi_hz : int, optional
        Clock of SPI, where it is not the usual one.
    data_ready : str
        GPIO line at the data-ready pin; it is among the buses as `DATA_READY`.
    reset_line : str
        GPIO line at the reset pin, likewise `RESET_LINE`.
    clock : Clock, optional
        In whose time its edges are told; the computer's by default.
    patience_s : float
        How long the first transfer waits for another program that uses the chip.

    Raises
    ------
    ConfigError
        If the sensor is not made for such a bus, such an address or so fast a clock.
    BusError
        If a device cannot be opened; those already open are closed again.
    """
    kind = kind_among(device, kinds)
    if kind not in kinds:
        raise ConfigError(f'bus {device!r} is {kind}; this sensor can do {", ".join(kinds)}')
    if kind == 'daqhat':
        return {'': DaqHat(device)}
    path = device if device.startswith('/') else f'/dev/{device}'
    if kind == 'i2c':
        wiring = at_addresses(wiring, address, second_address)
    elif spi_hz is not None:
        wiring = {part: _clocked(wires, spi_hz) for part, wires in wiring.items()}
    buses: dict[str, Bus] = {}
    try:
        for part, wires in wiring.items():
            if _reachable(kind, wires):
                buses[part] = _open_one(kind, path, wires, len(buses), patience_s)
        _open_lines(buses, data_ready, reset_line, clock or SystemClock())
    except Exception:
        for bus in buses.values():
            bus.close()
        raise
    return buses


def _open_lines(buses: dict[str, Bus], data_ready: str, reset_line: str, clock: Clock) -> None:
    if data_ready:
        buses[DATA_READY] = GpioLine(data_ready, clock)
    if reset_line:
        buses[RESET_LINE] = GpioOutput(reset_line)


def _reachable(kind: str, wiring: Wiring) -> bool:
    """Return whether a die is on such a bus; one that is not is reached through the main die."""
    if kind == 'i2c':
        return bool(wiring.i2c_addresses)
    return wiring.serial_baud > 0 if kind == 'serial' else wiring.spi_max_hz > 0


def _open_one(
    kind: str, path: str, wiring: Wiring, number: int, patience_s: float
) -> RegisterBus | FrameBus | ByteStream:
    if kind == 'i2c':
        return I2cBus(path, wiring.i2c_addresses[0], wiring, patience_s)
    if kind == 'serial':
        return SerialPort(path, wiring.serial_baud)
    bus, _, select = path.rpartition('.')
    frames = SpiFrameBus(f'{bus}.{int(select) + number}', wiring, patience_s)
    return frames if kind == 'frame' else SpiRegisterBus(frames, wiring)


def at_addresses(
    wiring: Mapping[str, Wiring], address: int | None, second_address: int | None
) -> dict[str, Wiring]:
    """
    Return the wiring with the I²C address of each die that is meant, and no other.

    Parameters
    ----------
    wiring, address, second_address
        As in `open_bus`.

    Raises
    ------
    ConfigError
        If the chip cannot have such an address.
    """
    strap = _strap(wiring[''], address)
    meant = {}
    for part, wires in wiring.items():
        addresses = wires.i2c_addresses
        k = min(strap, len(addresses) - 1)
        if part and addresses and second_address is not None:
            k = _strap(wires, second_address, f'{part} ')
        meant[part] = replace(wires, i2c_addresses=addresses[k : k + 1])
    if second_address is not None and not any(meant[part].i2c_addresses for part in meant if part):
        raise ConfigError('second_address: this chip has one address; leave it out')
    return meant


def _strap(wiring: Wiring, address: int | None, die: str = '') -> int:
    """Return which of the chip's addresses is meant."""
    if address is None:
        return 0
    if address not in wiring.i2c_addresses:
        allowed = ', '.join(f'0x{one:02X}' for one in wiring.i2c_addresses)
        raise ConfigError(
            f'{die}address 0x{address:02X} is not one of this chip; it has {allowed}'
        )
    return wiring.i2c_addresses.index(address)


def _clocked(wiring: Wiring, spi_hz: int) -> Wiring:
    """Return the wiring with a clock of SPI."""
    if spi_hz > wiring.spi_max_hz > 0:
        raise ConfigError(
            f'spi_hz {spi_hz} is too fast for this chip; it can do {wiring.spi_max_hz}'
        )
    return replace(wiring, spi_hz=spi_hz)
