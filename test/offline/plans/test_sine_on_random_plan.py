# SPDX-License-Identifier: Apache-2.0
"""The shaker campaign: what is put into simulated sensors comes out, and bad input is said."""

import json

from imu_bench import bench
from imu_bench.config.location import named_file
from imu_bench.errors import ConfigError, RecordingError
from imu_bench.offline.plans.sine_on_random import SineOnRandom
from imu_bench.offline.plans.sine_on_random.identity import identify, Identity
from imu_bench.offline.recordings import load_all, open_source, ReadOptions
from imu_bench.samples import Samples
from imu_bench.simulation.recording import write_bag
from imu_bench.simulation.scenario import load_scenario
import numpy as np
import pytest

ZONES = ['zones.before=10 s', 'zones.test=40 s', 'zones.after=10 s']
CROSS = {'x': (0.0225, 0.0519), 'y': (0.991, 0.971), 'z': (0.0766, 0.0465)}
"""Of dut1 in config/benches/vehicle_vibration.yaml."""


@pytest.fixture(scope='module')
def simulated(tmp_path_factory):
    """Return a function that simulates a run and returns its folder."""
    import rosbags  # noqa: F401, without it no bag is written

    folder = tmp_path_factory.mktemp('campaign')
    config = bench.load_bench(named_file('benches', 'vehicle_vibration'))

    def make(name, condition='sc1', seed=1, settings=()):
        path = folder / name
        if not path.exists():
            scenario = load_scenario(
                f'sine_on_random_{condition}', seed=seed, overrides=[*ZONES, *settings]
            )
            sensors = [bench.simulate(sensor, scenario, run=seed) for sensor in config.sensors]
            write_bag(path, sensors, scenario, scenario.duration_s, run=seed)
        return path

    return make


def measured(plan, path):
    source = open_source(path, ReadOptions())
    return plan.measure(str(path), load_all(source, [t for t in source.topics if t.is_imu]))


def run(plan, *paths):
    return plan.conclude([measured(plan, path) for path in paths])


def table(result, words):
    [found] = [t for t in result.tables if words in t.title]
    heads = [column.title for column in found.columns]
    return {row[0]: dict(zip(heads, row, strict=True)) for row in found.rows}


@pytest.fixture(scope='module')
def campaign(simulated):
    """SC1 along x twice, once along z, and the sine alone."""
    paths = [
        simulated('sc1_x_1', seed=1),
        simulated('sc1_x_2', seed=2),
        simulated('sc1_z_1', seed=3, settings=['axis=z']),
        simulated('sc1_x_sine', seed=4, settings=['random.density=0 g²/Hz']),
    ]
    return run(SineOnRandom(), *paths)


@pytest.mark.slow
def test_zones_are_found_where_the_truth_has_them(simulated):
    path = simulated('sc1_x_1', seed=1)
    zones = json.loads((path / 'truth.json').read_text(encoding='utf-8'))['scenario']['zones']
    kept = measured(SineOnRandom(), path)
    assert len(kept.runs) == 3
    for one in kept.runs:
        for name, zone in zip(('before', 'test', 'after'), zones, strict=True):
            found = getattr(one.zones, name)
            assert found.begin_s == pytest.approx(zone['begin_s'], abs=0.6)
            assert found.end_s == pytest.approx(zone['end_s'], abs=0.6)


@pytest.mark.slow
def test_injected_cross_axis_sensitivity_comes_out(campaign):
    """RR_ij = |20 log10(c_ij)|, and what the noise of 1.5 mg adds to a weak axis."""
    row = table(campaign, 'Accelerometer: rejection ratio')['SC1 dut1']
    power = 0.5 + 0.11  # sine, and what a filter of first order leaves of the random part, g²
    noise = 1.5e-3**2
    for (i, j), share in {
        ('y', 'x'): CROSS['y'][0],
        ('z', 'x'): CROSS['z'][0],
        ('x', 'z'): CROSS['x'][1],
        ('y', 'z'): CROSS['y'][1],
    }.items():
        wanted = -10 * np.log10((share**2 * power + noise) / (power + noise))
        assert row[f'RR {i}{j}'].value == pytest.approx(wanted, abs=0.03)
    assert 'RR xy' not in row  # nobody excited y


@pytest.mark.slow
def test_spurious_response_is_the_rise_over_the_quiet_zone(campaign):
    row = table(campaign, 'Accelerometer: spurious')['SC1 dut1']
    wanted = 10 * np.log10((CROSS['y'][0] ** 2 * 0.61 + 1.46e-3**2) / 1.46e-3**2)
    assert row['SR yx'].value == pytest.approx(wanted, abs=0.5)


