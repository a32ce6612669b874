# SPDX-License-Identifier: Apache-2.0
"""A sensor that is read at the pace of the host: stamps stand, missed deadlines are counted."""

from collections import Counter

from imu_bench.acquisition import Acquisition
from imu_bench.acquisition.streams import Arrivals, CountedStream, main_stream, Pace, PacedStream
from imu_bench.errors import NoAnswer
from imu_bench.samples import Samples
import numpy as np
import pytest

MS = 1_000_000


@pytest.mark.parametrize(
    ('late_ms', 'missing'),
    [
        ([0, 0, 0, 0], 0),
        ([0, 7, 0, 9], 0),  # late is not lost
        ([4, 0, 0, 0], 0),  # the first one was late
        ([4, 0, 10, 10, 10], 1),
        ([0, 0, 32, 30, 30], 3),
        ([0.1, 0.2, 10.1, 10.2], 1),
    ],
)
def test_what_is_missing_is_told_by_times_alone_and_late_is_not(late_ms, missing):
    arrivals = Arrivals(100.0)
    stamps = np.arange(len(late_ms)) * 10 * MS + np.rint(np.array(late_ms) * MS).astype(np.int64)
    for stamp in stamps:
        arrivals.observe(np.array([stamp]))
    assert arrivals.missing == missing


@pytest.mark.parametrize(
    ('kept', 'missing'), [([0, 1, 2, 3], 0), ([0, 1, 3, 4], 1), ([0, 5], 4), ([2, 2, 3], 0)]
)
def test_a_missed_deadline_is_counted_and_a_late_reading_is_not(kept, missing):
    pace = Pace(100.0)
    for due in kept:
        pace.observe(np.array([10 * due * MS + 7 * MS]), 10 * due * MS)
    assert pace.missing == missing


def test_deadlines_begin_anew_after_an_interruption():
    pace = Pace(100.0)
    pace.observe(np.array([0]), 0)
    pace.observe(np.array([10 * MS]), 10 * MS)
    pace.interrupt()
    for due in (47 * MS, 57 * MS, 67 * MS):  # 20, 30 and 40 ms were missed
        pace.observe(np.array([due]), due)
    assert pace.missing == 3
    assert not pace.rate().observable


def test_the_stream_is_chosen_by_who_sets_the_pace():
    assert isinstance(main_stream(100.0, True), PacedStream)
    assert isinstance(main_stream(100.0, False), CountedStream)


class Polled:
    """A driver that takes a sample whenever it is read."""

    def __init__(self, clock):
        self.clock = clock
        self.rate_hz, self.poll_period_s, self.rates_hz, self.paced = 200.0, 0.005, {}, True
        self.counters, self.continuity, self.skipped = Counter(bus_errors=0), 0, {}
        self.dated, self.edge, self.latch_ns = True, None, None
        self.broken = False
        self.delays_s = iter(())

    def _answer(self):
        if self.broken:
            raise NoAnswer('nothing answers')

    def identify(self):
        self._answer()
        return 'POLLED'

    def configure(self):
        self.clock.sleep(0.05)

    def start(self):
        self.continuity += 1

    def stop(self):
        pass

    def read(self):
        self.clock.sleep(next(self.delays_s, 0.0))
        self._answer()
        return [Samples([self.clock.now_ns()], np.zeros((1, 3)))]


@pytest.fixture
def paced(clock):
    driver = Polled(clock)
    made = Acquisition(driver, clock)
    made.advance(clock.now_ns() + 1000 * MS)
    return driver, made


def stamps_of(acquisition):
    return np.concatenate([run.stamps for run in acquisition.drain()])


def test_deadlines_are_regular_and_nothing_is_held_back(paced):
    _, made = paced
    stamps = stamps_of(made)
    assert len(stamps) == 190
    assert (np.diff(stamps) == 5 * MS).all()
    assert made.stats.samples == 190
    assert made.stats.lost == 0
    assert made.stats.jitter.value == 0


def test_the_stamp_is_that_of_the_reading(paced, clock):
    driver, made = paced
    stamps_of(made)
    driver.delays_s = iter([0.001, 0.0, 0.012])
    made.advance(clock.now_ns() + 100 * MS)
    late = (stamps_of(made) - made._schedule.begun_ns) % (5 * MS)
    assert late[:3].tolist() == [1 * MS, 0, 2 * MS]
    assert made.stats.lost == 2
    assert made.stats.late == 1


def test_an_outage_is_lost_time(paced, clock):
    driver, made = paced
    driver.broken = True
    made.advance(clock.now_ns() + 200 * MS)
    driver.broken = False
    before = made.stats.samples
    made.advance(clock.now_ns() + 1000 * MS)
    assert made.stats.recoveries == 1
    assert made.stats.samples - before + made.stats.lost == pytest.approx(240, abs=1)


def test_every_deadline_has_a_sample_or_is_counted_on_a_busy_machine(paced, clock):
    driver, made = paced
    rng = np.random.default_rng(3)
    driver.delays_s = iter(rng.exponential(0.002, 4000).tolist())
    made.advance(clock.now_ns() + 10_000 * MS)
    deadlines = (clock.now_ns() - made._schedule.begun_ns) // (5 * MS)
    assert made.stats.lost > 20
    assert made.stats.samples + made.stats.lost == pytest.approx(deadlines, abs=2)
