# SPDX-License-Identifier: Apache-2.0
"""
Microchip MCP3208: 12 bits on SPI, at the moment of the transfer.

Document: DS21298E, its frames in figures 5-2 and 6-1.  It has no clock, no status, no checksum and
nothing that says that it is there, but for one bit that is always zero, and the code that it sends
once more, lowest bit first, as long as the clock goes on: both are read and compared.
"""

from __future__ import annotations

from collections import Counter

from imu_bench.bus.converters.converter import Converter, Reading
from imu_bench.bus.interface import Clock, FrameBus
from imu_bench.errors import ChecksumError, FrameError, NoAnswer
import numpy as np

FRAME_BYTES = 5
FULL_SCALE = 4095
_START, _SINGLE_ENDED, _NULL = 0x04, 0x02, 0x10


def request(channel: int) -> bytes:
    """Return the frame that converts an input against ground."""
    return bytes([_START | _SINGLE_ENDED | channel >> 2, (channel & 3) << 6, 0, 0, 0])


def code(answer: bytes) -> int:
    """Return the code in an answer; the bits before the null bit mean nothing."""
    if len(answer) != FRAME_BYTES:
        raise FrameError(f'a conversion has {FRAME_BYTES} bytes, this one {len(answer)}')
    if answer[1] & _NULL:
        raise NoAnswer(f'{answer.hex()}: nothing drives the line; check power, wiring and CS')
    forwards = (answer[1] & 0x0F) << 8 | answer[2]
    # the lowest bit is sent once; five zeros are behind the highest
    backwards = int(f'{forwards >> 1:011b}'[::-1], 2)
    if backwards << 5 != answer[3] << 8 | answer[4]:
        raise ChecksumError(f'{answer.hex()}: forwards and backwards differ; check the wiring')
    return forwards


FASTEST_HZ = 10_000.0
"""Beyond this a transfer for each sample is hopeless on Linux."""

RAIL_PATIENCE_S = 0.5


class Mcp3208(Converter):
    """
    The converter.

    Parameters
    ----------
    wire, clock, counters, rate_hz
        As for `Converter`.
    channel : int
        0 to 7, against ground.
    """

    part = 'mcp3208'
    usual_hz = 1000.0

    def __init__(
        self,
        wire: FrameBus,
        clock: Clock,
        counters: Counter[str],
        rate_hz: float,
        *,
        channel: int = 0,
    ) -> None:
        super().__init__(wire, clock, counters, rate_hz)
        self._request = request(channel)
        self._rail_since_ns: int | None = None
        counters.setdefault('checksum_errors', 0)

    def checked_rate(self, rate_hz: float) -> float:
        """Return a rate that a computer may hold."""
        if rate_hz > FASTEST_HZ:
            raise self.refused('rate_hz', f'{rate_hz:g}', f'up to {FASTEST_HZ:g} Hz')
        return rate_hz

    def identify(self) -> str:
        """Return its name; it has to pull its null bit low."""
        self._convert()
        return f'MCP3208 on {self.wire.name}'

    def configure(self) -> None:
        """Do nothing: it has no settings."""

    def start(self) -> None:
        """Forget how long the input has been at a rail."""
        self._rail_since_ns = None

    def read(self) -> Reading:
        """Return one conversion; none if the bus was held so long that its time is not known."""
        before = self.clock.now_ns()
        code = self._convert()
        after = self.clock.now_ns()
        middle = (before + after) // 2
        if (after - before) * 1e-9 * self.rate_hz > 1.0:
            return Reading()
        self._watch(code, middle)
        return Reading(np.array([middle]), np.array([code]))

    def stop(self) -> None:
        """Do nothing: it converts when it is asked."""

    def release(self) -> None:
        """Do nothing."""

    def _convert(self) -> int:
        return self.counted(self._code)

    def _code(self) -> int:
        try:
            return code(self.wire.transfer(self._request))
        except NoAnswer as error:
            raise NoAnswer(f'{self.wire.name}: {error}') from error
        except ChecksumError as error:
            self.counters['checksum_errors'] += 1
            raise ChecksumError(f'{self.wire.name}: {error}') from error

    def _watch(self, code: int, now_ns: int) -> None:
        """Notice a line that is stuck: a sensor that lives does not stay at a rail."""
        if 0 < code < FULL_SCALE:
            self._rail_since_ns = None
            return
        self._rail_since_ns = self._rail_since_ns or now_ns
        if now_ns - self._rail_since_ns > RAIL_PATIENCE_S * 1e9:
            self.counters['bus_errors'] += 1
            raise NoAnswer(
                f'{self.wire.name}: code {code} for {RAIL_PATIENCE_S:g} s; check the sensor, its '
                'supply and bias, and the data line'
            )
