# SPDX-License-Identifier: Apache-2.0
"""
The tables of two theses recomputed from their own printed numbers.

S: J. Shabulinzenze, "Comparison of MEMS sensors in machine vibration monitoring", Tampere
University, MSc thesis, 2020.  T: the thesis that compares Murata SCL3300 and TDK IIM-42652 for
tracking the movement of masts.  Where a printed number does not follow from the numbers it is
said to come from, the test says so and shows what it does follow from.
"""

import math

from imu_bench.metrology.deviations import confidence
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.markov.kalman import white_sigma
from imu_bench.metrology.spectra import spectrum
from imu_bench.units import convert
import pytest

AXES = 'XYZ'

# S table 5.1: standard deviations in m/s², with half a unit of their last digit
SIGMA = {
    'MTI-300': ((0.0116, 0.0120, 0.0116), 0.5e-4),
    'MPU-9250': ((0.0189, 0.0189, 0.0318), 0.5e-4),
    'LSM9DS1': ((0.036, 0.0349, 0.0383), 0.5e-4),
    'BNO055': ((0.0097, 0.0112, 0.0140), 0.5e-4),
    # printed 0.20, 0.20, 0.30, beside ranges such as 17.20 of numbers with one decimal
    'LSM303DLHC': ((0.20, 0.20, 0.30), 0.05),
}

# S table 5.2: densities in µg/√Hz of the data sheet and measured, bandwidth in Hz, noise in µg
TABLE_5_2 = {
    'MTI-300': (88.8, (60.9716, 63.1657, 61.1195), 375.0, 1719.6),
    'MPU-9250': (300.0, (89.8376, 89.6624, 151.0355), 460.0, 6434.2),
    'LSM9DS1': (None, (210.0844, 202.9551, 222.6298), 408.0, 4241.7),
    'BNO055': (150.0, (125.2382, 144.0657, 180.5340), 62.5, 1185.8),
    'LSM303DLHC': (220.0, (841.20, 733.0, 1099.0), 672.0, 5703.0),
}


def density(sigma, bandwidth):
    """Return S equation 5.1, σ/√f_3dB, in µg/√Hz."""
    estimate = spectrum.density_from_sigma(Estimate(sigma, None, None, 'm/s²'), bandwidth)
    return estimate.to('µg/√Hz').value


@pytest.mark.parametrize('sensor', ['MTI-300', 'MPU-9250', 'BNO055', 'LSM303DLHC'])
def test_s_measured_densities_follow_from_sigma_and_bandwidth(sensor):
    sigmas, half_digit = SIGMA[sensor]
    _, printed, bandwidth, _ = TABLE_5_2[sensor]
    for sigma, value in zip(sigmas, printed, strict=True):
        assert density(sigma - half_digit, bandwidth) <= value
        assert value <= density(sigma + half_digit, bandwidth)


def test_s_densities_of_the_lsm9ds1_do_not_follow_from_408_hz():
    """They are 15 % too high for the bandwidth printed beside them; about 307 Hz gives them."""
    sigmas, half_digit = SIGMA['LSM9DS1']
    _, printed, bandwidth, _ = TABLE_5_2['LSM9DS1']
    for sigma, value in zip(sigmas, printed, strict=True):
        assert value / density(sigma, bandwidth) == pytest.approx(1.154, abs=0.004)
        assert value > density(sigma + half_digit, bandwidth)
        implied = (convert(sigma, 'm/s²', 'µg') / value) ** 2
        assert implied == pytest.approx(307.0, abs=3.0)


@pytest.mark.parametrize('sensor', ['MTI-300', 'MPU-9250', 'BNO055', 'LSM303DLHC'])
def test_s_total_noise_is_that_of_the_data_sheet_and_not_the_measured_one(sensor):
    """ "The noise density was multiplied by the square root of bandwidth": the printed one."""
    data_sheet, measured, bandwidth, noise = TABLE_5_2[sensor]
    assert data_sheet * math.sqrt(bandwidth) == pytest.approx(noise, abs=0.1)
    for value in measured:
        assert abs(value * math.sqrt(bandwidth) / noise - 1.0) > 0.03


def test_s_total_noise_of_the_lsm9ds1_uses_a_rounded_measured_density():
    """Without a density in its data sheet: 210 µg/√Hz, X without its decimals."""
    _, measured, bandwidth, noise = TABLE_5_2['LSM9DS1']
    assert math.floor(measured[0]) * math.sqrt(bandwidth) == pytest.approx(noise, abs=0.1)


def test_s_reference_sensor_noise_follows_from_its_sigma_but_not_from_a_printed_bandwidth():
    """8033.7 µg is 0.0788 m/s²; 803.77 µg/√Hz needs a bandwidth of 100 Hz, printed nowhere."""
    assert convert(0.0788 - 0.5e-4, 'm/s²', 'µg') < 8033.7 < convert(0.0788 + 0.5e-4, 'm/s²', 'µg')
    assert pytest.approx(99.9, abs=0.05) == (8033.7 / 803.77) ** 2


def test_s_ratios_of_sigma_do_not_follow_from_the_sigma_of_the_reference_sensor():
    """S table 5.1 divides by 0.0001 m/s², as its text says, not by the 0.0788 that it prints."""
    ratios = {'MTI-300': 116, 'MPU-9250': 318, 'LSM9DS1': 383, 'BNO055': 140, 'LSM303DLHC': 3000}
    for sensor, ratio in ratios.items():
        sigma = SIGMA[sensor][0][2]
        assert sigma / 0.0001 == pytest.approx(ratio)
        assert sigma / 0.0788 < 4.0


