# SPDX-License-Identifier: Apache-2.0
"""A serial line, through pyserial."""

from __future__ import annotations

import errno
import os
from typing import Any

from imu_bench.bus.failures import library_of, translate
from imu_bench.errors import BusError

_ENABLE = (
    'list the lines with "ls /dev/ttyUSB* /dev/ttyACM* /dev/serial*", check the plug; for the '
    'pins of a Raspberry Pi put enable_uart=1 into /boot/firmware/config.txt'
)


class SerialPort:
    """
    A ByteStream, 8 data bits, no parity, one stop bit, for this program alone.

    A line that failed is opened again when it is used next: a USB plug that was pulled and
    put back is another device under the same name.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.name = path
        with library_of('pyserial'):
            import serial
        self._library: Any = serial
        self._baud = baud
        self._port: Any = None
        self._was_there = False
        self._opened()

    @property
    def baud(self) -> int:
        """Speed in bit/s."""
        return self._baud

    @baud.setter
    def baud(self, baud: int) -> None:
        try:
            self._opened().baudrate = baud
        except OSError as error:
            raise self._failure(error) from error
        self._baud = baud

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for the first byte."""
        port = self._opened()
        try:
            port.timeout = timeout_s
            first = bytes(port.read(1))
            return first + bytes(port.read(port.in_waiting)) if first else first
        except OSError as error:
            raise self._failure(error) from error

    def write(self, data: bytes) -> None:
        """Send bytes; return when they are on the line."""
        port = self._opened()
        try:
            port.write(data)
            port.flush()
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Release the device."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _opened(self) -> Any:
        if self._port is None:
            try:
                self._port = self._library.Serial(
                    self.name, self._baud, timeout=0.0, write_timeout=1.0, exclusive=True
                )
            except OSError as error:
                raise self._failure(error) from error
            self._was_there = True
        return self._port

    def _failure(self, error: OSError) -> BusError:
        self.close()
        if error.errno == errno.EAGAIN:  # the lock of another program, flock(2)
            error = OSError(errno.EBUSY, str(error))
        # pyserial raises its own OSError, often without errno, when the plug is pulled
        if error.errno is None or (self._was_there and error.errno == errno.ENOENT):
            error = OSError(errno.ENODEV, str(error))
        elif error.errno == errno.ENOENT:  # its text has the name and the number once more
            error = OSError(errno.ENOENT, os.strerror(errno.ENOENT))
        return translate(error, self.name, group='dialout', enable=_ENABLE)
