# SPDX-License-Identifier: Apache-2.0
"""The cache of finished results: it gives back what was put in, and runs nothing."""

from __future__ import annotations

from dataclasses import replace
import json
import pickle

from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.presentation.pages import render_report as render
from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.running.analyzing import Finished
from imu_bench.offline.running.pipeline import Order, Outcome
from imu_bench.samples import Samples
import numpy as np
import pytest

ORDER = Order(ReadOptions(), Settings())


@pytest.fixture(scope='module')
def outcome(recording_of, noise):
    samples = noise(n=20_000)
    wander = np.cumsum(np.random.default_rng(3).normal(0.0, 1e-4, (20_000, 3)), axis=0)
    drifting = Samples(samples.stamps, samples.acceleration + wander, samples.angular_velocity)
    return Outcome((analyse(recording_of(drifting)),))


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / 'night.csv'
    path.write_text('1,2,3')
    return path


def kept(folder):
    [file] = folder.iterdir()
    return file


def test_results_and_figures_come_back(tmp_path, recording, outcome):
    finished = Finished(tmp_path / 'kept', ORDER)
    assert finished.get(recording) is None
    finished.put(recording, outcome)
    found = finished.get(recording)
    before, after = (Analysis(o.results) for o in (outcome, found))
    assert after.to_json() == before.to_json()
    for name, axis in before.recordings[0].axes.items():
        other = after.recordings[0].axes[name]
        np.testing.assert_array_equal(other.envelope.high, axis.envelope.high)
        np.testing.assert_array_equal(other.histogram.count, axis.histogram.count)
        trace, other = axis.checks.drift.tracking, other.checks.drift.tracking
        assert (trace is None) == (other is None)
        if trace is not None:
            np.testing.assert_array_equal(other.trace.bias, trace.trace.bias)
    assert len(render(after)) == len(render(before))


class Trap:
    def __reduce__(self):
        return (open, ('trapped', 'w'))


def test_a_pickle_is_not_opened(tmp_path, recording, outcome, monkeypatch):
    monkeypatch.chdir(tmp_path)
    finished = Finished(tmp_path / 'kept', ORDER)
    finished.put(recording, outcome)
    kept(tmp_path / 'kept').write_bytes(pickle.dumps(Trap()))
    assert finished.get(recording) is None
    assert not (tmp_path / 'trapped').exists()


@pytest.mark.parametrize(
    'damage',
    [
        lambda d: d.pop('figures'),
        lambda d: d.update(schema='imu_bench.finished/0'),
        lambda d: d['results'][0].update(source=7),
        lambda d: d['results'][0]['axes'].clear(),
        lambda d: d['figures'].append({}),
        lambda d: d['figures'][0]['linear_acceleration.x']['envelope']['low'].pop(),
        lambda d: d['figures'][0].clear(),
    ],
)
def test_what_is_damaged_is_done_again(tmp_path, recording, outcome, damage):
    finished = Finished(tmp_path / 'kept', ORDER)
    finished.put(recording, outcome)
    file = kept(tmp_path / 'kept')
    document = json.loads(file.read_text())
    damage(document)
    file.write_text(json.dumps(document))
    assert finished.get(recording) is None


def test_another_order_is_not_found(tmp_path, recording, outcome):
    Finished(tmp_path / 'kept', ORDER).put(recording, outcome)
    other = replace(ORDER, settings=Settings(start_s=1.0))
    assert Finished(tmp_path / 'kept', other).get(recording) is None
