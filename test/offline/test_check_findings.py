# SPDX-License-Identifier: Apache-2.0
"""Findings that the finished axes make: said once, with names; a sensor that moved makes none."""

from dataclasses import replace
import re

from imu_bench.bags.topic_info import describe, OfferedQos
from imu_bench.bags.writer import BagWriter
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.recording import analyse, axis_findings
from imu_bench.offline.recordings import load_all, open_source, ReadOptions
from imu_bench.samples import Samples
from msg_conversions import cdr
from msg_conversions.encoding import ImuTemplate, Template
import numpy as np
import pytest


def louder_at_the_end(samples):
    acceleration = np.array(samples.acceleration)
    middle = len(samples) // 2
    acceleration[middle:, 1] += np.random.default_rng(9).normal(0.0, 0.03, middle)
    return replace(samples, acceleration=acceleration)


def test_steady_noise_makes_none(recording_of, noise):
    result = analyse(recording_of(noise(5)))
    assert result.health.findings == ()


def test_a_change_is_a_warning_that_names_the_axis(recording_of, noise):
    result = analyse(recording_of(louder_at_the_end(noise(6))))
    [finding] = [f for f in result.health.findings if f.code == 'unsteady_noise']
    assert finding.severity == 'warning'
    assert 'linear_acceleration.y by a factor of 1.9' in finding.text
    assert 'linear_acceleration.x' not in finding.text
    assert result.health.severity == 'warning'


