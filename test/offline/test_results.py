# SPDX-License-Identifier: Apache-2.0
"""The JSON document: fixed names, estimates everywhere, and nothing lost on the way back."""

from dataclasses import replace
import json

from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis import results
from imu_bench.offline.analysis.recording import analyse, Settings
from imu_bench.offline.analysis.results import Analysis, Failure
from imu_bench.samples import Samples
import numpy as np
import pytest

# fixed: users and scripts depend on these names
AXIS_NUMBERS = ('mean', 'std', 'rms', 'noise_density')
ALLAN_ARRAYS = ('tau', 'deviation', 'low', 'high', 'noise_type')
COEFFICIENTS = ('N', 'B', 'K')


@pytest.fixture(scope='module')
def analysis(recording_of, noise):
    samples = noise(n=20_000)
    cut = np.flatnonzero((np.arange(20_000) < 5000) | (np.arange(20_000) >= 5100))
    gappy = Samples(samples.stamps[cut], samples.acceleration[cut])
    settings = Settings()
    return Analysis(
        (analyse(recording_of(samples)), analyse(recording_of(gappy, topic='/other'))),
        (Failure('broken.bag', 'cut off'),),
        settings.to_json(),
    )


def test_fixed_names(analysis):
    document = analysis.to_json()
    assert document['schema'] == 'imu_bench.analysis/1'
    first = document['recordings'][0]
    assert first['source'] == 'night.mcap'
    assert first['topic'] == '/bench/chip/imu/data_raw'
    assert set(first['axes']) == {
        f'{quantity}.{letter}'
        for quantity in ('linear_acceleration', 'angular_velocity')
        for letter in 'xyz'
    }
    axis = first['axes']['angular_velocity.z']
    assert axis['unit'] == 'rad/s'
    for name in AXIS_NUMBERS:
        assert Estimate.from_json(axis[name]).observable
    for name in COEFFICIENTS:
        Estimate.from_json(axis['coefficients'][name])
    sizes = {len(axis['allan'][name]) for name in ALLAN_ARRAYS}
    assert len(sizes) == 1
    assert axis['allan']['noise_type'][0] == 'white'
    assert first['health']['rate']['unit'] == 'Hz'


def test_names_of_what_qualifies_the_numbers(analysis):
    axis = analysis.to_json()['recordings'][0]['axes']['linear_acceleration.x']
    for name in ('coefficients_whittle', 'coefficients_tangent'):
        assert {Estimate.from_json(axis[name][term]).unit for term in COEFFICIENTS}
    assert axis['disagreements'] == []
    assert axis['noise_density_verdict'] == '3 methods agree'
    assert {'autocorrelation', 'allan_peak'} <= set(axis['gauss_markov'])
    assert axis['bias_tracking'] is None
    assert axis['stationarity']['verdict'] == 'steady'
    assert Estimate.from_json(axis['stationarity']['ratio']).low == 1.0
    assert axis['normality']['verdict'] == 'normal'
    assert axis['outliers'] == 0


def test_a_document_of_an_older_version_is_read(analysis):
    document = json.loads(json.dumps(analysis.to_json()))
    for recording in document['recordings']:
        for axis in recording['axes'].values():
            for name in (
                'coefficients_whittle', 'coefficients_tangent', 'disagreements', 'gauss_markov',
                'bias_tracking', 'stationarity', 'normality', 'outliers',
                'noise_density_verdict',
            ):  # fmt: skip
                del axis[name]
    axis = Analysis.from_json(document).recordings[0].axes['linear_acceleration.x']
    assert axis.model.N.observable
    assert axis.checks.second is None
    assert axis.outliers is None


def test_the_histogram_of_the_jitter_is_in_the_document(recording_of, noise):
    samples = noise(n=5_000)
    late = np.random.default_rng(8).normal(0.0, 2e5, 5_000).astype(np.int64)
    found = analyse(recording_of(replace(samples, stamps=samples.stamps + late)))
    document = json.loads(json.dumps(found.to_json()))
    jitter = document['health']['jitter_histogram']
    assert jitter['unit'] == 's'
    assert len(jitter['edges']) == len(jitter['counts']) + 1
    assert sum(jitter['counts']) + jitter['below'] + jitter['above'] == 4_999
    middle = 0.5 * np.add(jitter['edges'][:-1], jitter['edges'][1:])
    spread = np.sqrt(np.average((middle - 0.01) ** 2, weights=jitter['counts']))
    assert spread == pytest.approx(document['health']['jitter']['value'], rel=0.05)
    again = results.RecordingResult.from_json(document)
    assert again.to_json() == found.to_json()
    regular = analyse(recording_of(samples)).to_json()
    assert regular['health']['jitter_histogram'] is None
    del document['health']['jitter_histogram']  # as an older version wrote it
    assert results.RecordingResult.from_json(document).intervals is None


def test_round_trip(analysis, tmp_path):
    path = tmp_path / 'result.json'
    results.write(analysis, path)
    again = results.read(path)
    assert again.to_json() == analysis.to_json()
    assert again.recordings[1].health.missing == 100
    curve = again.recordings[0].axes['linear_acceleration.x'].allan
    np.testing.assert_array_equal(
        curve.deviation, analysis.recordings[0].axes['linear_acceleration.x'].allan.deviation
    )


def test_it_is_strict_json(analysis, tmp_path):
    path = tmp_path / 'result.json'
    results.write(analysis, path)

    def refuse(name):
        raise AssertionError(f'{name} is not JSON')

    json.loads(path.read_text(encoding='utf-8'), parse_constant=refuse)


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ('{', 'not a JSON document'),
        ('[]', 'schema None'),
        ('{"schema": "imu_bench.analysis/9"}', 'imu_bench.analysis/9'),
        ('{"schema": "imu_bench.analysis/1"}', 'damaged'),
    ],
)
def test_refuses_what_is_not_a_result(tmp_path, content, words):
    path = tmp_path / 'result.json'
    path.write_text(content)
    with pytest.raises(RecordingError, match=words):
        results.read(path)
