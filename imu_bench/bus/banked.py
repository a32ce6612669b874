# SPDX-License-Identifier: Apache-2.0
"""Register banks and pages, selected when needed."""

from __future__ import annotations

from imu_bench.bus.interface import RegisterBus
from imu_bench.errors import BusError, NoAnswer


class BankedBus:
    """
    A RegisterBus that understands `Register.number`: the bank plus one above bit 8.

    Numbers without a bank (registers visible in every bank) select nothing.

    Parameters
    ----------
    select : int
        The register that takes the bank number.

    Examples
    --------
    >>> from imu_bench.bus.scripted import ScriptedRegisters
    >>> from imu_bench.registers import Register
    >>> script = [(('write', 0x76, bytes([1])), b''), (('read', 0x0B, 1), bytes([0xA0]))]
    >>> with ScriptedRegisters(script) as wire:
    ...     BankedBus(wire, 0x76).read(Register(0x0B, bank=1).number, 1).hex()
    'a0'
    """

    def __init__(self, bus: RegisterBus, select: int) -> None:
        self.name = bus.name
        self._bus = bus
        self._select = select
        self._bank = -1

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, in one transaction within its bank."""
        return self._bus.read(self._address(register), length)

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction within its bank."""
        address = self._address(register)
        self._bus.write(address, data)
        if address == self._select:
            self._bank = data[0]

    def forget(self) -> None:
        """Select anew next time: the chip was reset, or may have been."""
        self._bank = -1

    def close(self) -> None:
        """Release the device."""
        self._bus.close()

    def _address(self, register: int) -> int:
        bank = (register >> 8) - 1
        if bank not in (-1, self._bank):
            try:
                self._choose(bank)
            except BusError:
                self.forget()
                raise
            self._bank = bank
        return register & 0xFF

    def _choose(self, bank: int) -> None:
        """Select a bank; one that was taken without an acknowledge is selected too."""
        try:
            self._bus.write(self._select, bytes([bank]))
        except NoAnswer:
            if self._bus.read(self._select, 1)[0] != bank:
                raise
