# SPDX-License-Identifier: Apache-2.0
"""Two sensors with clocks and rates of their own: offset, gain and coherence as put in."""

from imu_bench.errors import DataError
from imu_bench.metrology.spectra.response import compare, Trace
import numpy as np
import pytest


def motion(rng, low=3.0, high=80.0, tones=()):
    """Return a function of regular times: random vibration out of many sines, and tones."""
    frequency = np.concatenate([rng.uniform(low, high, 300), [f for f, _ in tones]])
    phase = np.concatenate([rng.uniform(0, 2 * np.pi, 300), np.zeros(len(tones))])
    amplitude = np.concatenate([np.full(300, 0.07), [a for _, a in tones]])

    def at(t):
        # sines of sums: one product of matrices instead of a sine for every sample
        coarse, fine = t[::256], (t[1] - t[0]) * np.arange(256)
        begins = amplitude * np.exp(1j * (2 * np.pi * np.outer(coarse, frequency) + phase))
        return (begins @ np.exp(2j * np.pi * np.outer(frequency, fine))).imag.ravel()[: t.size]

    return at


def sensor(at, rate, start, *, clock=0.0, gain=1.0, noise=0.02, seed=0, length=30.0):
    """Return the trace of a sensor whose clock is `clock` s ahead."""
    t = start + np.arange(round(length * rate)) / rate
    rng = np.random.default_rng(seed)
    return Trace(9.8 + gain * at(t) + noise * rng.normal(size=t.size), rate, start + clock)


@pytest.mark.parametrize('rates', [(400.0, 1003.9), (1003.9, 400.0), (952.0, 1003.9), (500, 500)])
def test_offset_and_gain_come_out(rates):
    at = motion(np.random.default_rng(1))
    own = sensor(at, rates[0], 0.0123, clock=0.0217, gain=0.93, seed=1)
    other = sensor(at, rates[1], 0.0, seed=2)
    found = compare(own, other, resolution_hz=1.0, low_hz=5.0, longest_offset_s=0.1)
    assert found.offset.value == pytest.approx(0.0217, abs=5e-5)
    middle = found.gain[(found.frequency > 5) & (found.frequency < 75)]
    assert np.median(middle) == pytest.approx(0.93, abs=0.005)
    assert found.coherence[(found.frequency > 5) & (found.frequency < 75)].min() > 0.8


@pytest.mark.parametrize('fast', [500.0, 1344.0, 4000.0])
def test_the_gain_holds_up_to_the_last_frequency_whatever_the_ratio_of_the_rates(fast):
    at = motion(np.random.default_rng(3), high=49.0)
    own = sensor(at, 100.0, 0.0, gain=0.9, noise=0.001, seed=1)
    other = sensor(at, fast, 0.0, noise=0.001, seed=2)
    found = compare(own, other, resolution_hz=1.0, low_hz=5.0, longest_offset_s=0.1)
    for low, high in ((5.0, 20.0), (35.0, 40.0)):
        part = found.gain[(found.frequency >= low) & (found.frequency <= high)]
        assert np.median(part) == pytest.approx(0.9, abs=0.004)


@pytest.mark.slow
def test_the_intervals_cover():
    inside = np.zeros(2)
    for seed in range(40):
        at = motion(np.random.default_rng(seed))
        own = sensor(at, 400.0, 0.0, clock=0.005, gain=0.9, noise=0.3, seed=seed + 100)
        other = sensor(at, 500.0, 0.0, noise=0.001, seed=seed + 200)
        found = compare(own, other, resolution_hz=1.0, low_hz=5.0, longest_offset_s=0.1)
        gain = found.at(40.0)
        inside += [
            found.offset.low <= 0.005 <= found.offset.high,
            gain.low <= 0.9 <= gain.high,
        ]
    assert np.all(inside >= 33)


def test_tones_do_not_mislead_the_offset():
    """A strong tone repeats itself every 37.5 ms; a little random vibration tells which is it."""
    at = motion(np.random.default_rng(3), tones=[(26.667, 30.0)])
    found = compare(
        sensor(at, 200.0, 0.0, clock=0.0021, seed=1), sensor(at, 1000.0, 0.0, seed=2),
        resolution_hz=0.5, low_hz=2.0, longest_offset_s=1.0,
    )  # fmt: skip
    assert found.offset.value == pytest.approx(0.0021, abs=2e-4)


def test_clocks_that_know_nothing_of_each_other():
    """One recording began 7.3 s later than the other."""
    at = motion(np.random.default_rng(4))
    late = sensor(at, 300.0, 7.3, clock=-7.3, seed=1)
    found = compare(late, sensor(at, 500.0, 0.0, seed=2), resolution_hz=0.5, low_hz=5.0)
    assert found.offset.value == pytest.approx(-7.3, abs=1e-3)


def test_upside_down_is_no_delay():
    at = motion(np.random.default_rng(5))
    found = compare(
        sensor(at, 400.0, 0.0, gain=-1.0, clock=0.003, seed=1), sensor(at, 400.0, 0.0, seed=2),
        resolution_hz=0.5, low_hz=5.0, longest_offset_s=0.1,
    )  # fmt: skip
    assert found.offset.value == pytest.approx(0.003, abs=1e-4)
    assert np.abs(np.abs(found.phase[20:100]) - np.pi).max() < 0.3


@pytest.mark.slow
def test_coherence_is_the_share_that_is_common():
    """Noise as strong as the signal: γ² = 1/2."""
    rng = np.random.default_rng(6)
    x = rng.normal(size=400_000)
    found = compare(
        Trace(x + rng.normal(size=x.size), 1000.0, 0.0), Trace(x, 1000.0, 0.0),
        resolution_hz=5.0, low_hz=20.0, longest_offset_s=0.05,
    )  # fmt: skip
    assert found.coherence.mean() == pytest.approx(0.5, abs=0.01)
    inside = (found.coherence_low <= 0.5) & (found.coherence_high >= 0.5)
    assert inside.mean() > 0.9


def test_outside_the_range_there_is_no_gain():
    at = motion(np.random.default_rng(7))
    found = compare(
        sensor(at, 100.0, 0.0, seed=1), sensor(at, 1000.0, 0.0, seed=2),
        resolution_hz=0.5, low_hz=5.0, longest_offset_s=0.1,
    )  # fmt: skip
    assert not found.at(53.3).observable
    assert '40 Hz' in found.at(53.3).reason


NOISE = np.random.default_rng(9).normal(size=6000)


@pytest.mark.parametrize(
    ('own', 'text'),
    [
        (Trace(NOISE, 100.0, 900.0), 'clocks are 900 s apart'),
        (Trace(np.zeros(6000), 100.0, 0.0), 'nothing in common'),
        (Trace(NOISE[3000:3150], 100.0, 30.0), 'they overlap for 1.4'),
    ],
)
def test_what_cannot_be_compared_is_said(own, text):
    base = Trace(NOISE, 100.0, 0.0)
    with pytest.raises(DataError, match=text):
        compare(own, base, resolution_hz=0.5, low_hz=5.0, longest_offset_s=0.1)
