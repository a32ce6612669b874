# SPDX-License-Identifier: Apache-2.0
"""
Measurement Computing MCC 172: 24 bits by its own clock, filter, buffer, constant current.

Document: electrical specification rev. 2.1 (ES).
"""

from __future__ import annotations

from collections import Counter
import math

from imu_bench.bus.converters.converter import Converter, Reading
from imu_bench.bus.interface import Clock, DaqBoard
from imu_bench.errors import BusError, NotReady
import numpy as np

CLOCK_HZ = 51200.0  # ES: divided by 1 to 256
DIVISORS = 256
FULL_SCALE = 2**23
FULL_SCALE_V = 5.0
CHANNELS = 2
DELAY_SAMPLES, DELAY_S = 39, 4.5e-6  # ES: of the filter
SETTLING_S = 2.04  # ten times the 0.204 s of its 0.78 Hz high-pass
SYNCHRONISING_S = 5.0  # ES: 128 samples, 0.64 s at the lowest rate
BLOCK_S = 0.1
"""
In blocks so long, or a little longer, samples come from the board, and at high rates in shorter
ones: the library's thread looks now and then and takes what there is (mccdaq/daqhats,
lib/mcc172.c, commit 41d49e5a: read_threshold).
"""
POLL_S = BLOCK_S / 4


class Mcc172(Converter):
    """
    The board.

    Parameters
    ----------
    wire, clock, counters, rate_hz
        As for `Converter`.
    channel : int
        0 or 1.
    supply : bool
        Feed the sensor.
    """

    part = 'mcc172'
    paced = False
    usual_hz = CLOCK_HZ / 51
    settling_s = SETTLING_S

    def __init__(
        self,
        wire: DaqBoard,
        clock: Clock,
        counters: Counter[str],
        rate_hz: float,
        *,
        channel: int = 0,
        supply: bool = True,
    ) -> None:
        super().__init__(wire, clock, counters, rate_hz)
        if channel >= CHANNELS:
            raise self.refused('input', channel, '0, 1')
        self._channel = channel
        self._supply = supply
        self._block_ns = 0

    @property
    def poll_period_s(self) -> float:
        """Return a part of a block."""
        return POLL_S

    def checked_rate(self, rate_hz: float) -> float:
        """Return 51200 Hz divided by an integer; a rate may be rounded, never to a neighbour."""
        divisor = min(max(round(CLOCK_HZ / rate_hz), 1), DIVISORS)
        if not math.isclose(CLOCK_HZ / divisor, rate_hz, rel_tol=1e-4):
            nearest = f'{CLOCK_HZ / divisor:.8g}'
            raise self.refused(
                'rate_hz', f'{rate_hz:g}', f'51200 Hz divided by 1 to 256, nearest {nearest} Hz'
            )
        return CLOCK_HZ / divisor

    def identify(self) -> str:
        """Return product, serial number and firmware."""
        return str(self.counted(self.wire.identity))

    def configure(self) -> None:
        """Feed the sensor, set the rate, read both back, let the sensor settle."""
        board = self.wire
        self.stop()  # a scan that an error left behind; the board is busy while it runs
        settled = self.counted(board.supply, self._channel) == self._supply
        self.counted(board.set_supply, self._channel, self._supply)
        self.counted(board.set_rate, self.rate_hz)
        fed, (rate, _) = self.counted(board.supply, self._channel), self.counted(board.clock)
        if fed != self._supply or not math.isclose(rate, self.rate_hz, rel_tol=1e-4):
            raise BusError(
                f'{board.name}: supply {self._supply} and {self.rate_hz:g} Hz were set, but the '
                f'board holds {fed} and {rate:g} Hz; check its firmware'
            )
        deadline = self.clock.now_ns() + round(SYNCHRONISING_S * 1e9)
        while not self.counted(board.clock)[1]:
            if self.clock.now_ns() > deadline:
                raise NotReady(
                    f'{board.name}: converters not synchronised after {SYNCHRONISING_S:g} s; '
                    'switch the board off and on'
                )
            self.clock.sleep(0.01)
        if not settled:
            self.clock.sleep(SETTLING_S)

    def start(self) -> None:
        """Start the scan."""
        self.counted(self.wire.start, self._channel)
        self._block_ns = self.clock.now_ns()

    def read(self) -> Reading:
        """
        Return what the board has converted; nothing after an overrun, which leaves a gap.

        A block that is due is waited for: how old it is when it is found would be wrong in the
        stamps.
        """
        due = self.clock.now_ns() - self._block_ns > (BLOCK_S - POLL_S) * 1e9
        scan = self.counted(self.wire.scan, POLL_S if due else 0.0)
        now = self.clock.now_ns()
        if len(scan.codes):
            self._block_ns = now
        self.counters['hardware_overruns'] += scan.hardware_overrun
        self.counters['buffer_overruns'] += scan.buffer_overrun
        if scan.hardware_overrun or scan.buffer_overrun or not scan.running:
            self.stop()
            return Reading(lost=True)
        periods = np.arange(len(scan.codes) - 1, -1, -1) + DELAY_SAMPLES
        ages = periods * (1e9 / self.rate_hz) + DELAY_S * 1e9
        return Reading(now - np.rint(ages).astype(np.int64), scan.codes)

    def stop(self) -> None:
        """End the scan."""
        self.counted(self.wire.stop)

    def release(self) -> None:
        """Stop feeding the sensor."""
        if self._supply:
            self.wire.set_supply(self._channel, False)
