# SPDX-License-Identifier: Apache-2.0
"""
An MCC 172 board on a Raspberry Pi, through daqhats.

The Python package is a wrapper around a C library that the maker's script installs; what each
call does is documented in the maker's library reference.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from imu_bench.bus.failures import library_of
from imu_bench.bus.interface import Scan
from imu_bench.errors import BusBusy, BusError, ConfigError, NoAnswer
import numpy as np

BUFFER_S = 10
"""The library's own buffer is 1 s at low rates."""

_T = TypeVar('_T')


class DaqHat:
    """A DaqBoard."""

    def __init__(self, device: str) -> None:
        self.name = device
        number = device.rpartition('-')[2]
        if number not in tuple('01234567'):
            raise ConfigError(f'bus {device!r} is not known; boards are daqhat-0 to daqhat-7')
        with library_of('daqhats'):
            import daqhats
        self._library: Any = daqhats
        self._error: type[Exception] = self._library.HatError
        self._rate_hz = 0.0
        try:
            self._board: Any = self._library.mcc172(int(number))
        except self._error as error:
            found = [
                f'daqhat-{hat.address}: {hat.product_name}' for hat in self._library.hat_list()
            ]
            raise NoAnswer(
                f'{device}: no MCC 172 answers there ({error}); found: '
                f'{", ".join(found) or "none"}; check its jumpers, run daqhats_read_eeproms'
            ) from error
        except Exception as error:  # the wrapper raises Exception itself
            raise ConfigError(
                f'{device}: {error} Build it with install.sh of github.com/mccdaq/daqhats'
            ) from error

    def identity(self) -> str:
        """Return product, serial number and firmware."""
        firmware = self._asked(self._board.firmware_version).version
        return f'MCC 172, serial number {self._asked(self._board.serial)}, firmware {firmware}'

    def set_supply(self, channel: int, on: bool) -> None:
        """Switch the constant current (IEPE) that feeds a sensor."""
        self._asked(self._board.iepe_config_write, channel, int(on))

    def supply(self, channel: int) -> bool:
        """Return whether a sensor is fed."""
        return bool(self._asked(self._board.iepe_config_read, channel))

    def set_rate(self, rate_hz: float) -> None:
        """Set the rate of both channels, with the board's own clock."""
        self._rate_hz = rate_hz
        local = self._library.SourceType.LOCAL
        self._asked(self._board.a_in_clock_config_write, local, rate_hz)

    def clock(self) -> tuple[float, bool]:
        """Return the rate that is set, and whether the converters are synchronised."""
        found = self._asked(self._board.a_in_clock_config_read)
        return float(found.sample_rate_per_channel), bool(found.synchronized)

    def start(self, channel: int) -> None:
        """Convert one channel until stopped; calibrated codes, not volts."""
        flags = self._library.OptionFlags
        options = flags.CONTINUOUS | flags.NOSCALEDATA
        depth = round(BUFFER_S * self._rate_hz)
        self._asked(self._board.a_in_scan_start, 1 << channel, depth, options)

    def scan(self, wait_s: float = 0.0) -> Scan:
        """
        Return what has been converted since the last call, waiting so long for some.

        The library takes blocks from the board, each at once: after the first sample of one the
        rest is there.
        """
        first = np.empty(0)
        found = self._asked(self._board.a_in_scan_read_numpy, -1, 0.0)
        if wait_s > 0 and not len(found.data) and found.running:
            first = self._asked(self._board.a_in_scan_read_numpy, 1, wait_s).data
            found = self._asked(self._board.a_in_scan_read_numpy, -1, 0.0)
        return Scan(
            np.concatenate([first, found.data]).astype(np.float64),
            bool(found.running),
            bool(found.hardware_overrun),
            bool(found.buffer_overrun),
        )

    def stop(self) -> None:
        """Stop converting and let go of the buffer."""
        try:
            self._asked(self._board.a_in_scan_stop)
        finally:
            self._asked(self._board.a_in_scan_cleanup)

    def close(self) -> None:
        """Release the board; the library does so when the last reference is gone."""
        self._board = None

    def _asked(self, call: Callable[..., _T], *arguments: object) -> _T:
        try:
            return call(*arguments)
        except self._error as error:
            raise self._failure(str(error)) from error

    def _failure(self, text: str) -> BusError:
        if 'already active' in text or 'while a scan' in text:
            return BusBusy(f'{self.name}: {text}; another program uses the board, or this one did')
        return NoAnswer(f'{self.name}: {text}; check that the board is plugged in and powered')
