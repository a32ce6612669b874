# SPDX-License-Identifier: Apache-2.0
"""How one die of a sensor is reached on a wire, as its document prints it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wiring:
    """
    What a bus has to know about a chip; one per die.

    Examples
    --------
    >>> Wiring(i2c_addresses=(0x1E,), i2c_increment=0x80).spi_max_hz
    0
    """

    i2c_addresses: tuple[int, ...] = ()  # 7 bit, the usual one first.  Empty: not on I²C
    only_with: str = ''  # setting without which this die is not on the bus
    i2c_increment: int = 0  # bit set in the register address of a burst, such as 0x80
    # so long it holds the clock low after each byte of data, because it is not ready
    i2c_stretch_s: float = 0.0
    spi_mode: int = 0  # 0 to 3
    spi_max_hz: int = 0  # 0: not on SPI
    # what is used unless another clock is set: what loose wires on a desk carry, not what the chip
    # can do
    spi_hz: int = 1_000_000
    spi_read: int = 0x80  # bit set in the first byte of a read
    spi_shift: int = 0  # by how many bits the register address is shifted in the first byte
    spi_increment: int = 0  # bit set in the first byte of a burst
    serial_baud: int = 0  # 0: not on a serial line

    @property
    def spi_clock_hz(self) -> int:
        """Return the clock that is used on SPI."""
        return min(self.spi_hz, self.spi_max_hz)
