# SPDX-License-Identifier: Apache-2.0
"""Stamps: rate, jitter, gaps, duplicates, order faults, grid; the same for blocks of any size."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology.stamps import timing
from imu_bench.metrology.stamps.continuity import Continuity
from imu_bench.metrology.stamps.stamp_rule import Rule
from imu_bench.metrology.stamps.time_grid import LONGEST_HOLE
import numpy as np
import pytest

EPOCH = 1_700_000_000_000_000_000


def stamps_of(times_ns):
    return EPOCH + np.rint(times_ns).astype(np.int64)


def regular(n, rate):
    return np.arange(n) * 1e9 / rate


def test_exact_stamps_give_the_exact_rate():
    found = timing.analyse(stamps_of(regular(20_000, 952.0)), nominal_hz=952.0)
    assert found.rate.value == pytest.approx(952.0, rel=1e-9)
    assert found.rate.low <= 952.0 <= found.rate.high
    assert found.rate_error.value == pytest.approx(0.0, abs=1e-3)
    assert (found.gap_count, found.missing, found.duplicates, found.order_faults) == (0, 0, 0, 0)
    assert found.burst == 1.0
    assert found.duration_s == pytest.approx(19_999 / 952.0)


def test_rate_error_of_a_hundredth_of_a_per_cent_is_seen_through_jitter_and_gaps():
    rng = np.random.default_rng(1)
    times = regular(60_000, 100.0 * (1 + 1e-4)) + rng.normal(0, 0.05e7, 60_000)
    keep = rng.random(times.size) > 0.02
    keep[20_000:26_000] = False
    found = timing.analyse(stamps_of(times[keep]), nominal_hz=100.0)
    assert found.rate_error.unit == 'ppm'
    assert found.rate_error.low <= 100.0 <= found.rate_error.high
    assert found.rate_error.low > 90.0
    assert found.missing == np.count_nonzero(~keep)


def test_500_hz_asked_and_12_5_delivered():
    rng = np.random.default_rng(2)
    times = regular(5000, 12.5) + rng.normal(0, 1e5, 5000)
    found = timing.analyse(stamps_of(times), nominal_hz=500.0)
    assert found.rate.value == pytest.approx(12.5, rel=1e-5)
    assert found.rate_error.value == pytest.approx(-975_000, rel=1e-5)
    assert found.missing == 0, 'a slow sensor is not a sensor that loses samples'


def test_gaps_are_found_where_they_are_and_as_long_as_they_are():
    times = np.delete(regular(1000, 200.0), np.r_[100:103, 500:700])
    found = timing.analyse(stamps_of(times))
    assert [(g.index, g.missing) for g in found.gaps] == [(100, 3), (497, 200)]
    assert found.gaps[0].start_ns == stamps_of(regular(1000, 200.0))[99]
    assert found.gaps[1].duration_s == pytest.approx(201 / 200.0)
    assert found.missing == 203
    grid = timing.grid(stamps_of(times))
    assert grid.span == 1000
    assert np.array_equal(grid.index, np.delete(np.arange(1000), np.r_[100:103, 500:700]))


def test_more_gaps_than_are_listed_are_still_counted():
    keep = np.ones(20_000, dtype=bool)
    keep[5:-5:10] = False
    keep[7001:7004] = False
    found = timing.analyse(stamps_of(regular(20_000, 952.0)[keep]))
    assert len(found.gaps) == timing.LISTED_GAPS
    assert found.gap_count == np.count_nonzero(~keep) - 2
    assert max(g.missing for g in found.gaps) == 3
    assert [g.index for g in found.gaps] == sorted(g.index for g in found.gaps)


@pytest.mark.parametrize('rate', [1000.0, 952.0, 99.7])
def test_a_drifting_clock_never_accumulates_into_a_gap(rate):
    n = 100_000
    steps = (1e9 / rate) * (1 + 5e-3 * np.sin(np.arange(n) * 2 * np.pi / n))
    grid = timing.grid(stamps_of(np.cumsum(steps)))
    assert grid.span == n
    assert timing.analyse(stamps_of(np.cumsum(steps))).wander_s > 0.05


def test_a_stall_that_is_caught_up_leaves_no_gap():
    times = regular(5000, 1000.0)
    late = times.copy()
    late[1000:1030] = np.maximum(times[1000:1030], times[1000] + 25e6 + np.arange(30) * 2e4)
    found = timing.analyse(stamps_of(late))
    assert (found.gap_count, found.duplicates, found.order_faults) == (0, 0, 0)
    assert found.rate.value == pytest.approx(1000.0, rel=1e-4)


def test_samples_lost_in_a_stall_are_counted():
    times = np.delete(regular(5000, 1000.0), np.arange(1010, 1015))
    times[1000:1020] = np.maximum(times[1000:1020], 1.0245e9 + np.arange(20) * 2e4)
    found = timing.analyse(stamps_of(times))
    assert found.missing == 5


@pytest.mark.parametrize('spread', [0.0, 0.01])
def test_bursts_stamped_together_are_not_gaps(spread):
    n = 30 * 2000
    burst, place = np.divmod(np.arange(n), 30)
    times = ((burst + 1) * 30 + place * spread) * 1e9 / 952.0
    found = timing.analyse(stamps_of(times))
    assert found.rate.value == pytest.approx(952.0, rel=1e-4)
    assert found.rate.low <= 952.0 <= found.rate.high
    assert (found.missing, found.duplicates) == (0, 0)
    assert found.burst == pytest.approx(30.0, rel=1e-3)


def test_a_lost_burst_is_a_gap_of_its_length():
    n = 30 * 2000
    burst = np.arange(n) // 30
    times = (burst + 1) * 30e6
    found = timing.analyse(stamps_of(times[(burst != 500) & (burst != 1200)]))
    assert found.missing == 60
    assert found.gap_count == 2


@pytest.mark.parametrize('rate', [952.0, 997.3, 1344.0])
def test_stamps_rounded_to_a_millisecond_are_not_gaps(rate):
    times = np.floor(regular(100_000, rate) / 1e6) * 1e6
    found = timing.analyse(stamps_of(times))
    assert found.resolution_s == pytest.approx(1e-3)
    assert found.missing == 0
    assert found.rate.low <= rate <= found.rate.high
    assert found.rate.value == pytest.approx(rate, rel=1e-5)


def test_exact_millisecond_stamps_still_show_single_losses():
    times = np.delete(regular(10_000, 1000.0), [500, 501, 700, 4000, 9000])
    found = timing.analyse(stamps_of(times))
    assert found.resolution_s == 0.0
    assert found.missing == 5


def test_duplicates_are_dropped():
    times = regular(10_000, 100.0)
    times = np.insert(times, [10, 500, 9000], times[[9, 499, 8999]])
    found = timing.analyse(stamps_of(times))
    assert found.duplicates == 3
    grid = timing.grid(stamps_of(times))
    assert grid.span == 10_000
    assert np.flatnonzero(~grid.keep).tolist() == [10, 501, 9002]


@pytest.mark.parametrize('where', [0, 500])
@pytest.mark.parametrize('by', [-EPOCH, 10**18])
def test_one_wild_stamp_costs_one_sample(where, by):
    stamps = stamps_of(regular(1000, 100.0))
    stamps[where] += by
    found = timing.analyse(stamps)
    assert found.order_faults + found.gap_count >= 1
    assert found.rate.value == pytest.approx(100.0)
    grid = timing.grid(stamps)
    if where:
        assert grid.span == 1000
        assert found.order_faults == 1


def test_a_few_wild_stamps_in_a_row_cost_those_samples():
    stamps = stamps_of(regular(1000, 100.0))
    stamps[500:520] += 10**18
    assert timing.grid(stamps).span == 1000
    assert timing.analyse(stamps).order_faults == 20


def test_samples_sent_again_are_dropped():
    times = regular(1000, 100.0)
    times = np.insert(times, 500, times[490:500])
    found = timing.analyse(stamps_of(times))
    assert found.order_faults + found.duplicates == 10
    assert found.missing == 0


@pytest.mark.parametrize('by', [1e9, 1e12])
def test_a_clock_set_back_for_good_is_a_break_and_loses_nothing(by):
    times = regular(10_000, 100.0)
    times[5000:] -= by
    found = timing.analyse(stamps_of(times))
    assert found.order_faults == 0
    assert found.gap_count == 1
    assert found.rate.value == pytest.approx(100.0, rel=1e-9)
    grid = timing.grid(stamps_of(times))
    assert grid.keep.all()
    assert grid.span == 10_001


def test_half_the_samples_lost_at_random_does_not_halve_the_rate():
    rng = np.random.default_rng(3)
    keep = rng.random(50_000) > 0.5
    found = timing.analyse(stamps_of(regular(50_000, 400.0)[keep]))
    assert found.rate.value == pytest.approx(400.0, rel=1e-6)


def test_jitter_is_the_scatter_of_the_interval():
    rng = np.random.default_rng(4)
    times = regular(50_000, 100.0) + rng.normal(0, 3e5, 50_000)
    jitter = timing.analyse(stamps_of(times)).jitter
    assert jitter.unit == 's'
    assert jitter.low < 3e-4 * np.sqrt(2) < jitter.high
    assert jitter.high / jitter.low < 1.05


@pytest.mark.parametrize(
    ('name', 'delay', 'walk'), [('white', 0.05, 0.0), ('late', 0.1, 0.0), ('wander', 0.02, 0.01)]
)
def test_interval_of_the_rate_covers_the_truth(name, delay, walk):
    rng = np.random.default_rng(5)
    inside, runs, n = 0, 120, 3000
    for _ in range(runs):
        late = rng.exponential(delay * 1e7, n) if name == 'late' else rng.normal(0, delay * 1e7, n)
        times = regular(n, 100.0) + late + np.cumsum(rng.normal(0, 1, n)) * walk * 1e7
        rate = timing.analyse(stamps_of(times)).rate
        inside += rate.low <= 100.0 <= rate.high
    assert 0.87 * runs <= inside


def test_two_samples_give_a_rate_without_uncertainty():
    found = timing.analyse([0, 10_000_000])
    assert not found.rate.observable
    assert found.period_s == pytest.approx(0.01)
    assert not found.jitter.observable


@pytest.mark.parametrize(
    ('stamps', 'text'),
    [
        ([], 'no stamps'),
        ([5], 'single sample'),
        ([7] * 100, 'all stamps are equal'),
        (list(range(100, 0, -1)), 'run backwards'),
        ([[0, 1], [2, 3]], 'shape'),
        ([0.0, 0.01, 0.02], 'int64'),
    ],
)
def test_stamps_that_give_no_rate_are_named(stamps, text):
    with pytest.raises(DataError, match=text):
        timing.analyse(np.array(stamps))


@pytest.mark.parametrize('nominal', [0.0, -1.0, np.nan, np.inf])
def test_an_impossible_nominal_rate_is_named(nominal):
    with pytest.raises(DataError, match='nominal rate'):
        timing.analyse([0, 10, 20], nominal_hz=nominal)


def test_a_single_sample_has_a_place_if_the_period_is_given():
    grid = timing.grid([5], period_s=0.01)
    assert (grid.span, grid.period_s) == (1, 0.01)


def test_a_hole_of_years_does_not_take_all_the_memory():
    stamps = stamps_of(regular(1000, 1000.0))
    stamps[500:] += 50 * 365 * 86400 * 10**9
    grid = timing.grid(stamps)
    assert grid.span == 1000 + LONGEST_HOLE
    assert timing.analyse(stamps).missing == pytest.approx(50 * 365 * 86400e3)


def test_place_keeps_the_axes_and_marks_the_holes():
    stamps = np.array([0, 10, 20, 50, 60]) * 1_000_000
    values = np.arange(10.0).reshape(5, 2)
    placed, valid = timing.place(values, timing.grid(stamps))
    assert placed.shape == (7, 2)
    assert valid.tolist() == [True, True, True, False, False, True, True]
    assert np.array_equal(placed[valid], values)
    assert not placed[~valid].any()


def test_place_without_holes_copies_nothing():
    values = np.arange(5.0)
    placed, valid = timing.place(values, timing.grid(np.arange(5) * 10))
    assert placed is values
    assert valid.all()


def test_place_refuses_other_lengths():
    with pytest.raises(DataError, match='4'):
        timing.place(np.zeros(4), timing.grid(np.arange(5) * 10))


def test_the_period_depends_on_where_gaps_are_not_on_how_long_they_were_taken_to_be():
    rng = np.random.default_rng(6)
    times = regular(20_000, 997.0) + rng.normal(0, 2e4, 20_000)
    times[7000:] += 3e9
    stamps = stamps_of(times)
    periods = [
        timing.period(stamps, np.array([7000]), np.array([stamps[7000] - stamps[6999]]), guess)
        for guess in (1 / 997.0, 1 / 1000.0, 1 / 980.0)
    ]
    assert periods[1] == pytest.approx(periods[0], rel=1e-12)
    assert periods[2] == pytest.approx(periods[0], rel=1e-12)


def messy(seed, n=3000):
    """Return stamps with everything wrong at once."""
    rng = np.random.default_rng(seed)
    times = regular(n, 100.0) + rng.exponential(rng.choice([0.02, 0.1, 0.3]) * 1e7, n)
    times = times[rng.random(n) > rng.choice([0.0, 0.01, 0.1])]
    for at in rng.integers(0, times.size - 300, 4):
        kind = rng.integers(6)
        if kind == 0:
            times[at : at + 40] = np.maximum(times[at : at + 40], times[at] + 3e8)
        elif kind == 1:
            times[at] += rng.choice([-1e12, 1e12])
        elif kind == 2:
            times[at:] -= 5e9
        elif kind == 3:
            times[at:] += 2e9
        elif kind == 4:
            times = np.insert(times, at, times[at - 5 : at])
        else:
            times = np.insert(times, at, times[at])
    return stamps_of(times)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.lists(st.integers(1, 700), min_size=1, max_size=6))
def test_blocks_of_any_size_are_judged_like_the_whole(seed, sizes):
    stamps = messy(seed, 1500)
    rule = Rule.of(stamps, 1e7)
    whole = Continuity(rule)
    keep, step = whole.settle(stamps, final=True)
    stream = Continuity(rule)
    keeps, steps = [], []
    start = turn = 0
    while start < stamps.size:
        end = min(start + sizes[turn % len(sizes)], stamps.size)
        turn += 1
        kept, gaps = stream.settle(stamps[start:end])
        keeps.append(kept)
        steps.append(gaps)
        start = end
    kept, gaps = stream.preview()
    keeps.append(kept)
    steps.append(gaps)
    assert np.array_equal(np.concatenate(keeps), keep)
    assert np.concatenate(steps) == pytest.approx(step, rel=1e-9)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_the_grid_of_messy_stamps_is_increasing_and_complete(seed):
    stamps = messy(seed)
    grid = timing.grid(stamps)
    index = grid.index[grid.keep]
    assert (np.diff(index) >= 1).all()
    assert (index[0], index[-1]) == (0, grid.span - 1)
    assert (grid.index[~grid.keep] == -1).all()
    found = timing.analyse(stamps)
    assert found.duplicates + found.order_faults == np.count_nonzero(~grid.keep)
    assert grid.period_s == found.period_s
