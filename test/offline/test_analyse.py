# SPDX-License-Identifier: Apache-2.0
"""The analysis gives what was put into simulated samples, gaps or not."""

from dataclasses import replace

from imu_bench.errors import RecordingError
from imu_bench.metrology import allan
from imu_bench.metrology.coefficients import fit, noise_density
from imu_bench.metrology.rolling import RollingAnalysis
from imu_bench.offline.analysis.recording import analyse, cut, Settings
from imu_bench.samples import Samples
import numpy as np
import pytest
from scipy import signal

ROOT2 = np.sqrt(2.0)


def test_white_noise(recording_of, noise):
    result = analyse(recording_of(noise()))
    axis = result.axes['linear_acceleration.x']
    assert axis.model.N.low <= 2e-3 <= axis.model.N.high
    assert axis.noise_density.value == pytest.approx(ROOT2 * axis.model.N.value)
    assert axis.statistics['std'].value == pytest.approx(2e-2, rel=0.02)
    assert axis.statistics['rms'].value == pytest.approx(2e-2, rel=0.02)
    for estimate in axis.noise_density_methods.values():
        assert estimate.value == pytest.approx(ROOT2 * 2e-3, rel=0.05)
    assert result.health.rate.value == pytest.approx(100.0, rel=1e-6)


@pytest.mark.slow
def test_a_gap_does_not_bias(recording_of, noise):
    samples = noise()
    keep = np.ones(len(samples), dtype=bool)
    keep[20_000:25_000] = False
    part = Samples(
        samples.stamps[keep], samples.acceleration[keep], samples.angular_velocity[keep]
    )
    axis = analyse(recording_of(part)).axes['angular_velocity.y']
    assert axis.allan.samples == 55_000
    assert axis.allan.span == 60_000
    assert axis.model.N.low <= 1e-4 <= axis.model.N.high
    assert np.isnan(axis.envelope.low).sum() == pytest.approx(5000 / 60, abs=2)


def test_axes_of_nan_are_not_analysed(recording_of, noise):
    samples = noise(n=5000)
    acceleration = np.array(samples.acceleration)
    acceleration[:, :2] = np.nan
    result = analyse(recording_of(replace(samples, acceleration=acceleration)))
    assert [axis.letter for axis in result.of('linear_acceleration')] == ['z']


@pytest.mark.slow
def test_a_low_pass_around_zero_is_no_high_pass(recording_of, noise):
    samples = noise()
    sections = signal.butter(2, 8.0, fs=100.0, output='sos')
    slow = signal.sosfilt(sections, samples.angular_velocity, axis=0)
    slow -= slow.mean(axis=0)
    axis = analyse(recording_of(replace(samples, angular_velocity=slow))).axes[
        'angular_velocity.x'
    ]
    assert axis.shows_constants
    assert axis.coefficient('N').low <= 1e-4 <= axis.coefficient('N').high


def test_a_constant_axis_has_no_noise(recording_of, noise):
    samples = noise(n=5000)
    gyro = np.array(samples.angular_velocity)
    gyro[:, 0] = 0.0
    axis = analyse(recording_of(replace(samples, angular_velocity=gyro))).axes[
        'angular_velocity.x'
    ]
    assert axis.statistics['std'].value == 0.0
    assert not axis.noise_density.observable
    assert axis.model.terms == ''


def test_asked_for_averaging_times(recording_of, noise):
    result = analyse(recording_of(noise(n=5000)), Settings(taus=(0.1, 1.0)))
    np.testing.assert_allclose(result.axes['linear_acceleration.x'].allan.tau, [0.1, 1.0])


def test_a_window_is_exact(recording_of, noise):
    samples = noise(n=5000)
    window = (int(samples.stamps[1000]), int(samples.stamps[3999]))
    result = analyse(recording_of(samples), Settings(window_ns=window))
    assert (result.start_ns, result.end_ns) == window
    assert result.health.samples == 3000
    direct = allan.deviation(
        samples.acceleration[1000:4000, 0], 1.0 / result.health.timing.period_s, unit='m/s²'
    )
    np.testing.assert_array_equal(
        result.axes['linear_acceleration.x'].allan.deviation, direct.deviation
    )


