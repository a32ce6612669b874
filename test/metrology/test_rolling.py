# SPDX-License-Identifier: Apache-2.0
"""The rolling analysis equals the batch analysis of the same window, whatever happened before."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.errors import DataError, NotReady
from imu_bench.metrology import allan
from imu_bench.metrology.moments import Moments
from imu_bench.metrology.rolling import RollingAnalysis
from imu_bench.metrology.stamps import timing
import numpy as np
import pytest

EPOCH = 1_700_000_000_000_000_000
UNITS = ('m/s²', 'm/s²', 'rad/s')


def noise(n, seed=1, axes=3):
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(size=(n, axes)) * 0.02, axis=0)
    return rng.normal(size=(n, axes)) + walk + np.linspace(0.0, 9.81, axes)


def stamps_at(n, rate, seed=2, jitter=0.02):
    period = 1e9 / rate
    late = np.random.default_rng(seed).uniform(-jitter, jitter, n) * period
    return EPOCH + np.rint(np.arange(n) * period + late).astype(np.int64)


def feed(live, stamps, values, sizes):
    start = turn = 0
    while start < stamps.size:
        end = min(start + sizes[turn % len(sizes)], stamps.size)
        live.append(stamps[start:end], values[start:end])
        start, turn = end, turn + 1


def assert_equal_to_batch(window, stamps, values, units=UNITS):
    """Compare a snapshot with the batch functions on the samples from start_ns to end_ns."""
    inside = (stamps >= window.start_ns) & (stamps <= window.end_ns)
    cut, rows = stamps[inside], values[inside]
    grid = timing.grid(cut)
    placed, valid = timing.place(rows, grid)
    assert window.period_s == pytest.approx(grid.period_s, rel=1e-9)
    assert window.samples == np.count_nonzero(grid.keep)
    assert window.missing == grid.span - window.samples
    moments = Moments.of(np.ascontiguousarray(rows[grid.keep].T))
    for axis, unit in enumerate(units):
        curve = window.curves[axis]
        batch = allan.deviation(
            placed[:, axis], 1.0 / grid.period_s, tau=curve.tau, valid=valid, unit=unit,
            overlap='full',
        )  # fmt: skip
        for name in ('m', 'terms', 'alpha', 'samples', 'span', 'unit', 'kind'):
            assert np.array_equal(getattr(curve, name), getattr(batch, name)), name
        for name in ('tau', 'deviation', 'low', 'high', 'edf'):
            assert getattr(curve, name) == pytest.approx(getattr(batch, name), rel=1e-9), name
        for name in ('rms', 'mean', 'std'):
            ours = getattr(window, name)[axis]
            theirs = getattr(moments, f'{name}_estimate')(axis, unit)
            for bound in ('value', 'low', 'high'):
                assert getattr(ours, bound) == pytest.approx(getattr(theirs, bound), rel=1e-9)


@pytest.mark.parametrize('size', [1, 7, 200, 5000, 100_000])
def test_equals_batch_after_blocks_of_any_size(size):
    n = 400 if size == 1 else 12_000
    live = RollingAnalysis(20.0, 100.0, axes=3, units=UNITS)
    stamps, values = stamps_at(n, 100.0), noise(n)
    feed(live, stamps, values, [size])
    window = live.snapshot()
    assert_equal_to_batch(window, stamps, values)
    assert window.end_ns == stamps[-1]


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 1000),
    st.lists(st.integers(20, 3000), min_size=1, max_size=8),
    st.sampled_from([3.0, 20.0, 60.0]),
)
def test_equals_batch_at_every_moment(seed, sizes, window_s):
    n = 9000
    stamps, values = stamps_at(n, 100.0, seed), noise(n, seed)
    rng = np.random.default_rng(seed)
    keep = rng.random(n) > rng.choice([0.0, 0.001, 0.02])
    hole = int(rng.integers(1000, 8000))
    keep[hole : hole + int(rng.integers(1, 900))] = False
    stamps, values = stamps[keep], values[keep]
    live = RollingAnalysis(window_s, 100.0, axes=3, units=UNITS)
    ends = np.sort(rng.integers(400, stamps.size, 5))
    for start, end in zip([0, *ends[:-1]], ends, strict=True):
        feed(live, stamps[start:end], values[start:end], sizes)
        window = live.snapshot()
        cut = stamps[:end] > stamps[end - 1] - round(window_s * 1e9)
        assert window.start_ns == stamps[:end][cut][0]
        assert window.end_ns == stamps[end - 1]
        if all(window.curves):
            assert_equal_to_batch(window, stamps[:end], values[:end])


@pytest.mark.slow
@pytest.mark.parametrize('length', [1, 40, 1500])
def test_a_huge_transient_leaves_nothing_behind(length):
    n = 20_000
    stamps, values = stamps_at(n, 100.0), noise(n)
    values[6000 : 6000 + length] += 1e6
    live = RollingAnalysis(40.0, 100.0, axes=3, units=UNITS)
    for start in range(0, n, 250):
        live.append(stamps[start : start + 250], values[start : start + 250])
        end = start + 250
        if end >= 5000 and end % 1000 == 0:
            assert_equal_to_batch(live.snapshot(), stamps[:end], values[:end])


def test_a_sensor_turned_over_leaves_nothing_behind():
    n = 30_000
    stamps, values = stamps_at(n, 100.0), 1e-3 * noise(n)
    values[8000:] += [-19.6, 0.0, 35.0]
    live = RollingAnalysis(50.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [333])
    assert_equal_to_batch(live.snapshot(), stamps, values)


@pytest.mark.slow
def test_snapshots_change_nothing():
    n = 8000
    stamps, values = stamps_at(n, 100.0), noise(n)
    often, once = (RollingAnalysis(30.0, 100.0, axes=3, units=UNITS) for _ in range(2))
    for start in range(0, n, 100):
        for live in (often, once):
            live.append(stamps[start : start + 100], values[start : start + 100])
        often.snapshot()
    first, second = often.snapshot(), once.snapshot()
    for a, b in zip(first.curves, second.curves, strict=True):
        assert a.deviation == pytest.approx(b.deviation, rel=1e-12)
    assert (first.start_ns, first.samples) == (second.start_ns, second.samples)


def test_bursts_with_equal_stamps_are_one_run():
    n = 30 * 300
    stamps = EPOCH + (np.arange(n) // 30 + 1) * 300_000_000
    values = noise(n)
    live = RollingAnalysis(60.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [30])
    window = live.snapshot()
    assert window.missing == 0
    assert window.curves[0].m[-1] > 1000
    assert_equal_to_batch(window, stamps, values)


def test_duplicates_and_order_faults_are_dropped_and_counted():
    n = 6000
    stamps, values = stamps_at(n, 100.0), noise(n)
    order = np.insert(np.arange(n), 3000, 2990)  # a sample sent again
    order = np.insert(order, 4000, order[3999])  # a sample twice
    stamps, values = stamps[order], values[order]
    live = RollingAnalysis(60.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [100])
    window = live.snapshot()
    assert (window.duplicates, window.order_faults) == (1, 1)
    assert window.samples in (5998, 5999, 6000)
    assert window.curves[0].m[-1] > 1000


def test_a_clock_set_back_starts_a_new_window():
    stamps, values = stamps_at(9000, 100.0), noise(9000)
    stamps[5000:] -= 10**12
    live = RollingAnalysis(60.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [100])
    window = live.snapshot()
    assert window.samples == 4000
    assert_equal_to_batch(window, stamps[5000:], values[5000:])


def test_a_long_hole_empties_the_window():
    stamps, values = stamps_at(9000, 100.0), noise(9000)
    stamps[5000:] += 10**13
    live = RollingAnalysis(60.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [100])
    window = live.snapshot()
    assert (window.samples, window.missing) == (4000, 0)


def test_an_axis_that_is_not_measured_has_no_curve():
    stamps, values = stamps_at(5000, 100.0), noise(5000)
    values[:, 1] = np.nan
    live = RollingAnalysis(20.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [100])
    window = live.snapshot()
    assert window.curves[1] is None
    assert not window.rms[1].observable
    assert window.left_out == 0
    assert window.curves[2].m[-1] > 500


def test_rows_that_are_not_finite_are_left_out_and_counted():
    stamps, values = stamps_at(5000, 100.0), noise(5000)
    values[4000, 0] = np.nan
    values[4500] = np.inf
    live = RollingAnalysis(20.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [100])
    window = live.snapshot()
    assert (window.left_out, window.missing) == (2, 2)
    good = np.isfinite(values).all(axis=1)
    assert_equal_to_batch(window, stamps[good], values[good])


def test_an_axis_that_begins_starts_a_new_window_and_one_that_dies_is_given_up():
    n = 12_000
    stamps, values = stamps_at(n, 100.0), noise(n)
    values[:2048, 2] = np.nan
    values[6144:, 0] = np.nan
    live = RollingAnalysis(10.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps[:6144], values[:6144], [2048])
    assert all(live.snapshot().curves)
    feed(live, stamps[6144:], values[6144:], [1024])
    window = live.snapshot()
    assert window.curves[0] is None
    assert window.curves[2] is not None
    assert window.end_ns == stamps[-1]


def test_equal_samples_have_no_deviation():
    stamps = stamps_at(5000, 100.0)
    live = RollingAnalysis(20.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, np.full((5000, 3), 9.81), [150])
    window = live.snapshot()
    assert window.std[0].value == 0.0
    assert window.mean[0].value == 9.81
    assert window.curves[0].deviation.max() < 1e-14


def test_a_sensor_much_faster_than_announced_is_said_to_be_truncated():
    stamps, values = stamps_at(30_000, 1000.0), noise(30_000)
    live = RollingAnalysis(20.0, 100.0, axes=3, units=UNITS)
    feed(live, stamps, values, [500])
    window = live.snapshot()
    assert window.truncated
    assert window.period_s == pytest.approx(1e-3, rel=1e-6)
    assert_equal_to_batch(window, stamps, values)


def test_a_sensor_much_slower_than_announced_is_analysed_at_its_own_rate():
    stamps, values = stamps_at(3000, 12.5), noise(3000)
    live = RollingAnalysis(60.0, 500.0, axes=3, units=UNITS)
    feed(live, stamps, values, [50])
    window = live.snapshot()
    assert window.missing == 0
    assert not window.truncated
    assert_equal_to_batch(window, stamps, values)


def test_memory_is_fixed_at_construction():
    live = RollingAnalysis(10.0, 100.0, axes=3, units=UNITS)
    before = live.nbytes
    feed(live, stamps_at(60_000, 100.0), noise(60_000), [1000])
    live.snapshot()
    assert live.nbytes == before


def test_the_memory_of_the_caller_is_not_kept():
    stamps, values = stamps_at(1000, 100.0), noise(1000)
    expected, live = (RollingAnalysis(5.0, 100.0, axes=3, units=UNITS) for _ in range(2))
    expected.append(stamps, values)
    mine, own = stamps.copy(), values.copy()
    live.append(mine, own)
    mine[:], own[:] = 0, 0.0
    assert live.snapshot().mean == expected.snapshot().mean


def test_too_few_samples():
    live = RollingAnalysis(5.0, 100.0, axes=3, units=UNITS)
    with pytest.raises(NotReady, match='wait'):
        live.snapshot()
    live.append([0, 10_000_000], np.zeros((2, 3)))
    with pytest.raises(NotReady):
        live.snapshot()
    live.append([20_000_000], np.ones((1, 3)))
    window = live.snapshot()
    assert window.samples == 3


def test_stamps_all_equal_at_the_start_do_not_stop_it():
    live = RollingAnalysis(5.0, 100.0, axes=3, units=UNITS)
    live.append(np.full(10, EPOCH), noise(10))
    with pytest.raises(NotReady, match='equal'):
        live.snapshot()
    stamps, values = stamps_at(3000, 100.0)[1:], noise(2999)
    feed(live, stamps, values, [100])
    assert_equal_to_batch(live.snapshot(), stamps, values)


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        ({'window_s': 0.0}, 'window_s'),
        ({'window_s': np.nan}, 'window_s'),
        ({'rate_hz': -1.0}, 'rate_hz'),
        ({'rate_hz': np.inf}, 'rate_hz'),
        ({'axes': 2, 'units': ['m/s²']}, 'unit each'),
        ({'axes': 4}, 'unit each'),
        ({'confidence': 1.0}, 'confidence'),
        ({'window_s': 0.02}, 'fewer than'),
        ({'taus': [1e-4]}, 'sample period'),
    ],
)
def test_wrong_arguments_are_named(arguments, text):
    with pytest.raises(DataError, match=text):
        RollingAnalysis(**({'window_s': 10.0, 'rate_hz': 100.0} | arguments))


@pytest.mark.parametrize(
    ('stamps', 'values'),
    [
        ([0, 1], np.zeros((2, 2))),
        ([0, 1], np.zeros((3, 3))),
        ([[0]], np.zeros((1, 3))),
        ([0.0, 0.01], np.zeros((2, 3))),
    ],
)
def test_wrong_blocks_are_named(stamps, values):
    live = RollingAnalysis(5.0, 100.0, axes=3, units=UNITS)
    with pytest.raises(DataError):
        live.append(stamps, values)


@pytest.mark.slow
def test_no_drift_over_two_million_samples():
    live = RollingAnalysis(5.0, 1000.0, axes=1, units=['rad/s'])
    rng = np.random.default_rng(3)
    n = 100_000
    for part in range(20):
        stamps = EPOCH + (part * n + np.arange(n)) * 1_000_000 + rng.integers(-50_000, 50_000, n)
        values = rng.normal(9.81, 0.01, (n, 1))
        values[50_000:50_100] += 1e4
        feed(live, stamps, values, rng.integers(1, 5000, 100).tolist())
        assert_equal_to_batch(live.snapshot(), stamps, values, ['rad/s'])
