# SPDX-License-Identifier: Apache-2.0
"""Angles from gravity, and the mast thesis's own numbers through the same formulas."""

import math

from hypothesis import given
from hypothesis import strategies as st
from imu_bench.errors import DataError
from imu_bench.metrology.allan import deviation
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials import inclination as tilt
import numpy as np
import pytest

STEPS = [*range(7), *range(5, -1, -1)]
# MSc thesis on two MEMS inclinometers (SCL3300, IIM-42652), table 3, error columns
MURATA = [
    0.003849, 0.0056, 0.0183, 0.0309, 0.0405, 0.0491, 0.0557, 0.0671, 0.0605, 0.0559, 0.0453,
    0.0327, 0.0137,
]  # fmt: skip
TDK = [
    0.1771, 0.1674, 0.1633, 0.1649, 0.1745, 0.1631, 0.1707, 0.1991, 0.2015, 0.1999, 0.2013,
    0.2047, 0.1994,
]  # fmt: skip
# the same thesis, table 3, measured angles
MURATA_ANGLES = [
    0.003849, 0.5869, 1.181, 1.775, 2.366, 2.956, 3.544, 2.974, 2.386, 1.8, 1.208, 0.614, 0.0137,
]  # fmt: skip

# the same thesis, appendix 6, in the order of time and with the sign of table 3
RAW_ANGLES = np.array([
    -0.00384886598028883, 0.586945655700683, 1.18100599551796, 1.77500140293583,
    2.36624041734731, 2.95573884015897, 3.54425241405594, 2.97371358340857, 2.38551118001140,
    1.79978149730462, 1.20792188777993, 0.613953533809969, 0.0137637867288582,
])  # fmt: skip


def exact(value, unit='rad'):
    return Estimate(value, value, value, unit)


@pytest.mark.parametrize(
    ('errors', 'mean', 'variance', 'three_sigma'),
    [(MURATA, 0.0369, 4.5214e-4, 0.0638), (TDK, 0.1836, 2.9754e-4, 0.0517)],
)
def test_table_3_gives_what_appendix_6_prints(errors, mean, variance, three_sigma):
    found = tilt.error_statistics(errors, '°')
    assert round(found.mean.value, 4) == mean
    assert float(f'{found.variance:.4e}') == variance
    assert round(found.three_sigma.value, 4) == three_sigma
    assert found.mean.low < mean < found.mean.high


def test_the_raw_values_of_appendix_6_show_a_sign_that_table_3_lost():
    """The first angle of the SCL3300 is 0.0038° on the other side of zero than the last."""
    wanted = 0.58139 * np.array(STEPS)
    found = tilt.error_statistics(RAW_ANGLES - wanted, '°')
    assert round(found.mean.value, 4) == 0.0361
    assert float(f'{found.variance:.2e}') == 4.94e-4
    assert RAW_ANGLES[0] == pytest.approx(-MURATA_ANGLES[0], abs=1e-6)
    np.testing.assert_allclose(RAW_ANGLES[1:], MURATA_ANGLES[1:], atol=6e-4)


def test_the_drift_of_table_3_shows_as_hysteresis_and_scale():
    wanted = [0.58139 * k for k in STEPS]
    turns = tilt.hysteresis(wanted, [exact(angle, '°') for angle in MURATA_ANGLES])
    assert len(turns) == 6  # the highest angle has only one side
    by_angle = {round(turn.angle / 0.58139): turn.hysteresis.value for turn in turns}
    assert by_angle[0] == pytest.approx(0.0137 - 0.003849)
    assert by_angle[5] == pytest.approx(2.974 - 2.956)
    assert max(by_angle.values()) == pytest.approx(0.614 - 0.5869)
    line = tilt.straight_line(np.radians(wanted), np.radians(MURATA_ANGLES))
    assert line.scale_error.low < 0.0135 < line.scale_error.high


