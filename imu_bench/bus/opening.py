# SPDX-License-Identifier: Apache-2.0
"""From the name of a device to an open bus."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from imu_bench.bus.claim import PATIENCE_S
from imu_bench.bus.daqhat import DaqHat
from imu_bench.bus.i2c import I2cBus
from imu_bench.bus.interface import ByteStream, DaqBoard, FrameBus, RegisterBus
from imu_bench.bus.serial_port import SerialPort
from imu_bench.bus.spi import SpiFrameBus, SpiRegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.errors import ConfigError


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
    address: int | None = None,
    *,
    patience_s: float = PATIENCE_S,
) -> dict[str, RegisterBus | FrameBus | ByteStream | DaqBoard]:
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
    patience_s : float
        How long the first transfer waits for another program that uses the chip.

    Raises
    ------
    ConfigError
        If the sensor is not made for such a bus or such an address.
    BusError
        If a device cannot be opened; those already open are closed again.
    """
    kind = kind_among(device, kinds)
    if kind not in kinds:
        raise ConfigError(f'bus {device!r} is {kind}; this sensor can do {", ".join(kinds)}')
    if kind == 'daqhat':
        return {'': DaqHat(device)}
    path = device if device.startswith('/') else f'/dev/{device}'
    strap = _strap(wiring[''], address) if kind == 'i2c' else 0
    buses: dict[str, RegisterBus | FrameBus | ByteStream | DaqBoard] = {}
    try:
        for part, wires in wiring.items():
            if _reachable(kind, wires):
                buses[part] = _open_one(kind, path, wires, strap, len(buses), patience_s)
    except Exception:
        for bus in buses.values():
            bus.close()
        raise
    return buses


def _reachable(kind: str, wiring: Wiring) -> bool:
    """Return whether a die is on such a bus; one that is not is reached through the main die."""
    if kind == 'i2c':
        return bool(wiring.i2c_addresses)
    return wiring.serial_baud > 0 if kind == 'serial' else wiring.spi_max_hz > 0


def _open_one(
    kind: str, path: str, wiring: Wiring, strap: int, number: int, patience_s: float
) -> RegisterBus | FrameBus | ByteStream:
    if kind == 'i2c':
        addresses = wiring.i2c_addresses
        return I2cBus(path, addresses[min(strap, len(addresses) - 1)], wiring, patience_s)
    if kind == 'serial':
        return SerialPort(path, wiring.serial_baud)
    bus, _, select = path.rpartition('.')
    frames = SpiFrameBus(f'{bus}.{int(select) + number}', wiring, patience_s)
    return frames if kind == 'frame' else SpiRegisterBus(frames, wiring)


def _strap(wiring: Wiring, address: int | None) -> int:
    """Return which of the chip's addresses is meant."""
    if address is None:
        return 0
    if address not in wiring.i2c_addresses:
        allowed = ', '.join(f'0x{one:02X}' for one in wiring.i2c_addresses)
        raise ConfigError(f'address 0x{address:02X} is not one of this chip; it has {allowed}')
    return wiring.i2c_addresses.index(address)
