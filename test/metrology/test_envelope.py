# SPDX-License-Identifier: Apache-2.0
"""
Envelopes of impacts that ring at a resonance: a generator that shares no line with the code.

Each blow starts a decaying oscillation, summed sample by sample; blows come at a fault frequency
with a random slip, as on a bearing (Randall and Antoni 2011, section 2).
"""

from imu_bench.errors import DataError
from imu_bench.metrology.trials.envelope import (
    bearing_frequencies,
    envelope,
    faults,
    squared_envelope,
)
import numpy as np
import pytest

RATE_HZ, SECONDS = 12_000.0, 12.0
RESOLUTION_HZ = 0.5
TOLERANCE_HZ = 0.3


def blows(
    rng, hz, *, strength=1.0, jitter=0.01, slip=0.0, resonance=3300.0, damping=800.0, load_hz=0.0
):
    """Return the ringing after blows every 1/hz; a jitter of None is without any order."""
    size = int(RATE_HZ * SECONDS)
    made = np.zeros(size)
    ring = np.arange(int(8.0 / damping * RATE_HZ)) / RATE_HZ
    at = 0.0
    while at < SECONDS:
        scatter = rng.exponential() if jitter is None else 1.0 + jitter * rng.standard_normal()
        at += scatter / (hz * (1.0 + slip))
        first = int(np.ceil(at * RATE_HZ))
        late = ring[: max(0, size - first)] + first / RATE_HZ - at
        force = strength * (1.0 + 0.8 * np.cos(2 * np.pi * load_hz * at) if load_hz else 1.0)
        made[first : first + late.size] += (
            force * np.exp(-damping * late) * np.sin(2 * np.pi * resonance * late)
        )
    return made


def measured(x, **options):
    return envelope(x, RATE_HZ, 'm/s²', resolution_hz=RESOLUTION_HZ, **options)


def noise(rng, sigma=1.0):
    return sigma * rng.standard_normal(int(RATE_HZ * SECONDS))


@pytest.mark.slow
def test_the_squared_envelope_is_that_of_the_definition():
    """Against the modulation that was put in, at the times of its samples."""
    time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    wave = 1.0 + 0.5 * np.cos(2 * np.pi * 20.0 * time)
    square, rate = squared_envelope(wave * np.sin(2 * np.pi * 3000.0 * time), RATE_HZ, (2e3, 4e3))
    seen = np.interp(time[500:-500], np.arange(square.size) / rate, square)
    assert seen == pytest.approx(wave[500:-500] ** 2, abs=0.01)


def test_blows_under_noise_are_found_by_how_often_they_come():
    """In the spectrum itself the noise hides them: a third of its power in all."""
    right = 0
    for seed in range(6):
        rng = np.random.default_rng([70, seed])
        found = measured(blows(rng, 107.4, strength=2.0) + noise(rng))
        assert found.band[0] < 3300.0 < found.band[1]
        strongest = found.tones[0].frequency
        right += abs(strongest.value - 107.4) < 0.3
    assert right == 6


@pytest.mark.slow
def test_noise_has_no_lines():
    """One axis of a hundred may: of 60, five would be one chance in 4000."""
    shown = sum(bool(measured(noise(np.random.default_rng([71, s]))).tones) for s in range(60))
    assert shown <= 4


def test_the_fault_that_is_there_is_seen_and_no_other():
    """A bearing of nine balls; its speed slips by 1 %, the inner race passes the load zone."""
    wanted = bearing_frequencies(29.95, 9, 7.94e-3, 39.04e-3)
    for seed, part in enumerate(('outer race', 'inner race', 'element') * 3):
        rng = np.random.default_rng([72, seed])
        load = {'inner race': 29.95, 'element': wanted['cage']}.get(part, 0.0)
        hz = wanted[part] * (2.0 if part == 'element' else 1.0)
        x = blows(rng, hz, strength=4.0, slip=-0.01, load_hz=load) + noise(rng)
        found = {one.name: one for one in faults(measured(x), wanted, TOLERANCE_HZ)}
        assert found[part].seen, (part, found[part])
        factor = found[part].frequency.value / (wanted[part] * 0.99)
        assert factor == pytest.approx(1.0, abs=3e-3)
        # the cage turns the element through the load zone: both are there
        others = {name for name, one in found.items() if one.seen} - {part}
        assert others <= ({'cage'} if part == 'element' else set())


@pytest.mark.slow
def test_a_sound_bearing_has_no_fault():
    """Noise, a gear with side bands of the shaft, and blows without any period."""
    wanted = bearing_frequencies(29.95, 9, 7.94e-3, 39.04e-3)
    seen = 0
    for seed in range(30):
        rng = np.random.default_rng([73, seed])
        time = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
        gear = (1.0 + 0.3 * np.cos(2 * np.pi * 29.95 * time)) * np.sin(2 * np.pi * 1138.1 * time)
        x = noise(rng) + gear + blows(rng, 40.0, jitter=None, strength=4.0)
        seen += sum(one.seen for one in faults(measured(x), wanted, TOLERANCE_HZ))
    assert seen <= 1


def test_lines_without_relation_are_no_fault():
    """Fifty lines anywhere: whatever frequencies are asked for, one in a hundred is seen."""
    rng = np.random.default_rng(74)
    found = measured(blows(rng, 107.4, strength=4.0) + noise(rng))
    tone, seen = found.tones[0], 0
    for _ in range(400):
        lines = tuple(
            type(tone)(tone.frequency.scaled(hz / tone.frequency.value, 'Hz'), *vars_of(tone))
            for hz in rng.uniform(2.0, found.spectrum.frequency[-1], 50)
        )
        crowded = type(found)(found.band, found.mean, found.spectrum, lines)
        seen += faults(crowded, {'it': rng.uniform(20.0, 200.0)}, TOLERANCE_HZ)[0].seen
    assert seen <= 12


def vars_of(tone):
    return tone.amplitude, tone.above_floor, tone.steady


def test_the_frequencies_of_a_bearing_as_its_maker_gives_them():
    """
    SKF 6205-2RS, multiples of the speed, as published with its test data.

    Case Western Reserve University, Bearing Data Center, "Bearing Information": inner ring
    5.4152, outer ring 3.5848, cage train 0.39828, rolling element 4.7135 (both of its blows).
    """
    found = bearing_frequencies(1.0, 9, 0.3126, 1.537)
    assert found['inner race'] == pytest.approx(5.4152, abs=6e-5)
    assert found['outer race'] == pytest.approx(3.5848, abs=6e-5)
    assert found['cage'] == pytest.approx(0.39828, abs=6e-5)
    assert 2.0 * found['element'] == pytest.approx(4.7135, abs=6e-4)
    with pytest.raises(DataError, match='no bearing'):
        bearing_frequencies(10.0, 9, 2.0, 1.0)


def test_a_band_that_is_none_is_refused():
    with pytest.raises(DataError, match='give a band between 0 and half the rate'):
        squared_envelope(np.zeros(1000), 100.0, (40.0, 60.0))