def test_table_4_without_its_offset():
    wanted = [0.05813 * k for k in range(7)]
    shown = [-0.0483, -0.1051, -0.1657, -0.2238, -0.2856, -0.3467, -0.4108]
    # the table was turned the other way: the axis points down
    errors = tilt.compensated([exact(-angle) for angle in shown], wanted)
    printed = [0.0, 0.0568, 0.1174, 0.1756, 0.2373, 0.2984, 0.3625]
    for error, angle, compensated in zip(errors, wanted, printed, strict=True):
        # the printed 0.1756 does not follow from 0.2238 - 0.0483 in its last digit
        assert error.value == pytest.approx(compensated - angle, abs=1.01e-4)


angles = st.floats(-1.5, 1.5)


@given(angle=angles, heading=st.floats(-3.1, 3.1), size=st.floats(0.1, 20.0))
def test_the_angle_comes_back_whatever_the_heading_and_size(angle, heading, size):
    across = math.cos(angle)
    force = size * np.array(
        [[math.sin(angle), across * math.cos(heading), across * math.sin(heading)]]
    )
    assert tilt.inclination(force, 'x')[0] == pytest.approx(angle, abs=1e-9)
    assert tilt.inclination(force, '-x')[0] == pytest.approx(-angle, abs=1e-9)
    assert tilt.inclination(force, 'pitch')[0] == pytest.approx(-angle, abs=1e-9)
    assert tilt.inclination(force[:, [1, 0, 2]], 'y')[0] == pytest.approx(angle, abs=1e-9)
    assert tilt.inclination(force[:, [1, 2, 0]], 'z')[0] == pytest.approx(angle, abs=1e-9)


@given(roll=st.floats(-3.1, 3.1))
def test_roll_covers_the_whole_circle(roll):
    force = [[0.0, math.sin(roll), math.cos(roll)]]
    assert tilt.inclination(force, 'roll')[0] == pytest.approx(roll, abs=1e-9)


def test_bad_input_is_named():
    with pytest.raises(DataError, match=r'shape \(n, 3\), got \(2,\)'):
        tilt.inclination([0.0, 1.0])
    with pytest.raises(DataError, match="no angle 'yaw'"):
        tilt.inclination([[0.0, 0.0, 1.0]], 'yaw')
    with pytest.raises(DataError, match='2 set angles for 1 measured'):
        tilt.hysteresis([0.0, 1.0], [exact(0.0)])
    with pytest.raises(DataError, match='not all the same'):
        tilt.straight_line([1.0, 1.0, 1.0], [1.0, 2.0, 3.0])
    with pytest.raises(DataError, match=r'between 0\.5 and 1'):
        tilt.smallest_step(deviation(np.arange(100.0), 10.0, tau=[1.0]), 0.3)


@pytest.mark.slow
def test_a_step_of_the_smallest_size_is_found_as_often_as_stated():
    """Monte Carlo: means before and after, decided at the stated limit."""
    rng = np.random.default_rng(8)
    sigma, rate, tau, probability = 1e-4, 100.0, 1.0, 0.9
    curve = deviation(rng.normal(0.0, sigma, 400_000), rate, tau=[tau], unit='rad')
    step = tilt.smallest_step(curve, probability)[0]
    size = round(tau * rate)
    means = rng.normal(0.0, sigma, (20_000, 2, size)).mean(axis=2)
    apart = means[:, 1] - means[:, 0]
    limit = 1.6449 * math.sqrt(2.0) * curve.deviation[0]  # two-sided, 10 % of false alarms
    assert np.mean(np.abs(apart) > limit) == pytest.approx(0.1, abs=0.012)
    assert np.mean(np.abs(apart + step.value) > limit) == pytest.approx(probability, abs=0.012)


def test_of_one_sided_plans_there_is_no_hysteresis():
    wanted = [0.1 * k for k in range(5)]
    assert tilt.hysteresis(wanted, [exact(angle) for angle in wanted]) == ()
