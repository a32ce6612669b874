# SPDX-License-Identifier: Apache-2.0
"""A chip on an I²C bus of Linux, through smbus2."""

from __future__ import annotations

from typing import Any

from imu_bench.bus.claim import claim, PATIENCE_S
from imu_bench.bus.failures import GONE, library_of, translate
from imu_bench.bus.wiring import Wiring
from imu_bench.errors import BusError

_ENABLE = (
    'list the buses with "ls /dev/i2c-*"; on a Raspberry Pi put dtparam=i2c_arm=on into '
    '/boot/firmware/config.txt and load the module i2c-dev'
)


class I2cBus:
    """
    A RegisterBus for one address.

    Every read is one I2C_RDWR call (write the register number, repeated start, read), which
    the kernel does not let another process split, and which has no limit of 32 bytes as the
    SMBus block calls have.  From the first transfer on the chip is this program's alone; a
    device file that was gone (an adapter on USB) is opened again when it is used next.

    Parameters
    ----------
    path : str
        Such as '/dev/i2c-1'.
    address : int
        7 bit.
    wiring : Wiring
        Says which bit a burst needs in the register number.
    patience_s : float
        How long to wait for another program that uses the chip.

    Raises
    ------
    ConfigError
        If smbus2 is not installed.
    BusError
        If the device cannot be opened, with what to do.
    """

    def __init__(
        self, path: str, address: int, wiring: Wiring, patience_s: float = PATIENCE_S
    ) -> None:
        self.name = f'{path} 0x{address:02X}'
        self._path = path
        self._address = address
        self._increment = wiring.i2c_increment
        self._patience_s = patience_s
        with library_of('smbus2'):
            import smbus2
        self._library: Any = smbus2
        self._message: Any = smbus2.i2c_msg
        self._bus: Any = None
        self._claimed = False
        self._opened()

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, in one transaction."""
        first = register | self._increment if length > 1 else register
        answer = self._message.read(self._address, length)
        asked = self._message.write(self._address, [first])
        self._transfer(f' reading 0x{register:02X}', asked, answer)
        return bytes(answer)

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction."""
        first = register | self._increment if len(data) > 1 else register
        message = self._message.write(self._address, [first, *data])
        self._transfer(f' writing 0x{register:02X}', message)

    def close(self) -> None:
        """Release the device."""
        if self._bus is not None:
            self._bus.close()
            self._bus, self._claimed = None, False

    def _opened(self) -> Any:
        if self._bus is None:
            try:
                self._bus = self._library.SMBus(self._path)
            except OSError as error:
                raise self._failure(error, '') from error
        return self._bus

    def _transfer(self, doing: str, *messages: Any) -> None:
        bus = self._opened()
        if not self._claimed:
            claim(bus.fd, self._address, self.name, self._patience_s)
            self._claimed = True
        try:
            bus.i2c_rdwr(*messages)
        except OSError as error:
            if error.errno in GONE:
                self.close()
            raise self._failure(error, doing) from error

    def _failure(self, error: OSError, doing: str) -> BusError:
        return translate(error, self.name + doing, group='i2c', enable=_ENABLE)
