# SPDX-License-Identifier: Apache-2.0
"""Filters, integrals, tones and their families against closed forms."""

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.filtering import moving_average, zero_phase
from imu_bench.metrology.spectra.tones import Tone
from imu_bench.metrology.trials.vibration import (
    crank_frequency,
    dominant,
    families,
    integrals,
    levels,
)
import numpy as np
import pytest

RATE = 1000.0
T = np.arange(60_000) / RATE


@pytest.mark.parametrize(('kind', 'frequency'), [('high_pass', 2.0), ('low_pass', 50.0)])
def test_a_filter_is_3_db_down_and_does_not_delay(kind, frequency):
    x = np.sin(2 * np.pi * frequency * T)
    y = zero_phase(x, RATE, **{kind: frequency})[5000:-5000]
    assert y.std() / x.std() == pytest.approx(np.sqrt(0.5), rel=1e-3)
    assert np.corrcoef(x[5000:-5000], y)[0, 1] == pytest.approx(1.0, abs=1e-6)


def test_the_band_of_the_thesis():
    """Section 5.2: 2 Hz to 50 Hz. What is inside stays, what is outside goes."""
    x = 9.81 + np.sin(2 * np.pi * 10 * T) + np.sin(2 * np.pi * 0.2 * T)
    x += np.sin(2 * np.pi * 300 * T)
    y = zero_phase(x, RATE, high_pass=2.0, low_pass=50.0)[5000:-5000]
    assert y.std() == pytest.approx(np.sqrt(0.5), rel=0.01)
    assert abs(y.mean()) < 1e-3


def test_a_moving_average_of_10_samples():
    x = np.sin(2 * np.pi * 50 * T)
    share = abs(np.sin(np.pi * 0.5) / (10 * np.sin(np.pi * 0.05)))
    assert moving_average(x, 10)[100:-100].std() / x.std() == pytest.approx(share, rel=1e-3)
    with pytest.raises(DataError, match='moving average of 0 steps'):
        moving_average(x, 0)


def test_a_filter_above_half_the_rate_is_refused():
    with pytest.raises(DataError, match='low-pass at 600 Hz needs a sample rate above 1200 Hz'):
        zero_phase(T, RATE, low_pass=600.0)


def test_velocity_and_displacement_of_a_sine_with_bias_and_drift():
    """Amplitudes a/ω and a/ω²; a bias of 0.1 m/s² alone would end 180 m away."""
    omega = 2 * np.pi * 20
    noise = 0.02 * np.random.default_rng(1).normal(size=T.size)
    velocity, displacement = integrals(np.sin(omega * T) + 9.9 + 1e-3 * T + noise, RATE, 2.0)
    inner = slice(5000, -5000)
    assert velocity[inner].std() == pytest.approx(np.sqrt(0.5) / omega, rel=0.02)
    assert displacement[inner].std() == pytest.approx(np.sqrt(0.5) / omega**2, rel=0.1)


def test_levels_of_a_sine():
    found = levels(2.0 * np.sin(2 * np.pi * 20 * T), 'm/s²')
    assert found.peak.value == pytest.approx(2.0, rel=5e-3)
    assert found.peak_to_peak.value == pytest.approx(4.0, rel=5e-3)
    assert found.rms.value == pytest.approx(np.sqrt(2.0), rel=1e-3)
    assert found.crest_factor.low <= np.sqrt(2.0) <= found.crest_factor.high
    assert not levels(np.ones(1000), 'm/s²').crest_factor.observable


def engine(rng, wander):
    """Four cylinders at 800 rpm whose speed wanders; amplitudes of orders 1, 2, 4 and 6."""
    phase = 2 * np.pi * np.cumsum(1 + wander * np.sin(2 * np.pi * T / 11.0)) * 800 / 60 / RATE
    parts = {1: 0.15, 2: 1.2, 4: 0.6, 6: 0.3}
    x = sum(a * np.sin(order * phase + rng.uniform(0, 6)) for order, a in parts.items())
    return x + 0.2 * rng.normal(size=T.size)


