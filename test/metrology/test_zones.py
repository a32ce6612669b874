# SPDX-License-Identifier: Apache-2.0
"""Quiet and shaken parts are found where they are."""

from imu_bench.errors import DataError
from imu_bench.metrology.trials.zones import power, runs, shaken, Zone
import numpy as np
import pytest

RATE = 119.0


def recording(*lengths, loud=1.0, quiet=0.01):
    """Quiet and loud by turns, s each, on three axes."""
    rng = np.random.default_rng(1)
    parts = [
        (loud if number % 2 else quiet) * rng.normal(size=(round(length * RATE), 3))
        for number, length in enumerate(lengths)
    ]
    return np.concatenate(parts) + np.array([0.0, 0.0, 9.8])


def found(data, shortest=5.0):
    level, block = power(data, RATE)
    return shaken(level, block, shortest)


def test_three_zones():
    [zone] = found(recording(30, 60, 30))
    assert zone.begin_s == pytest.approx(30.0, abs=0.51)
    assert zone.end_s == pytest.approx(90.0, abs=0.51)
    [run] = runs([zone], 120.0, 5.0)
    assert run.before.length_s == pytest.approx(30.0, abs=0.51)
    assert run.after.end_s == 120.0


def test_repetitions_in_one_recording():
    data = recording(30, 40, 60, 40, 60, 40, 30)
    zones = found(data)
    assert len(zones) == 3
    first, second, _ = runs(zones, 300.0, 5.0)
    # the quiet part between two belongs half to each
    assert first.after.end_s == second.before.begin_s == pytest.approx(100.0, abs=1.0)


def test_knocks_and_pauses_are_no_zones():
    data = recording(30, 1, 29, 30, 1, 30, 30)
    [zone] = found(data)
    assert zone.begin_s == pytest.approx(60.0, abs=0.6)
    assert zone.end_s == pytest.approx(121.0, abs=0.6)


def test_without_a_quiet_part_there_is_no_zone_before():
    [run] = runs(found(recording(1, 60, 30)), 91.0, 5.0)
    assert run.before is None
    assert run.after is not None


@pytest.mark.parametrize('data', [recording(100), recording(50, 50, loud=0.012)])
def test_what_is_all_alike_has_no_zones(data):
    with pytest.raises(DataError, match='dB above the quiet one'):
        found(data)


def test_too_short_and_dead_recordings_are_said():
    with pytest.raises(DataError, match='too short'):
        power(np.zeros((40, 3)), RATE)
    with pytest.raises(DataError, match='nothing moves'):
        found(np.zeros((4000, 3)))


def test_a_guard_leaves_half_of_a_zone():
    assert Zone(10.0, 20.0).inside(2.0) == Zone(12.0, 18.0)
    assert Zone(10.0, 14.0).inside(2.0) == Zone(11.0, 13.0)
