# SPDX-License-Identifier: Apache-2.0
"""Errors of a bus: what the operating system's errno says, what to do, and how many there were."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
import errno

from imu_bench.bus.interface import RegisterBus
from imu_bench.errors import BusBusy, BusError, ConfigError, NoAnswer, PermissionDenied

_KINDS: dict[int, tuple[type[BusError], str]] = {
    # a missing acknowledge: ENXIO by the kernel's fault-codes document, EREMOTEIO and EIO by
    # controllers that do not follow it (Raspberry Pi: EREMOTEIO)
    errno.ENXIO: (NoAnswer, 'nothing answers; check power, wiring and address'),
    errno.EREMOTEIO: (NoAnswer, 'nothing answers; check power, wiring and address'),
    errno.EIO: (NoAnswer, 'the transfer broke off; check power, wiring and address'),
    errno.ENODEV: (NoAnswer, 'the device is gone; check the plug'),
    errno.EAGAIN: (BusBusy, 'another master won the bus; try again'),
    errno.EBUSY: (BusBusy, 'somebody else holds it; stop the other program or kernel driver'),
    errno.ETIMEDOUT: (
        BusBusy,
        'a line is stuck or the clock stretched too long; check pull-ups, power, lower the speed',
    ),
    errno.EACCES: (PermissionDenied, ''),
    errno.EPERM: (PermissionDenied, ''),
    errno.ENOENT: (BusError, ''),
}

GONE = (errno.ENODEV, errno.ESHUTDOWN)
"""The device behind an open file is no more; another one may come under its name."""


def translate(error: OSError, where: str, *, group: str, enable: str) -> BusError:
    """Return the bus error for an error of the operating system."""
    kind, advice = _KINDS.get(error.errno or 0, (BusError, 'the transfer failed'))
    if kind is PermissionDenied:
        advice = f'this user may not open it; "sudo usermod -aG {group} $USER", then log in again'
    elif error.errno == errno.ENOENT:
        advice = f'there is no such device; {enable}'
    return kind(f'{where}: {advice} ({error.strerror or error})')


@contextmanager
def library_of(package: str) -> Iterator[None]:
    """
    Say which package to install when the import of a hardware library inside fails.

    A library is imported when a device is opened and not before.
    """
    try:
        yield
    except ImportError as error:
        raise ConfigError(
            f'{package} is needed to open this bus and cannot be imported ({error}); '
            f'"pip install {package}"'
        ) from error


class CountingBus:
    """
    A RegisterBus around another one that counts 'bus_errors'.

    Parameters
    ----------
    counters : Counter
        Receives one count per failed transfer.
    """

    def __init__(self, bus: RegisterBus, counters: Counter[str]) -> None:
        self.name = bus.name
        self._bus = bus
        self._counters = counters

    def read(self, register: int, length: int) -> bytes:
        """Return bytes from a register on, in one transaction."""
        try:
            return self._bus.read(register, length)
        except BusError:
            self._counters['bus_errors'] += 1
            raise

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from a register on, in one transaction."""
        try:
            self._bus.write(register, data)
        except BusError:
            self._counters['bus_errors'] += 1
            raise

    def close(self) -> None:
        """Release the device."""
        self._bus.close()
