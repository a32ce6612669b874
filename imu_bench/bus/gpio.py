# SPDX-License-Identifier: Apache-2.0
"""
A line of a GPIO chip of Linux, through python-periphery.

Events carry the time at which the kernel's interrupt handler ran, CLOCK_MONOTONIC (Linux
Documentation/userspace-api/gpio, since 5.10; uapi/linux/gpio.h: gpio_v2_line_event).  The kernel
keeps the newest 16 that nobody has fetched.
"""

from __future__ import annotations

import time
from typing import Any

from imu_bench.bus.failures import library_of, translate
from imu_bench.bus.interface import Clock
from imu_bench.config.lines import parse_line
from imu_bench.errors import BusError


class _Line:
    """A line that is asked for when it is made, and this program's alone then."""

    def __init__(self, name: str, direction: str, **how: Any) -> None:
        self.name = name
        path, line = parse_line(name)
        with library_of('python-periphery'):
            import periphery
        self._failure: type[OSError] = periphery.GPIOError
        try:
            self._gpio: Any = periphery.GPIO(path, line, direction, label='imu_bench', **how)
        except (self._failure, LookupError) as error:
            raise self._translated(error) from error

    def close(self) -> None:
        """Release the line."""
        self._gpio.close()

    def _translated(self, error: Exception) -> BusError:
        if isinstance(error, LookupError):
            return BusError(f'{self.name}: there is no such line; "gpioinfo" lists them')
        failed = error if isinstance(error, OSError) else OSError(str(error))
        return translate(
            failed, self.name, group='gpio', enable='list the chips with "gpiodetect"'
        )


class GpioLine(_Line):
    """An EdgeLine: the data-ready pin of a chip, which rises when there is something."""

    def __init__(self, name: str, clock: Clock) -> None:
        super().__init__(name, 'in', edge='rising')
        # the best of some readings: another thread may come between the two clocks
        readings = []
        for _ in range(9):
            before = time.monotonic_ns()
            shown = clock.now_ns()
            after = time.monotonic_ns()
            readings.append((after - before, shown - (before + after) // 2))
        self._shift_ns = min(readings)[1]

    def edges(self) -> list[int]:
        """Return when it rose since the last call, ns; does not wait."""
        found = []
        try:
            while self._gpio.poll(0):
                found.append(self._gpio.read_event().timestamp + self._shift_ns)
        except self._failure as error:
            raise self._translated(error) from error
        return found


class GpioOutput(_Line):
    """A line that drives a pin, such as a reset; it begins high."""

    def __init__(self, name: str) -> None:
        super().__init__(name, 'high')

    def drive(self, high: bool) -> None:
        """Set the level."""
        try:
            self._gpio.write(high)
        except self._failure as error:
            raise self._translated(error) from error