def test_s_peak_to_peak_is_maximum_minus_minimum_but_for_the_reference_sensor():
    rows = [
        (-0.0460, 0.0461, 0.0921), (-0.0437, 0.0537, 0.0974), (-0.0525, 0.0426, 0.0951),
        (-0.0784, 0.0709, 0.1494), (-0.0899, 0.0722, 0.1621), (-0.1265, 0.1199, 0.2464),
        (-0.1516, 0.1539, 0.3056), (-0.1540, 0.1394, 0.2934), (-0.1985, 0.1797, 0.3782),
        (-0.0273, 0.0327, 0.0600), (-0.0460, 0.0440, 0.0900), (-0.0464, 0.0436, 0.0900),
        (-15.30, 1.90, 17.20), (-1.70, 1.80, 3.50), (-16.50, 2.0, 18.50),
    ]  # fmt: skip
    for low, high, printed in rows:
        # three roundings of half a digit each
        assert high - low == pytest.approx(printed, abs=1.5001e-4)
    # MTN-1100: 1.4017 is printed where its extremes give 1.2917
    assert pytest.approx(1.2917) == 0.5559 + 0.7358
    assert abs(0.5559 + 0.7358 - 1.4017) > 0.1


def test_s_216_hours_for_a_process_of_24_hours_to_a_quarter():
    """S equations 3.24 and 3.25: error 1/√(2 (N/K − 1)) = 0.25 at N = 9 K."""
    samples, cluster = 216, 24
    _, high = confidence.simple_interval(1.0, cluster, samples, 0.6826895)
    assert float(high) - 1.0 == pytest.approx(0.25, rel=1e-6)
    clusters = 1.0 + 1.0 / (2.0 * 0.25**2)
    assert clusters == 9.0 and clusters * 24.0 == 216.0


def test_s_216_hours_give_more_than_that_with_overlap():
    """The formula knows no overlap: the χ² interval of white noise at T/9 is narrower."""
    degrees = float(confidence.edf('oadev', 0, 24_000, 216_001))
    assert 1.0 / math.sqrt(2.0 * degrees) == pytest.approx(0.21, abs=0.01)


# S table 5.4: velocity random walk and its error in m/s/√h
TABLE_5_4 = {
    'Xsens Mti': ((0.0833, 0.00026), (0.0852, 0.00026), (1.19599, 0.0062)),
    'MPU-9250': ((0.1277, 0.0004), (0.1274, 0.0004), (0.2565, 0.0008)),
    'LSM9DS1': ((0.0825, 0.00025), (0.0723, 0.00022), (0.0977, 0.0003)),
    'BNO055': ((0.0743, 0.00023), (0.0840, 0.00026), (0.1032, 0.00032)),
    'LSM303': ((0.7554, 0.0024), (0.8139, 0.0026), (0.8776, 0.0028)),
}


def test_s_errors_of_the_random_walk_are_one_percentage_but_for_one():
    """ "The accuracy is in order of 0.3 %": one factor for all, so no error of any sensor."""
    for sensor, axes in TABLE_5_4.items():
        for axis, (value, error) in zip(AXES, axes, strict=True):
            expected = 0.52 if (sensor, axis) == ('Xsens Mti', 'Z') else 0.313
            assert 100.0 * error / value == pytest.approx(expected, abs=0.012), (sensor, axis)


def test_s_sigma_of_the_kalman_filter_is_root_two_too_large():
    """
    S section 5.1.3 takes σ = ND √F_s with ND = σ/√f_3dB of equation 5.1, a one-sided density.

    That density gives σ = ND √(F_s/2): with N = ND/√2 it is `white_sigma`.
    """
    one_sided, rate_hz = 6e-4, 400.0
    printed = one_sided * math.sqrt(rate_hz)
    assert printed / white_sigma(one_sided / math.sqrt(2.0), rate_hz) == pytest.approx(
        math.sqrt(2)
    )


def test_t_table_1_ratio_of_8_38_is_that_of_the_variances():
    tdk, murata = 9.9557e-4, 1.1874e-4
    assert tdk / murata == pytest.approx(8.38, abs=0.005)
    # and not of the width of the noise, which the same table gives as 3σ
    assert 3.0 * math.sqrt(tdk) == pytest.approx(0.0947, abs=0.5e-4)
    assert 3.0 * math.sqrt(murata) == pytest.approx(0.0327, abs=0.5e-4)
    assert math.sqrt(tdk / murata) == pytest.approx(2.896, abs=0.001)


def test_t_table_2_units():
    """Both columns of the SCL3300 agree; of the IIM-42652, N = 1.470e-4 g is not 129.8 µg."""
    for printed, micro in (
        (0.1298e-4, 12.98),
        (0.0214e-4, 2.14),
        (0.004e-4, 0.4),
        (0.011e-4, 1.1),
    ):
        assert convert(printed, 'g', 'µg') == pytest.approx(micro)
    assert convert(1.470e-4, 'g', 'µg') == pytest.approx(147.0)
    assert abs(147.0 / 129.8 - 1.0) > 0.1
    # 129.8 is ten times the number of the SCL3300: "10 times lower", the text says
    assert pytest.approx(10.0) == 129.8 / 12.98
    # 0.155e-4 g is 15.5 µg, printed 15
    assert convert(0.155e-4, 'g', 'µg') == pytest.approx(15.5)
