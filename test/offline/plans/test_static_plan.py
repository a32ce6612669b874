# SPDX-License-Identifier: Apache-2.0
"""The static comparison has the thesis's tables, with the numbers of the noise analysis."""

from dataclasses import replace

from imu_bench import drivers
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.drift import Drift, DriftModel
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.comparing.sensors import stated_rate
from imu_bench.offline.plans.static import Static
from imu_bench.samples import Samples
import numpy as np
import pytest
from scipy.signal import lfilter


@pytest.fixture(scope='module')
def measured(noise, recording_of):
    quiet = recording_of(noise(seed=1, n=40_000), topic='/bench/mpu9250/imu/data_raw')
    loud = recording_of(
        noise(seed=2, n=40_000, acceleration=6e-3), topic='/bench/lsm9ds1/imu/data_raw'
    )
    return [analyse(quiet), analyse(loud)]


def table(result, words):
    [found] = [t for t in result.tables if words in t.title and t.title.startswith('Acc')]
    return found


@pytest.mark.slow
def test_the_tables_of_the_thesis_are_there(measured):
    result = Static().conclude(measured)
    for number in ('5.1', '5.2', '5.4', '5.5', '5.6', '5.7', '5.8'):
        assert table(result, f'(Shabulinzenze 2020, table {number})').rows


def test_ratios_refer_to_the_reference(measured):
    rows = {row[0]: row for row in table(Static().conclude(measured), '5.1').rows}
    assert rows['mpu9250 x'][-1] == Estimate(1.0, 1.0, 1.0, '1')
    assert rows['lsm9ds1 y'][-1].value == pytest.approx(3.0, rel=0.03)
    turned = Static(reference='lsm9ds1').conclude(measured)
    rows = {row[0]: row for row in table(turned, '5.1').rows}
    assert rows['mpu9250 y'][-1].value == pytest.approx(1 / 3, rel=0.03)


@pytest.mark.parametrize(('samples', 'shown'), [(3.0, 'no drift seen'), (300.0, 'allan fit')])
def test_a_memory_of_a_few_samples_is_no_drift(measured, samples, shown):
    """The low-pass of a sensor has one, too."""
    result = measured[0]
    time = Estimate(samples / result.health.rate.value, None, None, 's')
    level = Estimate(1e-3, None, None, 'm/s²')
    drift = Drift({'allan_fit': DriftModel(time, level, level)})
    name = 'linear_acceleration.x'
    axis = result.axes[name]
    axis = replace(axis, checks=replace(axis.checks, drift=drift))
    rows = table(
        Static().conclude([replace(result, axes={**result.axes, name: axis})]), '5.7'
    ).rows
    assert rows[0][-1] == shown
    if samples > 10.0:
        assert rows[0][1] == '3.0'  # no interval, no digits


def test_an_unknown_reference_is_refused(measured):
    with pytest.raises(RecordingError, match='piezo: not among the sensors: mpu9250, lsm9ds1'):
        Static(reference='piezo').conclude(measured)


def test_equation_5_1_with_a_bandwidth_of_ones_own(measured):
    """σ/√f: 20 mm/s² rms of the white noise of density 2 mm/s²/√Hz at 100 Hz is over 50 Hz."""
    sigma = measured[0].axes['linear_acceleration.x'].statistics['std'].value
    rows = table(Static({'bandwidth': '16 Hz'}).conclude(measured), '5.2').rows
    assert rows[0][2].value == pytest.approx(sigma / 4.0)
    # never more than the sampling lets through
    rows = table(Static({'bandwidth': '1 kHz'}).conclude(measured), '5.2').rows
    assert rows[0][2].value == pytest.approx(sigma / 50.0**0.5, rel=1e-3)


def test_the_quietest_is_named(measured):
    first = Static().conclude(measured).summary[0]
    assert first.startswith('Acceleration: mpu9250')
    assert 'lsm9ds1' in first


