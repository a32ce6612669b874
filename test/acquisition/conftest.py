# SPDX-License-Identifier: Apache-2.0
"""A chip with a FIFO behind a bus that takes its time, on a simulated clock."""

from collections import Counter

from imu_bench.errors import NoAnswer
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

MS = 1_000_000


class FakeChip:
    """
    A driver whose acceleration x is the number of the sample: what was lost shows.

    Every reading takes up to `delay_s` before the count is latched, at random.
    """

    def __init__(self, clock, rate_hz=1000.0, rate_error=0.0, delay_s=1e-3, depth=42, poll_s=0.02):
        self.clock, self.depth, self.delay_s = clock, depth, delay_s
        self.rate_hz, self.poll_period_s = rate_hz, poll_s
        self.rates_hz = {}
        self.paced = False
        self.period_ns = 1e9 / (rate_hz * (1 + rate_error))
        self.counters = Counter(bus_errors=0)
        self.continuity = 0
        self.skipped, self.dated, self.edge, self.latch_ns = {}, True, None, None
        self.rng = np.random.default_rng(7)
        self.unplugged = self.asleep = False
        self.calls = []
        self.origin_ns = clock.now_ns() + 0.3 * self.period_ns
        self.taken = 0
        self.closed = False

    def made(self):
        """Return the number of the newest sample; the chip's oscillator never stops."""
        return int((self.clock.now_ns() - self.origin_ns) // self.period_ns)

    def true_ns(self, numbers):
        return self.origin_ns + np.asarray(numbers) * self.period_ns

    def _answer(self):
        if self.unplugged:
            self.counters['bus_errors'] += 1
            raise NoAnswer('i2c-1 0x68: nothing answers')

    def identify(self):
        self.calls.append('identify')
        self._answer()
        return 'FAKE-1'

    def configure(self):
        self.calls.append('configure')
        self._answer()
        self.clock.sleep(0.1)
        self.asleep = False

    def start(self):
        self.calls.append('start')
        self._answer()
        self.taken = self.made()
        self.continuity += 1

    def stop(self):
        self.calls.append('stop')
        self._answer()

    def close(self):
        self.closed = True

    def read(self):
        self.clock.sleep(self.rng.uniform(0.0, self.delay_s))
        self._answer()
        if self.asleep:
            return []
        newest = self.made()
        if newest - self.taken > self.depth:
            self.taken = newest - self.depth
            self.continuity += 1
        numbers = np.arange(self.taken + 1, newest + 1)
        self.taken = newest
        ages = np.arange(numbers.size - 1, -1, -1) * 1e9 / self.rate_hz
        stamps = self.clock.now_ns() - np.rint(ages).astype(np.int64)
        values = np.zeros((numbers.size, 3))
        values[:, 0] = numbers
        return [Samples(stamps=stamps, acceleration=values)]


@pytest.fixture
def clock():
    return SimulatedClock()


@pytest.fixture
def chip(clock):
    return lambda **options: FakeChip(clock, **options)
