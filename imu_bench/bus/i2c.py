# SPDX-License-Identifier: Apache-2.0
"""A chip on an I²C bus of Linux, through smbus2."""

from __future__ import annotations

from typing import Any

from imu_bench.bus.failures import hardware_library, translate
from imu_bench.bus.wiring import Wiring
from imu_bench.errors import BusError

_ENABLE = (
    'list the buses with "ls /dev/i2c-*"; on a Raspberry Pi put dtparam=i2c_arm=on into '
    'config.txt and load the module i2c-dev'
)


class I2cBus:
    """
    A RegisterBus for one address.

    Every read is one I2C_RDWR call (write the register number, repeated start, read), which
    the kernel does not let another process split, and which has no limit of 32 bytes as the
    SMBus block calls have.

    Parameters
    ----------
    path : str
        Such as '/dev/i2c-1'.
    address : int
        7 bit.
    wiring : Wiring
        Says which bit a burst needs in the register number.

    Raises
    ------
    ConfigError
        If smbus2 is not installed.
    BusError
        If the device cannot be opened, with what to do.
    """

    def __init__(self, path: str, address: int, wiring: Wiring) -> None:
        self.name = f'{path} 0x{address:02X}'
        self._address = address
        self._increment = wiring.i2c_increment
        smbus2 = hardware_library('smbus2', 'smbus2')
        self._message: Any = smbus2.i2c_msg
        try:
            self._bus = smbus2.SMBus(path)
        except OSError as error:
            raise self._failure(error, '') from error

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, in one transaction."""
        first = register | self._increment if length > 1 else register
        answer = self._message.read(self._address, length)
        try:
            self._bus.i2c_rdwr(self._message.write(self._address, [first]), answer)
        except OSError as error:
            raise self._failure(error, f' reading 0x{register:02X}') from error
        return bytes(answer)

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction."""
        first = register | self._increment if len(data) > 1 else register
        try:
            self._bus.i2c_rdwr(self._message.write(self._address, [first, *data]))
        except OSError as error:
            raise self._failure(error, f' writing 0x{register:02X}') from error

    def close(self) -> None:
        """Release the device."""
        self._bus.close()

    def _failure(self, error: OSError, doing: str) -> BusError:
        return translate(error, self.name + doing, group='i2c', enable=_ENABLE)
