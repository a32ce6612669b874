# SPDX-License-Identifier: Apache-2.0
"""
An MCC 172 board as its library shows it: electrical specification rev. 2.1 (ES).

A thread of the library (mccdaq/daqhats, lib/mcc172.c, commit 41d49e5a) asks the board for what it
has, and takes it when it is a tenth of a second or more; its sleep settles where that takes four
looks at most.  The high-pass of its input is part of the simulated sensor's; its own noise
(207 nV/√Hz, 2 µg/√Hz at 100 mV/g) and tolerances are left out.
"""

from __future__ import annotations

import math

from imu_bench.bus.converters.mcc172 import (
    CLOCK_HZ,
    DELAY_S,
    DELAY_SAMPLES,
    FULL_SCALE,
    FULL_SCALE_V,
    SETTLING_S,
)
from imu_bench.bus.interface import Clock, Scan
from imu_bench.emulators.ahead import Source
from imu_bench.errors import BusBusy, NoAnswer
from imu_bench.registers import Axis
import numpy as np

BIAS_V = 11.0  # of a sensor that is fed, once the coupling is charged nobody sees it
TIME_CONSTANT_S = 0.204  # ES: 0.78 Hz
SYNCHRONISING_SAMPLES = 128
SHORTEST_LOOK_S = 100e-6  # of the library's thread, doubled until four looks see a block
LONGEST_BLOCK = (4096 - 5) // 3  # samples of 3 bytes in a transfer, less its header


class EmulatedMcc172:
    """A DaqBoard."""

    acknowledges = True

    def __init__(
        self, name: str, channel: Axis, source: Source, clock: Clock, *, depth_s: float = 10.0
    ) -> None:
        self.name = name
        self.chip = self
        self._channel = channel
        self._source = source
        self._clock = clock
        self._depth_s = depth_s
        self.hardware_overrun = False
        self.power_up(clock.now_ns())

    def power_up(self, at_ns: int) -> None:
        """Begin as after power-up: no supply, fastest rate, no scan."""
        self._fed_ns: dict[int, int] = {}
        self._rate_hz = CLOCK_HZ
        self._synchronous_ns = at_ns
        self._scanning: int | None = None
        self._read_ns = self._look_ns = at_ns
        self._waiting: list[np.ndarray] = []
        self._taken: list[np.ndarray] = []

    def identity(self) -> str:
        """Return product, serial number and firmware."""
        return 'MCC 172, serial number 00000000, firmware 1.02'

    def set_supply(self, channel: int, on: bool) -> None:
        """Feed a sensor; its bias then charges the coupling."""
        if not on:
            self._fed_ns.pop(channel, None)
        else:
            self._fed_ns.setdefault(channel, self._clock.now_ns())

    def supply(self, channel: int) -> bool:
        """Return whether a sensor is fed."""
        return channel in self._fed_ns

    def set_rate(self, rate_hz: float) -> None:
        """Set the nearest rate there is; not while a scan runs."""
        if self._scanning is not None:
            raise BusBusy(f'{self.name}: cannot change the clock while a scan is active')
        divisor = min(max(int(CLOCK_HZ / rate_hz + 0.5), 1), 256)
        self._rate_hz = CLOCK_HZ / divisor
        now = self._clock.now_ns()
        self._synchronous_ns = now + round(SYNCHRONISING_SAMPLES * 1e9 / self._rate_hz)

    def clock(self) -> tuple[float, bool]:
        """Return the rate, and whether 128 samples have passed since it was set."""
        return self._rate_hz, self._clock.now_ns() >= self._synchronous_ns

    def start(self, channel: int) -> None:
        """Begin a scan when the converters are synchronised."""
        if self._scanning is not None:
            raise BusBusy(f'{self.name}: a scan is already active')
        self._clock.sleep_until(self._synchronous_ns)
        self._scanning = channel
        self._read_ns = self._look_ns = self._clock.now_ns()
        self._waiting, self._taken = [], []
        self.hardware_overrun = False
        self._source.restart(self._read_ns, self._rate_hz)

    def scan(self, wait_s: float = 0.0) -> Scan:
        """Return the blocks taken since the last call, waiting so long for one."""
        if self._scanning is None:
            raise NoAnswer(f'{self.name}: scan not active')
        now = self._clock.now_ns()
        overrun = now - self._read_ns > self._depth_s * 1e9
        self._read_ns = now
        self._take(now)
        while not self._taken and self._look_ns <= now + round(wait_s * 1e9):
            self._clock.sleep_until(self._look_ns)
            self._take(self._look_ns)
        codes, self._taken = np.concatenate([np.empty(0), *self._taken]), []
        return Scan(codes, True, self.hardware_overrun, overrun)

    def _take(self, to_ns: int) -> None:
        """Let the library's thread do what it does until a time."""
        block = min(int(self._rate_hz / 10), LONGEST_BLOCK)
        doublings = math.ceil(math.log2(block / self._rate_hz / (4 * SHORTEST_LOOK_S)))
        look_ns = round(SHORTEST_LOOK_S * 1e9) << doublings
        while self._look_ns <= to_ns:
            self._waiting.append(self._codes(self._look_ns))
            self._look_ns += look_ns
            if sum(map(len, self._waiting)) >= block:
                self._taken += self._waiting
                self._waiting = []

    def _codes(self, at_ns: int) -> np.ndarray:
        """Return what has passed the filter until a time."""
        delay = round((DELAY_SAMPLES / self._rate_hz + DELAY_S) * 1e9)
        samples = self._source.samples_until(at_ns - delay)
        volts = self._coupling(samples.stamps)
        codes = np.zeros(len(samples))
        if samples.acceleration is not None and self._scanning in self._fed_ns:
            signal = self._channel.encode(samples.acceleration)
            codes = np.rint(signal + volts / FULL_SCALE_V * FULL_SCALE)
        clipped: np.ndarray = np.clip(codes, -FULL_SCALE, FULL_SCALE - 1)
        return clipped

    def stop(self) -> None:
        """End the scan and let go of the buffer."""
        self._scanning = None

    def close(self) -> None:
        """Do nothing: the board stays where it is."""

    def _coupling(self, stamps: np.ndarray) -> np.ndarray:
        """Return the voltage that is left of the bias while the coupling charges."""
        since = self._fed_ns.get(self._scanning or 0, -math.inf)
        ages = (stamps - since) * 1e-9 if math.isfinite(since) else np.full(len(stamps), math.inf)
        # from ten time constants on it is said to have settled
        return np.where(ages < SETTLING_S, BIAS_V * np.exp(-ages / TIME_CONSTANT_S), 0.0)
