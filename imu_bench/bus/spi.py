# SPDX-License-Identifier: Apache-2.0
"""A chip on an SPI bus of Linux, through python-periphery."""

from __future__ import annotations

from imu_bench.bus.failures import hardware_library, translate
from imu_bench.bus.interface import FrameBus
from imu_bench.bus.wiring import Wiring

_ENABLE = (
    'list the buses with "ls /dev/spidev*"; on a Raspberry Pi put dtparam=spi=on into config.txt'
)


class SpiFrameBus:
    """
    A FrameBus: one frame per chip select.

    Parameters
    ----------
    path : str
        Such as '/dev/spidev0.0'.
    wiring : Wiring
        Mode and clock.

    Raises
    ------
    ConfigError
        If python-periphery is not installed.
    BusError
        If the device cannot be opened, with what to do.
    """

    def __init__(self, path: str, wiring: Wiring) -> None:
        self.name = path
        periphery = hardware_library('periphery', 'python-periphery')
        try:
            self._device = periphery.SPI(path, wiring.spi_mode, wiring.spi_max_hz)
        except OSError as error:
            raise translate(error, self.name, group='spi', enable=_ENABLE) from error

    def transfer(self, frame: bytes) -> bytes:
        """Send a frame; return what the chip sent meanwhile, of the same length."""
        try:
            return bytes(self._device.transfer(frame))
        except OSError as error:
            raise translate(error, self.name, group='spi', enable=_ENABLE) from error

    def close(self) -> None:
        """Release the device."""
        self._device.close()


class SpiRegisterBus:
    """
    A RegisterBus: the first byte of a frame is the register number with its read bit.

    Parameters
    ----------
    frames : FrameBus
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
        first = register | self._wiring.spi_read | self._burst(length)
        return self._frames.transfer(bytes([first]) + bytes(length))[1:]

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction."""
        self._frames.transfer(bytes([register | self._burst(len(data))]) + data)

    def close(self) -> None:
        """Release the device."""
        self._frames.close()

    def _burst(self, length: int) -> int:
        return self._wiring.spi_increment if length > 1 else 0
