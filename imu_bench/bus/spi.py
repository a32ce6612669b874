# SPDX-License-Identifier: Apache-2.0
"""A chip on an SPI bus of Linux, through python-periphery."""

from __future__ import annotations

from typing import Any

from imu_bench.bus.claim import claim, PATIENCE_S
from imu_bench.bus.failures import GONE, library_of, translate
from imu_bench.bus.interface import FrameBus
from imu_bench.bus.wiring import Wiring
from imu_bench.errors import BusError

_ENABLE = (
    'list the buses with "ls /dev/spidev*"; on a Raspberry Pi put dtparam=spi=on into '
    '/boot/firmware/config.txt'
)


class SpiFrameBus:
    """
    A FrameBus: one frame per chip select.

    From the first transfer on the chip is this program's alone; a device file that was gone is
    opened again when it is used next.

    Parameters
    ----------
    path : str
        Such as '/dev/spidev0.0'.
    wiring : Wiring
        Mode and clock.
    patience_s : float
        How long to wait for another program that uses the chip.

    Raises
    ------
    ConfigError
        If python-periphery is not installed.
    BusError
        If the device cannot be opened, with what to do.
    """

    def __init__(self, path: str, wiring: Wiring, patience_s: float = PATIENCE_S) -> None:
        self.name = path
        self._wiring = wiring
        self._patience_s = patience_s
        with library_of('python-periphery'):
            import periphery
        self._library: Any = periphery
        self._device: Any = None
        self._claimed = False
        self._opened()

    def transfer(self, frame: bytes) -> bytes:
        """Send a frame; return what the chip sent meanwhile, of the same length."""
        device = self._opened()
        if not self._claimed:
            claim(device.fd, 0, self.name, self._patience_s)
            self._claimed = True
        try:
            return bytes(device.transfer(frame))
        except OSError as error:
            if error.errno in GONE:
                self.close()
            raise self._failure(error) from error

    def close(self) -> None:
        """Release the device."""
        if self._device is not None:
            self._device.close()
            self._device, self._claimed = None, False

    def _opened(self) -> Any:
        if self._device is None:
            wiring = self._wiring
            try:
                self._device = self._library.SPI(self.name, wiring.spi_mode, wiring.spi_clock_hz)
            except OSError as error:
                raise self._failure(error) from error
        return self._device

    def _failure(self, error: OSError) -> BusError:
        return translate(error, self.name, group='spi', enable=_ENABLE)


class SpiRegisterBus:
    """
    A RegisterBus: the first byte of a frame is the register number with its read bit.

    Parameters
    ----------
    wiring : Wiring
        Says which bits a read and a burst need in the first byte.

    Examples
    --------
    >>> from imu_bench.bus.scripted import ScriptedFrames
    >>> line = ScriptedFrames([(bytes([0xF5, 0]), bytes([0, 0x71]))])
    >>> SpiRegisterBus(line, Wiring(spi_max_hz=1_000_000)).read(0x75, 1).hex()
    '71'
    """

    def __init__(self, frames: FrameBus, wiring: Wiring) -> None:
        self.name = frames.name
        self._frames = frames
        self._wiring = wiring

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` on, in one transaction."""
        first = self._first(register, length) | self._wiring.spi_read
        return self._frames.transfer(bytes([first]) + bytes(length))[1:]

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction."""
        self._frames.transfer(bytes([self._first(register, len(data))]) + data)

    def close(self) -> None:
        """Release the device."""
        self._frames.close()

    def _first(self, register: int, length: int) -> int:
        burst = self._wiring.spi_increment if length > 1 else 0
        return register << self._wiring.spi_shift | burst