@pytest.mark.slow
def test_aliasing_comes_out_as_injected(campaign):
    """0.01 g²/Hz from 200 to 2000 Hz behind 50 Hz, first order: 0.110 g² folds, 6.57 dB."""
    folded = 0.01 * 50.0 * (np.arctan(2000 / 50) - np.arctan(200 / 50))
    row = table(campaign, 'Signal-to-noise ratio, mean')['SC1 dut1 x']
    assert row['SNR'].value == pytest.approx(10 * np.log10(0.5 / folded), abs=0.35)
    assert row['seen at'] == pytest.approx(5.0, abs=0.01)
    # alone: noise of 210 µg/√Hz behind the same filter
    assert row['SNR, sine alone'].value == pytest.approx(53.3, abs=0.6)
    loss = row['loss']
    assert loss.value == pytest.approx(row['SNR, sine alone'].value - row['SNR'].value)
    assert loss.low < loss.value < loss.high


@pytest.mark.slow
def test_before_and_after_are_compatible(campaign):
    rows = table(campaign, 'Before and after the vibration')
    assert len(rows) == 18
    assert all(row['verdict'] == 'compatible' and row['runs'] == 4 for row in rows.values())
    assert any('fully compatible, in all 72 comparisons' in line for line in campaign.summary)
    assert not [f for f in campaign.findings if f.severity != 'info']


@pytest.mark.slow
def test_every_table_of_the_document_and_its_figures(campaign):
    titles = ' '.join(t.title for t in campaign.tables)
    own = 'Capriglione 2021'
    assert all(f'({own}, table {number})' in titles for number in ('IV', 'V', 'VI', 'VII'))
    figures = ' '.join(f.title for f in campaign.figures)
    assert all(f'({own}, figure {number})' in figures for number in (3, 7, 8, 9, 10, 11, 12))
    bars = next(f for f in campaign.figures if 'dut1: rejection ratio RR (' in f.title)
    assert bars.categories == ('yx', 'zx', 'xz', 'yz')
    assert bars.series[0].low is not None
    json.dumps(campaign.to_json(), allow_nan=False)
    assert len(campaign.values['runs']) == 12


@pytest.mark.slow
def test_bars_of_a_gyroscope_that_are_alike_are_explained(campaign):
    notes = {t.title: t.note for t in campaign.tables if 'rejection ratio' in t.title}
    [gyroscope] = [note for title, note in notes.items() if title.startswith('Gyroscope')]
    assert 'A shaker turns nothing' in gyroscope
    assert all('turns' not in n for title, n in notes.items() if not title.startswith('Gyro'))


def test_a_shifted_sensor_is_not_compatible(simulated):
    path = simulated('sc1_x_1', seed=1)
    plan = SineOnRandom({'coverage': '0.1'})
    kept = measured(plan, path)
    axis = kept.runs[0].axes['linear_acceleration.y']
    mean, spread = axis.after
    moved = mean.value + 0.1
    object.__setattr__(axis, 'after', (type(mean)(moved, moved, moved, mean.unit), spread))
    result = plan.conclude([kept])
    assert 'not compatible in' in result.summary[1]
    assert any(f.code == 'not-compatible' and 'y differs' in f.text for f in result.findings)


@pytest.mark.slow
def test_a_swept_sine_has_no_ratio_and_repetitions_may_share_a_recording(simulated):
    path = simulated('sc4_y_1', 'sc4', settings=['axis=y', 'repeat=2'])
    result = run(SineOnRandom(), path)
    assert len(result.values['runs']) == 6
    assert all(not one['snr']['observable'] for one in result.values['runs'])
    assert not [t for t in result.tables if t.title.startswith('Signal-to-noise ratio, mean')]
    each = table(result, 'Accelerometer: RR of each repetition, SC4')
    assert set(each) == {f'dut{n} repetition {k}' for n in (1, 2, 3) for k in (1, 2)}


@pytest.mark.slow
def test_a_sine_above_half_the_rate_is_allowed_and_said(simulated):
    path = simulated('sc1_x_fold', settings=['sine.frequency=90 Hz'])
    result = run(SineOnRandom(), path)
    folded = [f for f in result.findings if f.code == 'folded']
    assert len(folded) == 3
    assert 'the sine of 90 Hz is above half the rate of dut1 (58.79 Hz) and shows at 27.5' in (
        folded[0].text
    )


def test_another_frequency_than_told_is_said(simulated):
    path = simulated('sc1_x_1', seed=1)
    result = run(SineOnRandom({'frequency': '12 Hz'}), path)
    assert any(f.code == 'other-frequency' and 'at 12 Hz' in f.text for f in result.findings)


def test_given_zones_are_taken(simulated):
    path = simulated('sc1_x_1', seed=1)
    kept = measured(SineOnRandom({'zones': '8 s, 40 s, 12 s'}), path)
    assert kept.runs[0].zones.test.begin_s == 8.0
    assert kept.runs[0].zones.after.length_s == pytest.approx(12.0, abs=0.1)
    with pytest.raises(RecordingError, match=r'60\S* s long, but the zones before and test'):
        measured(SineOnRandom({'zones': '3 min, 10 min, 3 min'}), path)
    with pytest.raises(RecordingError, match='takes the lengths of the zones'):
        measured(SineOnRandom({'zones': '3 min'}), path)


