# SPDX-License-Identifier: Apache-2.0
"""Speed and way of a ride: a real lift with published numbers, and rides that are known."""

import csv

from imu_bench.errors import DataError
from imu_bench.metrology.trials.ride import find_ride, integrate_ride, Span
import numpy as np
import pytest


def profile(rate, speed=2.0, push=0.8, rest=6.0, cruise=10.0):
    """Return the acceleration of a ride, and its way."""
    lengths = [rest, speed / push, cruise, speed / push, rest]
    levels = [0.0, push, 0.0, -push, 0.0]
    parts = [np.full(round(s * rate), level) for s, level in zip(lengths, levels, strict=True)]
    return np.concatenate(parts), speed * (cruise + speed / push)


@pytest.mark.data
def test_a_real_lift_as_published(shared_data):
    """
    P. Rodríguez-Sánchez, elevator-tool: 0.93 m/s², 4.01 m/s, 74.30 m.

    There rows 200 to 1699 were chosen by hand and the mean taken off; here the same window,
    interpolated to a regular grid, differs by the interpolation alone.
    """
    path = shared_data / 'elevator_phone' / 'data' / 'skyscrapper_up.csv'
    with path.open(encoding='utf-8') as file:
        rows = [row for row in csv.DictReader(file) if row['AccZ']]
    t = np.array([float(row['relative_time']) for row in rows])[200:1700] / 1000
    z = np.array([float(row['AccZ']) for row in rows])[200:1700]
    rate = 200.0
    regular = np.interp(np.arange(t[0], t[-1], 1 / rate), t, z)
    ride = integrate_ride(regular, rate, Span(0, regular.size, 0, regular.size))
    assert ride.peak_acceleration.value == pytest.approx(0.93, abs=0.01)
    assert ride.peak_velocity.value == pytest.approx(4.01, abs=0.01)
    assert ride.travel.value == pytest.approx(74.30, abs=0.1)
    assert not ride.closing.observable


@pytest.mark.parametrize('bias', [0.0, 9.81, -0.5])
@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_a_constant_does_not_matter(bias, direction):
    a, way = profile(100.0)
    a = direction * a + bias + 0.02 * np.random.default_rng(1).normal(size=a.size)
    ride = integrate_ride(a, 100.0, find_ride(a, 100.0))
    assert ride.travel.value == pytest.approx(way, rel=0.01)
    assert ride.peak_velocity.value == pytest.approx(2.0, rel=0.01)


def test_the_intervals_cover_noise_and_a_bias_that_jumps():
    """Standing on one end, a sensor settles: its bias changes at a random moment of the ride."""
    rng = np.random.default_rng(2)
    inside = np.zeros(2)
    for _ in range(200):
        a, way = profile(100.0)
        a = a + 0.05 * rng.normal(size=a.size)
        a[rng.integers(600, a.size - 600) :] += 0.004 * rng.normal()
        ride = integrate_ride(a, 100.0, find_ride(a, 100.0))
        inside += [
            ride.travel.low <= way <= ride.travel.high,
            ride.peak_velocity.low <= 2.0 <= ride.peak_velocity.high,
        ]
    assert np.all(inside / 200 >= 0.85)


def test_handling_before_and_after_is_left_out():
    rng = np.random.default_rng(3)
    a, way = profile(100.0)
    hand = 3.0 * rng.normal(size=300)
    a = np.concatenate([hand, a + 9.8 + 0.02 * rng.normal(size=a.size), hand])
    span = find_ride(a, 100.0)
    assert 300 <= span.first < span.begin
    assert integrate_ride(a, 100.0, span).travel.value == pytest.approx(way, rel=0.02)


@pytest.mark.parametrize(
    ('make', 'text'),
    [
        (lambda rng: 0.02 * rng.normal(size=3000), 'nothing pushes it'),
        (lambda rng: np.sin(np.arange(3000)), 'nothing pushes it'),
        (lambda rng: np.r_[np.zeros(900), np.ones(300), np.zeros(900), -0.2 * np.ones(300),
                           np.zeros(900)], 'ends at rest'),
        (lambda rng: np.zeros(100), 'too short'),
    ],
)  # fmt: skip
def test_what_is_no_ride_is_said(make, text):
    with pytest.raises(DataError, match=text):
        find_ride(make(np.random.default_rng(4)), 100.0)