@pytest.mark.slow
@pytest.mark.parametrize('wander', [0.0, 0.003])
def test_tones_of_an_engine_lie_in_their_intervals(wander):
    inside = np.zeros(2)
    for seed in range(30):
        _, found = dominant(
            engine(np.random.default_rng(seed), wander), RATE, 'm/s²', resolution_hz=0.5
        )
        frequency, amplitude = found[0].frequency, found[0].amplitude
        assert frequency.value == pytest.approx(26.667, abs=0.02)
        inside += [
            frequency.low <= 26.6667 <= frequency.high,
            amplitude.low <= 1.2 <= amplitude.high,
        ]
    assert np.all(inside >= 24)


def test_the_family_of_an_engine_and_its_speed():
    _, found = dominant(engine(np.random.default_rng(1), 0.003), RATE, 'm/s²', resolution_hz=0.5)
    [family] = families(found, 0.3)
    assert [order for order, _ in family.members] == [1, 2, 4, 6]
    assert family.fundamental.value == pytest.approx(13.333, abs=0.01)
    speed = crank_frequency(family.strongest.frequency, 4).to('rpm')
    assert speed.low <= 800.0 <= speed.high


def test_a_thud_is_no_tone():
    rng = np.random.default_rng(2)
    x = 0.01 * rng.normal(size=T.size)
    late = T[T >= 20.0] - 20.0
    x[T >= 20.0] += np.exp(-3.0 * late) * np.sin(2 * np.pi * 12.0 * late)
    assert dominant(x, RATE, 'm/s²', resolution_hz=0.5)[1] == ()


def test_tones_that_are_no_multiples_are_no_family():
    def tone(frequency, amplitude):
        return Tone(
            Estimate(frequency, None, None, 'Hz'),
            Estimate(amplitude, None, None, 'm/s²'),
            9.0,
            True,
        )

    assert families([tone(10.0, 1.0), tone(17.3, 0.5)], 0.3) == ()
    first, second = families(
        [tone(10.0, 1.0), tone(20.01, 0.5), tone(33.0, 0.4), tone(66.0, 0.2)], 0.02
    )
    assert first.fundamental.value == 10.0
    assert second.fundamental.value == 33.0


def test_an_engine_without_cylinders_is_refused():
    with pytest.raises(DataError, match='has cylinders'):
        crank_frequency(Estimate(26.7, None, None, 'Hz'), 0)


def lines(frequencies, amplitudes):
    """Return tones without uncertainty."""
    return [
        Tone(Estimate(f, None, None, 'Hz'), Estimate(a, None, None, 'm/s²'), 1e3, True)
        for f, a in zip(frequencies, amplitudes, strict=True)
    ]


@pytest.mark.slow
def test_tones_without_relation_form_no_families():
    """Two hundred tones up to 6 kHz, as on a bearing test rig: many near multiples of others."""
    made = 0
    for seed in range(40):
        rng = np.random.default_rng([60, seed])
        tones = lines(rng.uniform(5.0, 6000.0, 200), rng.exponential(size=200))
        made += len(families(tones, 0.7))
    assert made <= 12


@pytest.mark.slow
def test_a_fault_among_them_is_found_by_its_fundamental():
    """Its sixth harmonic is the strongest of all, at a resonance."""
    right = 0
    for seed in range(20):
        rng = np.random.default_rng([61, seed])
        others = rng.uniform(5.0, 6000.0, 100)
        harmonics = 162.2 * np.arange(1, 13)
        tones = lines(
            np.concatenate([others, harmonics + rng.uniform(-0.2, 0.2, 12)]),
            np.concatenate([rng.exponential(0.1, 100), [1, 2, 3, 4, 6, 9, 7, 5, 3, 2, 1, 1]]),
        )
        found = families(tones, 0.7)
        right += abs(found[0].fundamental.value - 162.2) < 0.3
    assert right >= 18