def test_a_reference_without_a_gyroscope_has_no_ratio_there(measured):
    """As a piezoelectric accelerometer of one axis."""
    first, second = measured
    name = 'linear_acceleration.z'
    piezo = replace(first, axes={name: first.axes[name]})
    result = Static(reference='mpu9250').conclude([piezo, second])
    found = table(result, '5.1')
    assert found.columns[-1].title == 'ratio of σ'
    assert 'against mpu9250, which has z.' in found.note and 'gravity' in found.note
    [turning] = [t for t in result.tables if '5.1' in t.title and t.title.startswith('Angular')]
    assert turning.columns[-1].title == 'bias'
    assert 'Ratio' not in turning.note and 'gravity' not in turning.note


def test_why_a_sensor_has_no_coefficients_is_said(measured, monkeypatch):
    said = 'no constant signal is seen there'
    assert said not in table(Static().conclude(measured), '5.4').note
    monkeypatch.setattr(AxisResult, 'shows_constants', False)
    found = table(Static().conclude(measured), '5.4')
    assert 'Not defined for mpu9250, lsm9ds1' in found.note and said in found.note
    assert all(cell.value is None and cell.high is None for row in found.rows for cell in row[1:])


def test_a_density_from_the_spectrum_is_said(measured):
    first, second = measured
    name = 'linear_acceleration.z'
    axis = first.axes[name]
    none = Estimate.not_observable(axis.noise_density.unit, 'hidden')
    result = replace(first, axes={**first.axes, name: replace(axis, noise_density=none)})
    note = table(Static().conclude([result, second]), '5.2').note
    assert 'of mpu9250 z the plateau of the spectrum' in note
    assert 'plateau' not in table(Static().conclude(measured), '5.2').note


def test_axes_of_one_sensor_that_are_alike_are_said_to_be(measured):
    """A ratio of 1.00 between two axes of a sensor says nothing."""
    for line in Static().conclude(measured[:1]).summary:
        assert 'no axis is told apart from it' in line
        assert 'times as much' not in line
    assert 'lsm9ds1' in Static().conclude(measured).summary[0]


@pytest.mark.parametrize(
    ('driver', 'measured_hz', 'sheet_hz'),
    [
        # Shabulinzenze 2020, table 5.2: measured and data sheet
        ('mti300', 399.8, 400.0),
        ('mpu9250', 740.0, 1000.0),
        ('lsm9ds1', 1012.0, 952.0),
        ('bno055', 171.0, 100.0),
        ('lsm303dlhc', 1260.0, 1344.0),
    ],
)
def test_the_rate_of_the_datasheet_is_that_of_the_thesis(driver, measured_hz, sheet_hz):
    assert stated_rate(drivers.load(driver), measured_hz) == sheet_hz


def test_table_5_2_has_both_rates(measured):
    found = table(Static().conclude(measured), '5.2')
    place = [column.title for column in found.columns].index('datasheet rate')
    # 100 Hz of noise: an MPU-9250 has that rate, an LSM9DS1 its 119 Hz
    assert {row[0]: row[place] for row in found.rows}['mpu9250 x'] == 100.0
    assert {row[0]: row[place] for row in found.rows}['lsm9ds1 z'] == 119.0


@pytest.mark.slow
def test_the_autocorrelation_of_a_process_falls_as_it_should(recording_of):
    """A first-order process with T_c of 5 s, and white noise that the averages take away."""
    rng, rate, time_s = np.random.default_rng(54), 100.0, 5.0
    n, keep = 400_000, np.exp(-1 / (rate * time_s))
    drive = rng.normal(size=(n, 3)) * np.sqrt(1 - keep**2)
    bias = lfilter([1.0], [1.0, -keep], drive, axis=0)
    stamps = (np.arange(n) * 1e9 / rate).astype(np.int64)
    samples = Samples(stamps, acceleration=bias + 0.3 * rng.normal(size=(n, 3)))
    result = Static().conclude([analyse(recording_of(samples))])
    figures = {figure.title: figure for figure in result.figures}
    (series,) = figures['Acceleration x: autocorrelation (Shabulinzenze 2020, figure 5.4)'].series
    assert (series.x[0], series.y[0]) == (0.0, 1.0)
    # 4000 s hold 800 correlation times: an autocorrelation scatters by some 0.04
    for lag in (2.0, 5.0, 10.0):
        assert np.interp(lag, series.x, series.y) == pytest.approx(np.exp(-lag / 5.0), abs=0.15)
