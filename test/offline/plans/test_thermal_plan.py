# SPDX-License-Identifier: Apache-2.0
"""The thermal plan: whose temperature counts, and what it says without one."""

from dataclasses import replace

from imu_bench.errors import RecordingError
from imu_bench.offline.plans.thermal import Thermal
from imu_bench.samples import Samples
import numpy as np
import pytest


@pytest.fixture
def heated(recording_of):
    """Return a function that makes a recording that was heated, with its temperature or not."""

    def make(*, cooled=True, thermometer=True, coefficient=2e-3, **changes):
        when = np.arange(0.0, 2000.0, 0.1)
        end = 25.0 if cooled else 65.0
        celsius = np.interp(when, [300.0, 900.0, 1200.0, 1800.0], [25.0, 65.0, 65.0, end])
        rng = np.random.default_rng(2)
        force = rng.normal([0.0, 0.0, 9.8], 5e-3, (when.size, 3))
        force += coefficient * (celsius - 25.0)[:, None] * [1.0, -1.0, 0.0]
        run = Samples(
            (when * 1e9).astype(np.int64),
            acceleration=force,
            temperature=celsius if thermometer else None,
        )
        return recording_of(run, **changes)

    return make


def run(recordings, **options):
    plan = Thermal({}, **options)
    return plan.conclude([plan.measure('oven.mcap', recordings)])


def test_coefficients_of_every_axis(heated):
    result = run([heated()])
    axes = result.values['chip']['axes']
    for axis, expected in (('x', 2e-3), ('y', -2e-3), ('z', 0.0)):
        found = axes[f'linear_acceleration.{axis}']['coefficient']
        assert found['low'] < expected < found['high']
        assert found['unit'] == 'm/s²/K'
    assert result.findings == ()
    assert 'moves least' in result.summary[0]


def test_a_sensor_without_a_thermometer_takes_that_of_the_reference(heated):
    own = heated(topic='/bench/own/imu/data_raw')
    none = heated(thermometer=False, topic='/bench/none/imu/data_raw', source='no such bag')
    # alone it is left out
    assert list(run([own, none]).values) == ['own']
    result = run([none, own], reference='own')
    assert list(result.values) == ['own', 'none']
    assert [finding.code for finding in result.findings] == ['foreign_thermometer']


def test_no_temperature_is_one_clear_line(heated):
    with pytest.raises(RecordingError, match='no temperature in it') as said:
        run([heated(thermometer=False)])
    assert '\n' not in str(said.value)


def test_heating_alone_is_reported(heated):
    result = run([heated(cooled=False)])
    assert [finding.code for finding in result.findings] == ['not_cooled']
    hysteresis = result.values['chip']['axes']['linear_acceleration.x']['hysteresis']
    assert not hysteresis['observable']


def test_lost_samples_are_left_out(heated):
    recording = heated()
    force = recording.samples.acceleration.copy()
    force[5000:6000] = np.nan
    holed = replace(recording, samples=replace(recording.samples, acceleration=force))
    found = run([holed]).values['chip']['axes']['linear_acceleration.x']['coefficient']
    assert found['low'] < 2e-3 < found['high']


def test_a_recording_that_was_not_heated_names_itself(noise, recording_of):
    samples = replace(noise(), temperature=np.full(60_000, 25.0))
    with pytest.raises(RecordingError, match=r'night.mcap, .*changes by 0 K only'):
        run([recording_of(samples)])
