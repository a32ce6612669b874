# SPDX-License-Identifier: Apache-2.0
"""Vibration in steps: what a sine of known amplitude leaves at each frequency."""

from imu_bench.errors import ConfigError, RecordingError
from imu_bench.offline import plans
from imu_bench.samples import Samples
from imu_bench.simulation.scenario import load_scenario
from imu_bench.simulation.tones import SteppedSine
import numpy as np
import pytest

G = 9.80665
STEPS = {'amplitude': '2 g', 'low': '40 Hz', 'step': '20 Hz', 'hold': '5 s'}


def shaken(recording_of, rate_hz=1000.0, seconds=25.0, gain=lambda f: 1.0):
    """Return sines written by hand: 40, 60 … 120 Hz on y, a tenth of it on z."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    frequency = 40.0 + 20.0 * np.floor(t / 5.0)
    wave = 2 * G * np.vectorize(gain)(frequency) * np.sin(2 * np.pi * frequency * t)
    force = np.column_stack([0 * t, wave, G + 0.1 * wave])
    noise = 0.01 * np.random.default_rng(2).normal(size=force.shape)
    stamps = 1_700_000_000_000_000_000 + np.round(t * 1e9).astype(np.int64)
    return recording_of(Samples(stamps, acceleration=force + noise))


def concluded(recordings, **settings):
    plan = plans.load('vibration-steps')({**STEPS, **settings})
    return plan.conclude([plan.measure('bag', recordings)])


def test_the_rms_of_a_sine_is_its_peak_over_the_root_of_two(recording_of):
    result = concluded([shaken(recording_of, gain=lambda f: 1.0 if f < 100 else 0.5)])
    (values,) = result.values.values()
    assert values['frequency'] == [40.0, 60.0, 80.0, 100.0, 120.0]
    found = {axis: [e['value'] for e in rms] for axis, rms in values['rms'].items()}
    full = 2 * G / np.sqrt(2)
    along = [full] * 3 + [full / 2] * 2
    assert found['linear_acceleration.y'] == pytest.approx(along, rel=1e-3)
    assert found['linear_acceleration.z'] == pytest.approx(np.array(along) / 10, rel=1e-2)
    assert found['linear_acceleration.x'] == pytest.approx([0.01] * 5, rel=0.1)
    assert '100 % of the 13.869 m/s² applied' in result.summary[0]
    assert 'across it at most' in result.summary[1]
    assert 'on z' in result.summary[1]
    (figure,) = result.figures
    assert [series.label for series in figure.series] == ['x', 'y', 'z', 'applied']


def test_a_frequency_above_half_the_rate_has_the_same_rms(recording_of):
    values = concluded([shaken(recording_of, rate_hz=119.0)]).values
    (one,) = values.values()
    found = [e['value'] for e in one['rms']['linear_acceleration.y']]
    assert found == pytest.approx([2 * G / np.sqrt(2)] * 5, rel=0.05)


def test_a_recording_without_a_whole_step_is_refused(recording_of):
    with pytest.raises(RecordingError, match='no step of 60 s'):
        concluded([shaken(recording_of)], hold='60 s')
    late = concluded([shaken(recording_of)], begin='5 s', low='60 Hz')
    (one,) = late.values.values()
    assert one['frequency'] == [60.0, 80.0, 100.0, 120.0]


@pytest.mark.slow
def test_the_simulated_steps_are_those_of_table_1():
    scenario = load_scenario('vibration_steps')
    assert scenario.duration_s == 99 * 25.0
    steps = SteppedSine(2 * G, 40.0, 2000.0, 20.0, 25.0, 'x')
    t = np.arange(0.0, 2475.0, 25.0) + 12.0
    assert steps.frequency(t).tolist() == list(range(40, 2001, 20))
    # the phase is that of the integral of the frequency, also where a step is no whole cycle
    odd = SteppedSine(1.0, 3.0, 9.0, 1.3, 0.7, 'y')
    fine = np.arange(0.0, 5.0, 1e-5)
    phase = 2 * np.pi * np.concatenate([[0.0], np.cumsum(odd.frequency(fine)[:-1] * 1e-5)])
    assert odd.specific_force(fine)[:, 1] == pytest.approx(np.sin(phase), abs=2e-3)
    with pytest.raises(ConfigError, match='stepped_sine: 50 Hz to 40 Hz'):
        SteppedSine(1.0, 50.0, 40.0, 20.0, 25.0)
