# SPDX-License-Identifier: Apache-2.0
"""How one die of a sensor is reached on a wire, as its document prints it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wiring:
    """
    What a bus has to know about a chip; one per die.

    Attributes
    ----------
    i2c_addresses : tuple of int
        7 bit, the usual one first.  Empty: not on I²C.
    i2c_increment : int
        Bit set in the register address of a burst, such as 0x80.
    i2c_stretches : bool
        It holds the clock low while it is not ready.
    spi_mode : int
        0 to 3.
    spi_max_hz : int
        0: not on SPI.
    spi_read : int
        Bit set in the first byte of a read.
    spi_shift : int
        By how many bits the register address is shifted in the first byte.
    spi_increment : int
        Bit set in the first byte of a burst.
    serial_baud : int
        0: not on a serial line.

    Examples
    --------
    >>> Wiring(i2c_addresses=(0x1E,), i2c_increment=0x80).spi_max_hz
    0
    """

    i2c_addresses: tuple[int, ...] = ()
    i2c_increment: int = 0
    i2c_stretches: bool = False
    spi_mode: int = 0
    spi_max_hz: int = 0
    spi_read: int = 0x80
    spi_shift: int = 0
    spi_increment: int = 0
    serial_baud: int = 0
