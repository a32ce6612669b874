# SPDX-License-Identifier: Apache-2.0
"""What a reader of the tables must see: motion, impossible values, a scale that is off."""

from dataclasses import replace
import io

from imu_bench.offline import health
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.comparing.sensors import compare
from imu_bench.offline.presentation import axis_tables
from imu_bench.terminal import tables as table
import numpy as np
import pytest
from rich.console import Console


def found(recording_of, samples, code):
    state = health.check(recording_of(samples))
    return [f for f in state.findings if f.code == code]


def shown(result):
    out = Console(width=200, record=True, file=io.StringIO())
    table.show(Analysis((result,)), compare([result]), out)
    return out.export_text()


@pytest.mark.slow
def test_a_recording_that_moved_is_marked_in_the_tables(recording_of, noise):
    samples = noise(1, n=20_000)
    rates = samples.angular_velocity.copy()
    rates[10_000:13_000, 2] += 0.5
    still, moved = (
        analyse(recording_of(s)) for s in (samples, replace(samples, angular_velocity=rates))
    )
    assert '†' not in shown(still)
    text = shown(moved)
    assert text.count('†') > 1 and 'N, B and K describe the motion' in text
    page = axis_tables.coefficients(moved.of('angular_velocity'), moved.health)
    assert [c.title for c in page.columns if c.title.startswith('N,')] == ['N, white noise †']
    assert 'moved during the recording' in page.note
    plain = axis_tables.coefficients(still.of('angular_velocity'), still.health)
    assert not plain.note and not any('†' in c.title for c in plain.columns)


def test_impossible_values_are_shown_with_time_and_value(recording_of, noise):
    samples = noise(2, n=5000)
    rates = samples.angular_velocity.copy()
    rates[1234, 1], rates[2000:2003, 1] = 38342.0, -40000.0
    (finding,) = found(recording_of, replace(samples, angular_velocity=rates), 'impossible')
    assert finding.severity == 'severe' and finding.text.startswith('4 values')
    assert '38342 rad/s at t = 12.3' in finding.text and 'and 1 more' in finding.text
    assert not found(recording_of, samples, 'impossible')


@pytest.mark.parametrize(('scale', 'count'), [(1.0, 0), (1.015, 0), (1.03, 1), (0.96, 1)])
def test_gravity_that_is_off_by_more_than_two_per_cent_is_a_finding(
    recording_of, noise, scale, count
):
    samples = noise(3, n=5000)
    off = replace(samples, acceleration=np.asarray(samples.acceleration) * scale)
    findings = found(recording_of, off, 'gravity_scale')
    assert len(findings) == count
    if count:
        assert ('above' if scale > 1.0 else 'below') in findings[0].text
