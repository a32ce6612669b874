# SPDX-License-Identifier: Apache-2.0
"""Packet counter and sample time: what is missing, and where a device began anew."""

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.bus.framing.xbus import FrameCounter
import numpy as np
import pytest

DAY = 864_000_000


def frames(numbers, first_tick=0, rate=400):
    numbers = np.asarray(numbers)
    return numbers % 65536, (first_tick + numbers * (10_000 // rate)) % DAY


def test_nothing_is_missing_across_both_wraps():
    counter = FrameCounter(400.0)
    numbers = np.arange(65_000, 66_000)
    for part in np.split(numbers, 10):
        found = counter.take(*frames(part, DAY - 65_500 * 25))
        assert not found.missing.any()
        assert not found.jumped
        np.testing.assert_array_equal(found.ages_ns, (part[-1] - part) * 2_500_000)


@given(
    st.lists(st.integers(1, 30), min_size=2, max_size=60),
    st.integers(1, 20),
    st.sampled_from([400, 100, 80, 16, 1]),
)
def test_every_gap_is_counted_wherever_a_reading_ends(steps, size, rate):
    numbers = np.cumsum(steps)
    counter = FrameCounter(float(rate))
    missing = np.concatenate(
        [
            counter.take(*frames(numbers[k : k + size], 123, rate)).missing
            for k in range(0, len(numbers), size)
        ]
    )
    assert missing[0] == 0
    assert missing[1:].tolist() == [step - 1 for step in steps[1:]]


@pytest.mark.parametrize(
    ('counter', 'ticks'),
    [
        ([0, 1], [25, 50]),  # began anew
        ([1004, 1005], [25_200, 25_225]),  # the clock jumped, the counter did not
        ([1005, 1006], [25_100, 25_125]),  # a frame twice as old as it says
        ([1003, 1004], [25_075, 25_100]),  # a frame twice
        ([1014, 1015], [25_100, 25_125]),  # the counter jumped
    ],
)
def test_what_counter_and_clock_tell_apart_is_a_jump(counter, ticks):
    followed = FrameCounter(400.0)
    numbers = np.arange(1000, 1004)
    followed.take(*frames(numbers))
    found = followed.take(np.array([*counter]), np.array([*ticks]))
    assert found.jumped
    assert len(found.missing) == 0
    assert len(found.ages_ns) == 0


def test_frames_before_a_jump_are_good():
    found = FrameCounter(400.0).take(np.array([7, 8, 0, 1]), np.array([175, 200, 25, 50]))
    assert found.jumped
    assert found.missing.tolist() == [0, 0]
    assert found.ages_ns.tolist() == [2_500_000, 0]


def test_beginning_anew_is_no_jump_when_it_is_known():
    followed = FrameCounter(400.0)
    followed.take(*frames(np.arange(10)))
    followed.begin()
    assert not followed.take(np.array([40_000]), np.array([1])).jumped
