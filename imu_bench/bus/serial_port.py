# SPDX-License-Identifier: Apache-2.0
"""A serial line, through pyserial."""

from __future__ import annotations

import errno

from imu_bench.bus.failures import hardware_library, translate
from imu_bench.errors import BusError

_ENABLE = 'list the lines with "ls /dev/ttyUSB* /dev/ttyACM* /dev/serial*", check the plug'


class SerialPort:
    """
    A ByteStream, 8 data bits, no parity, one stop bit, for this program alone.

    Parameters
    ----------
    path : str
        Such as '/dev/ttyUSB0'.
    baud : int

    Raises
    ------
    ConfigError
        If pyserial is not installed.
    BusError
        If the device cannot be opened, with what to do.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.name = path
        serial = hardware_library('serial', 'pyserial')
        try:
            self._port = serial.Serial(path, baud, timeout=0.0, write_timeout=1.0, exclusive=True)
        except OSError as error:
            raise self._failure(error) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for the first byte."""
        try:
            self._port.timeout = timeout_s
            first = bytes(self._port.read(1))
            return first + bytes(self._port.read(self._port.in_waiting)) if first else first
        except OSError as error:
            raise self._failure(error) from error

    def write(self, data: bytes) -> None:
        """Send bytes; return when they are on the line."""
        try:
            self._port.write(data)
            self._port.flush()
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Release the device."""
        self._port.close()

    def _failure(self, error: OSError) -> BusError:
        # pyserial raises its own OSError, often without errno, when the plug is pulled
        if error.errno is None:
            error = OSError(errno.ENODEV, str(error))
        return translate(error, self.name, group='dialout', enable=_ENABLE)
