# SPDX-License-Identifier: Apache-2.0
"""A chip behind the auxiliary I²C master of an InvenSense motion sensor."""

from __future__ import annotations

from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.errors import BusBusy, NoAnswer

# RM-MPU-9250A-00 rev. 1.6, registers 49 to 54: slave 4 does one transfer of one byte
_ADDR = 0x31  # then REG, DO, CTRL, DI
_DI = 0x35
_STATUS = 0x36
_READ = 0x80
_ENABLE = 0x80
_DONE = 0x40
_NO_ANSWER = 0x10


class AuxiliaryBus:
    """
    A RegisterBus that reaches a chip byte by byte through slave 4 of the main chip.

    Slow, for configuration only: the main chip does one transfer per sample.

    Parameters
    ----------
    main : RegisterBus
        The chip whose master is used; its I2C_MST_EN bit is set.
    address : int
        I²C address behind the master.
    timeout_s : float
        For one byte.
    """

    def __init__(
        self, main: RegisterBus, clock: Clock, address: int, timeout_s: float = 0.5
    ) -> None:
        self.name = f'{main.name} auxiliary 0x{address:02X}'
        self._main = main
        self._clock = clock
        self._address = address
        self._timeout_s = timeout_s

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, one transfer each."""
        return bytes(self._transfer(self._address | _READ, register + k, 0) for k in range(length))

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, one transfer each."""
        for k, byte in enumerate(data):
            self._transfer(self._address, register + k, byte)

    def close(self) -> None:
        """Leave the main chip's bus open: it belongs to the main chip."""

    def _transfer(self, address: int, register: int, byte: int) -> int:
        self._read(_STATUS)  # reading empties it
        command = bytes([address, register, byte, _ENABLE])
        try:
            self._main.write(_ADDR, command)
        except NoAnswer:  # the status says whether it was taken
            status = self._done()
            if not status:
                self._main.write(_ADDR, command)
                status = self._done()
        else:
            status = self._done()
        if not status:
            raise BusBusy(f'{self.name}: register 0x{register:02X} took too long')
        if status & _NO_ANSWER:
            raise NoAnswer(f'{self.name}: nothing answers behind the auxiliary bus')
        return self._read(_DI)

    def _done(self) -> int:
        """Return the status when the transfer is done, 0 if it was not in time."""
        deadline = self._clock.now_ns() + round(self._timeout_s * 1e9)
        while not (status := self._read(_STATUS)) & _DONE:
            if self._clock.now_ns() >= deadline:
                return 0
            self._clock.sleep(1e-3)
        return status

    def _read(self, register: int) -> int:
        """Return a byte of the main chip, which may be busy once."""
        try:
            return self._main.read(register, 1)[0]
        except NoAnswer:
            return self._main.read(register, 1)[0]