def test_what_is_not_in_a_recording_is_said(simulated, recording_of, noise):
    still = recording_of(noise(seed=1, n=6000), topic='/bench/a/imu/data_raw')
    given = {'condition': 'SC1', 'axis': 'x'}
    with pytest.raises(RecordingError, match='a: no test zone found'):
        SineOnRandom(given).measure('still', [still])
    with pytest.raises(RecordingError, match='which condition and axis'):
        SineOnRandom().measure('still', [still])
    with pytest.raises(RecordingError, match='no sensor in it has the excited axis'):
        SineOnRandom(given).measure('still', [])


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        ({'zones': '3 min, 10 parsec, 3 min'}, "unknown unit 'parsec'"),
        ({'axis': 'q'}, 'q is not allowed'),
        ({'excitation': 'noise'}, 'noise is not allowed'),
        ({'zone': '1 s'}, 'no such setting'),
    ],
)
def test_settings_that_make_no_sense(setting, text):
    with pytest.raises(ConfigError, match=text):
        SineOnRandom(setting)


NOTHING = dict.fromkeys(('condition', 'axis', 'repetition', 'excitation', 'frequency'))


@pytest.mark.parametrize(
    ('name', 'wanted'),
    [
        ('sc1_x_2', Identity('SC1', 'x', 2, True, 5.0)),
        ('SC2-y-rep3.csv', Identity('SC2', 'y', 3, True, 10.0)),
        ('2021-09-01 sc3 z 4.mcap', Identity('SC3', 'z', 4, True, 15.0)),
        ('sc4_x', Identity('SC4', 'x', None, True, None)),
        ('sc1_x_sine', Identity('SC1', 'x', None, False, 5.0)),
        ('sc1_z_ref_2', Identity('SC1', 'z', 2, False, 5.0)),
        ('sc7_z_1', Identity('SC7', 'z', 1, True, None)),
    ],
)
def test_names_of_recordings(name, wanted):
    assert identify(f'/data/{name}', NOTHING) == wanted


@pytest.mark.parametrize('name', ['night.mcap', 'sc1', 'sc1_xaxis', 'misc1_x_2'])
def test_names_that_say_nothing(name):
    with pytest.raises(RecordingError, match='Name it like sc1_x_2'):
        identify(f'/data/{name}', NOTHING)


def test_what_the_recorder_was_told_wins_over_the_name(tmp_path):
    folder = tmp_path / 'sc1_x_2'
    folder.mkdir()
    (folder / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  custom_data: {condition: SC3, axis: z, repetition: "5"}\n'
    )
    assert identify(str(folder), NOTHING) == Identity('SC3', 'z', 5, True, 15.0)
    assert identify(str(folder), NOTHING | {'axis': 'y'}).axis == 'y'
    (folder / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  custom_data: {condition: SC3, axis: vertical}\n'
    )
    with pytest.raises(RecordingError, match="axis 'vertical' is none of x, y, z"):
        identify(str(folder), NOTHING)


def test_a_truth_that_is_none_is_said(tmp_path):
    (tmp_path / 'truth.json').write_text('{}')
    with pytest.raises(RecordingError, match='not as imu-bench simulate writes it'):
        identify(str(tmp_path), NOTHING)


def test_the_control_accelerometer_is_held_against_the_profile(recording_of):
    """White noise of 0.0125 g²/Hz by hand, a quarter more than the profile: 0.97 dB."""
    rng, rate, g = np.random.default_rng(6), 5000.0, 9.80665
    n = round(30 * rate)
    t = np.arange(n) / rate
    shaking = (t > 8) & (t < 22)
    sigma = np.sqrt(0.0125 * rate / 2) * g
    force = np.array([0.0, 0.0, g]) + rng.normal(0.0, 1e-3, (n, 3))
    sine = g * np.sin(2 * np.pi * 5.0 * t)
    force[:, 0] += shaking * (sine + rng.normal(0.0, sigma, n))
    stamps = 1_700_000_000_000_000_000 + np.round(t * 1e9).astype(np.int64)
    recording = recording_of(
        Samples(stamps, acceleration=force), topic='/bench/piezo/imu/data_raw'
    )

    def run(**settings):
        plan = SineOnRandom(settings)
        return plan.conclude([plan.measure('campaign/sc1_x_1', [recording])])

    found = run(control='piezo')
    [row] = table(found, 'Control accelerometer').values()
    assert row['profile'] == pytest.approx(0.1 * g)
    assert row['ratio'].value == pytest.approx(10 * np.log10(1.25), abs=0.1)
    assert row['ratio'].low < 10 * np.log10(1.25) < row['ratio'].high
    [figure] = [f for f in found.figures if 'control accelerometer' in f.title]
    measured, profile = figure.series
    assert profile.x.tolist() == [200.0, 2000.0]
    assert profile.y == pytest.approx([0.01, 0.01])
    inside = (measured.x > 300) & (measured.x < 1900)
    assert np.mean(measured.y[inside]) == pytest.approx(0.0125, rel=0.05)
    assert not any('Control' in t.title for t in run().tables)
    with pytest.raises(RecordingError, match='control=other: not among the sensors: piezo'):
        run(control='other')