@pytest.mark.slow
def test_a_sensor_that_was_shaken_for_a_while_is_not_to_be_trusted(recording_of, noise):
    """As on a machine that runs for a part of the recording, and stays where it is."""
    samples = noise(6)
    acceleration = np.array(samples.acceleration)
    shaken = slice(len(samples) // 3, None)  # most of the time: rest is the exception
    time = np.arange(len(samples))[shaken, None]
    acceleration[shaken] += 1.0 * np.sin(2.0 * np.pi * 0.217 * time)
    result = analyse(recording_of(replace(samples, acceleration=acceleration)))
    [finding] = [f for f in result.health.findings if f.code == 'unsteady_noise']
    assert finding.severity == 'severe'
    assert 'shook' in finding.effect
    assert result.health.severity == 'severe'


def test_what_follows_from_a_coarse_resolution_is_not_said_again(recording_of, noise):
    samples = louder_at_the_end(noise(6))
    step = 0.2
    coarse = replace(samples, acceleration=np.round(samples.acceleration / step) * step)
    result = analyse(recording_of(coarse))
    axes = list(result.axes.values())
    names = {f'linear_acceleration.{letter}' for letter in 'xyz'}
    said = [f.code for f in axis_findings(axes, moved=False)]
    codes = [f.code for f in result.health.findings]
    assert 'unsteady_noise' in said and 'resolution' in codes
    assert not {'unsteady_noise', 'methods_disagree'} & set(codes)
    assert result.health.coarse <= names


def test_many_axes_are_not_all_named(recording_of, noise):
    samples = noise(7)
    ramp = np.linspace(0.5, 2.0, len(samples))[:, None]
    loud = replace(
        samples,
        acceleration=samples.acceleration * [0, 0, 1] + ramp * noise(8).acceleration,
        angular_velocity=ramp * samples.angular_velocity,
    )
    axes = list(analyse(recording_of(loud)).axes.values())
    [finding] = [f for f in axis_findings(axes, moved=False) if f.code == 'unsteady_noise']
    assert finding.text.count('factor') == 4
    assert 'and 2 more' in finding.text
    assert [f for f in axis_findings(axes, moved=True) if f.code == 'unsteady_noise'] == []


def test_a_contradiction_of_the_spectrum_names_the_coefficient(recording_of, noise):
    axis = analyse(recording_of(noise(9))).axes['angular_velocity.z']
    second = replace(axis.checks.second, disagreements=('N from here is 1 to 2, from there 3',))
    changed = replace(axis, checks=replace(axis.checks, second=second))
    [finding] = axis_findings([changed], moved=False)
    assert finding.code == 'methods_disagree'
    assert 'N of angular_velocity.z' in finding.text


@pytest.mark.slow
def test_a_knock_is_no_crowd_of_tones(recording_of, noise):
    samples = noise(10)
    acceleration, time = np.array(samples.acceleration), np.arange(len(samples)) / 100.0
    acceleration[:, 0] += 0.06 * np.sin(2.0 * np.pi * 7.0 * time)
    knock = np.random.default_rng(3).normal(0.0, 1.0, (300, 3))
    acceleration[3000:3300] += knock
    result = analyse(recording_of(replace(samples, acceleration=acceleration)))
    assert len(result.axes['linear_acceleration.y'].psd.tones) > 12
    told = [f.text for f in result.health.findings if f.code == 'tones']
    assert len(told) == 1
    assert told[0].startswith('Tones: 7.00 Hz')
    assert 'more' not in told[0]


def drifting(samples, celsius, per_kelvin):
    """Return samples of one axis whose bias follows a temperature, which they hold as well."""
    rates = np.full((len(samples), 3), np.nan)
    rates[:, 0] = samples.angular_velocity[:, 0] + per_kelvin * (celsius - celsius[0])
    return Samples(samples.stamps, angular_velocity=rates, temperature=celsius)


def heater(n, period_s=120.0):
    """Return a temperature that goes up and down, as beside a heater."""
    time = np.arange(n) / 100.0
    return 30.0 + 0.5 * np.sin(2.0 * np.pi * time / period_s)


def bias_moves(result):
    [finding] = [f for f in result.health.findings if f.code == 'bias_moves']
    return finding.text


def test_a_bias_that_moves_with_the_temperature_says_by_how_much(recording_of, noise):
    """A finding said that the bias cycles, and nothing that the temperature did as well."""
    samples = drifting(noise(11), heater(60_000), 2e-4)
    said = bias_moves(analyse(recording_of(samples)))
    assert 'It follows the temperature, 29.5 to 30.5 °C: angular_velocity.x by (' in said
    value, error = re.search(r'by \(([0-9.]+) ± ([0-9.]+)\)×10⁻⁴ rad/s/K\.', said).groups()
    assert abs(float(value) - 2.0) <= float(error) < 0.5
    no_thermometer = analyse(recording_of(replace(samples, temperature=None)))
    assert 'temperature' not in bias_moves(no_thermometer)


@pytest.mark.parametrize('kind', ['another period', 'warm-up', 'noise of the thermometer'])
def test_another_temperature_is_not_the_cause(recording_of, noise, kind):
    """Of a bias that cycles, and of one that steps."""
    n = 60_000
    rng = np.random.default_rng(12)
    other = {
        'another period': heater(n, 47.0),
        'warm-up': 35.0 - 10.0 * np.exp(-np.arange(n) / 15_000),
        'noise of the thermometer': 30.0 + rng.normal(0.0, 0.1, n),
    }[kind]
    for cause in (heater(n), 4.0 * (np.arange(n) > 33_000)):
        samples = replace(drifting(noise(13), cause, 1e-4), temperature=other)
        assert 'It does not follow the temperature, ' in bias_moves(analyse(recording_of(samples)))


def test_the_temperature_may_be_a_topic_beside(noise, tmp_path):
    samples = drifting(noise(14), heater(60_000), 2e-4)
    imu, warm = '/bench/chip/imu/data_raw', '/bench/chip/temperature'
    with BagWriter(tmp_path / 'bag', 'mcap') as bag:
        bag.add_topic(describe(imu, 'sensor_msgs/msg/Imu', [OfferedQos()]))
        bag.add_topic(describe(warm, 'sensor_msgs/msg/Temperature', [OfferedQos()]))
        rows = ImuTemplate('link').imu_rows(samples.stamps, None, samples.angular_velocity)
        bag.write_many(imu, samples.stamps, rows)
        slow = samples.stamps[::100]
        part = (cdr.TEMPERATURE_VALUE, samples.temperature[::100, None])
        bag.write_many(warm, slow, Template('link', (0.0, 0.0)).rows(slow, part))
    with open_source(tmp_path / 'bag', ReadOptions()) as source:
        [recording] = load_all(source, source.select())
    result = analyse(recording)
    assert 'It follows the temperature, 29.5 to 30.5 °C' in bias_moves(result)
    assert result.health.temperature == pytest.approx((30.5, 29.5), abs=0.6)
    found = result.axes['angular_velocity.x'].temperature
    assert found.coefficient.low <= 2e-4 <= found.coefficient.high
    assert found.coefficient.unit == 'rad/s/K'
    again = AxisResult.from_json('angular_velocity.x', result.axes['angular_velocity.x'].to_json())
    assert again.temperature == found


@pytest.mark.parametrize('per_kelvin', [0.0, 2e-5])
def test_a_slow_rise_gives_a_coefficient_with_its_interval(recording_of, noise, per_kelvin):
    """No finding is needed for it: a bias that follows the temperature may look like noise."""
    samples = drifting(noise(15), 25.0 + np.arange(60_000) / 6_000.0, per_kelvin)
    result = analyse(recording_of(samples))
    found = result.axes['angular_velocity.x'].temperature
    assert found.telling
    assert (found.low, found.high) == pytest.approx((25.0, 35.0), abs=0.02)
    assert found.coefficient.low <= per_kelvin <= found.coefficient.high
    assert found.coefficient.high - found.coefficient.low < 2e-5


def test_a_room_that_keeps_its_temperature_tells_nothing(recording_of, noise):
    samples = replace(noise(16), temperature=np.full(60_000, 25.0))
    assert all(axis.temperature is None for axis in analyse(recording_of(samples)).axes.values())
