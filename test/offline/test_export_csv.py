# SPDX-License-Identifier: Apache-2.0
"""Every number of a result comes back out of its table."""

import csv
from dataclasses import replace
import io

from imu_bench.metrology.markov.gauss_markov import Process
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.exports import render
import numpy as np
import pytest


@pytest.fixture(scope='module')
def result(recording_of, noise):
    """Return a sensor with a drift with a memory in one axis."""
    samples = noise(n=120_000, rate=50.0)
    gyro = np.array(samples.angular_velocity)
    gyro[:, 2] += Process(1.5e-4, 15.0).simulate(len(gyro), 50.0, np.random.default_rng(1))
    return analyse(recording_of(replace(samples, angular_velocity=gyro)))


@pytest.fixture(scope='module')
def analysis(result):
    return Analysis((result,))


class TestCsv:
    @pytest.mark.slow
    def test_every_estimate_comes_back(self, analysis, result):
        rows = list(csv.DictReader(io.StringIO(render(analysis, 'csv'))))
        found = {(row['axis'], row['parameter']): row for row in rows}
        for name, axis in result.axes.items():
            for term, estimate in axis.model.coefficients.items():
                row = found[name, term]
                assert row['unit'] == estimate.unit
                assert row['observable'] == str(estimate.observable).lower()
                if estimate.value is not None:
                    assert float(row['value']) == pytest.approx(estimate.value, rel=1e-8)
                else:
                    assert row['value'] == '' and row['reason']
        assert found['', 'rate']['unit'] == 'Hz'
        assert found['angular_velocity.x', 'N']['convention'] == 'continuous-time, two-sided'
        assert found['angular_velocity.x', 'noise_density']['convention'].endswith('one-sided')
        assert ('angular_velocity.z', 'T_c.allan_fit') in found

    def test_text_from_a_bag_stays_in_its_cell(self, result):
        evil = replace(result, source='a,"b\nc')
        rows = list(csv.DictReader(io.StringIO(render(Analysis((evil,)), 'csv'))))
        assert {row['source'] for row in rows} == {'a,"b\nc'}