@pytest.mark.slow
def test_a_live_window_is_computed_again_exactly(recording_of, noise):
    samples = noise(n=30_000, jitter_s=2e-4)
    keep = np.ones(len(samples), dtype=bool)
    keep[22_000:22_050] = False
    stamps = samples.stamps[keep]
    both = np.hstack([samples.acceleration, samples.angular_velocity])[keep]
    live = RollingAnalysis(window_s=100.0, rate_hz=100.0)
    for first in range(0, stamps.size, 137):
        live.append(stamps[first : first + 137], both[first : first + 137])
    window = live.snapshot()
    recording = recording_of(Samples(stamps, both[:, :3], both[:, 3:]))
    again = analyse(recording, Settings(window_ns=(window.start_ns, window.end_ns)))
    assert again.health.samples == window.samples
    assert again.health.missing == window.missing == 50
    for axis, curve, rms in zip(again.axes.values(), window.curves, window.rms, strict=True):
        np.testing.assert_allclose(axis.allan.deviation, curve.deviation, rtol=1e-9)
        np.testing.assert_allclose(axis.allan.low, curve.low, rtol=1e-9)
        np.testing.assert_allclose(axis.allan.high, curve.high, rtol=1e-9)
        assert axis.statistics['rms'].value == pytest.approx(rms.value, rel=1e-9)
        live_density = noise_density(fit(curve))
        assert axis.noise_density.value == pytest.approx(live_density.value, rel=1e-9)


def test_start_and_end(recording_of, noise):
    recording = recording_of(noise(n=5000))
    assert len(cut(recording, Settings(start_s=10.0, end_s=20.0)).samples) == 1001
    assert len(cut(recording, Settings(start_s=49.0)).samples) == 100
    says = 'no sample from 60 s on, counted from the first one; the last one is at 49.99 s$'
    with pytest.raises(RecordingError, match=says):
        cut(recording, Settings(start_s=60.0))
    with pytest.raises(RecordingError, match='no sample between 60 and 70 s, '):
        cut(recording, Settings(start_s=60.0, end_s=70.0))


@pytest.mark.parametrize(
    ('settings', 'words'),
    [
        ({'taus': (0.0,)}, '--tau 0'),
        ({'taus': (float('nan'),)}, '--tau nan'),
        ({'start_s': 5.0, 'end_s': 5.0}, 'after the start'),
    ],
)
def test_settings_that_make_no_sense(settings, words):
    with pytest.raises(RecordingError, match=words):
        Settings(**settings)


def test_too_few_samples(recording_of, noise):
    with pytest.raises(RecordingError, match=r'night.mcap, topic .*: 5 samples are too few'):
        analyse(recording_of(noise(n=5)))


def test_averaging_times_that_do_not_fit_are_refused_by_name(recording_of, noise):
    with pytest.raises(RecordingError, match=r'night.mcap, topic .*0.001 s is below'):
        analyse(recording_of(noise(n=1000)), Settings(taus=(0.001,)))


def test_progress_reaches_the_end(recording_of, noise):
    seen = []
    analyse(recording_of(noise(n=1000)), progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (6, 6)


def test_a_tone_becomes_a_finding(recording_of, noise):
    samples = noise(n=60_000, rate=400.0)
    time = np.arange(60_000) / 400.0
    hum = 0.02 * np.sin(2 * np.pi * 50.0 * time)[:, None]
    result = analyse(recording_of(replace(samples, acceleration=samples.acceleration + hum)))
    [tone] = [f for f in result.health.findings if f.code == 'tones']
    assert '50.0 Hz' in tone.text
    assert 'mains' in tone.text
