# SPDX-License-Identifier: Apache-2.0
"""RR, SR and compatibility against the numbers that Capriglione et al. 2021 print."""

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials.crosstalk import (
    compatibility,
    magnitude,
    mean_squares,
    ratio_db,
    repeated,
)
import numpy as np
import pytest

TABLE_IV = """
 0.0013 .0017  0.0013 .0017 -0.0003 .0019 -0.0003 .0019 -0.0003 .0019 -0.0003 .0019
-0.0002 .0144 -0.0005 .0139  0.0006 .0017  0.0003 .0017  0.0006 .0017  0.0003 .0017
-0.0008 .0016 -0.0006 .0016  0.0007 .0021  0.0008 .0020  0.0007 .0021  0.0008 .0020
 0.0005 .0017  0.0005 .0017 -0.0007 .0019 -0.0006 .0018 -0.0007 .0019 -0.0006 .0018
 0.0008 .0134  0.0006 .0134  0.0018 .0017  0.0015 .0017  0.0018 .0017  0.0015 .0017
-0.0004 .0016 -0.0001 .0016  0.0001 .0020  0.0002 .0020  0.0001 .0020  0.0002 .0020
-0.0012 .0017 -0.0012 .0017  0.0001 .0019  0.0001 .0019  0.0001 .0019  0.0001 .0019
-0.0004 .0139 -0.0006 .0124  0.0011 .0017  0.0008 .0017  0.0011 .0017  0.0008 .0017
-0.0003 .0017 -0.0004 .0017 -0.0006 .0020 -0.0006 .0021 -0.0006 .0020 -0.0006 .0021
-0.0001 .0017 -0.0001 .0017  0.0011 .0019  0.0011 .0019  0.0011 .0019  0.0011 .0019
 0.0010 .0125  0.0006 .0125 -0.0002 .0017 -0.0002 .0017 -0.0002 .0017 -0.0002 .0017
-0.0005 .0017 -0.0001 .0017  0.0002 .0021  0.0003 .0073  0.0002 .0021  0.0003 .0073
-0.0009 .0017 -0.0009 .0017 -0.0001 .0019 -0.0002 .0019 -0.0001 .0019 -0.0002 .0019
 0.0004 .0126  0.0003 .0120 -0.0002 .0017 -0.0003 .0017 -0.0002 .0017 -0.0003 .0017
-0.0005 .0017 -0.0006 .0017 -0.0002 .0072 -0.0003 .0021 -0.0002 .0072 -0.0003 .0021
"""
"""Mean and standard deviation, before and after, of x, y and z in g; one row per repetition."""

TABLE_V_DUT1 = {
    'yx': ((0.2, 0.0, 0.1, 0.1, 0.0), 0.08),
    'zx': ((22.3, 22.4, 22.2, 22.3, 22.4), 22.32),
    'xy': ((32.9, 32.9, 32.9, 33.0, 33.1), 32.96),
    'zy': ((26.6, 26.6, 26.6, 26.7, 26.8), 26.66),
}


def test_table_iv_gives_its_conclusion():
    """Page 4: full compatibility among all the before and after conditions."""
    numbers = np.array(TABLE_IV.split(), dtype=float).reshape(-1, 4)
    assert numbers.shape == (45, 4)
    found = [compatibility((m, s), (m2, s2)) for m, s, m2, s2 in numbers]
    assert all(one.compatible for one in found)
    assert max(one.ratio for one in found) < 0.1


def test_what_moved_is_not_compatible():
    assert not compatibility((0.0013, 0.0017), (0.0073, 0.0017)).compatible
    assert compatibility((0.0013, 0.0017), (0.0061, 0.0017)).compatible
    # the same with one sigma
    assert not compatibility((0.0013, 0.0017), (0.0061, 0.0017), coverage=1.0).compatible
    with pytest.raises(DataError, match='without uncertainty'):
        compatibility((0.0, 0.0), (1.0, 0.0))


@pytest.mark.parametrize('pair', TABLE_V_DUT1)
def test_table_v_over_its_repetitions(pair):
    values, mean = TABLE_V_DUT1[pair]
    found = repeated([Estimate(value, None, None, 'dB') for value in values])
    assert found.mean.value == pytest.approx(mean)
    assert found.spread.value == pytest.approx(np.std(values, ddof=1))
    assert found.mean.low <= mean <= found.mean.high


def test_a_ratio_has_the_sign_that_the_document_takes_off():
    """Equation (1): an axis with a tenth of the RMS is at -20 dB, printed as 20 dB."""
    level = ratio_db(np.full(16, 0.01), np.full(16, 1.0), paired=True)
    assert level.value == pytest.approx(-20.0)
    assert magnitude(level).value == pytest.approx(20.0)
    around = magnitude(Estimate(-0.1, -0.4, 0.2, 'dB'))
    assert (around.value, around.low, around.high) == (0.1, 0.0, 0.4)


@pytest.mark.parametrize('paired', [True, False])
def test_the_interval_of_a_ratio_covers(paired):
    """Cross-axis sensitivity 0.05 under a sine whose size wanders, with noise on both axes."""
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(300):
        t = np.arange(6000) / 119.0
        truth = (0.5, 0.05**2 * 0.5)
        shaken = np.sin(2 * np.pi * 5 * t + rng.uniform(0, 6.28))
        j = shaken + 0.1 * rng.normal(size=t.size)
        i = 0.05 * shaken + 0.02 * rng.normal(size=t.size)
        level = ratio_db(mean_squares(i), mean_squares(j), paired=paired)
        wanted = 10 * np.log10((truth[1] + 4e-4) / (truth[0] + 1e-2))
        inside += level.low <= wanted <= level.high
    assert inside / 300 >= 0.90


def test_nothing_at_all_has_no_level():
    level = ratio_db(np.zeros(4), np.ones(4), paired=True)
    assert not level.observable
    assert magnitude(level) is level
    assert repeated([level]).count == 0


def test_one_repetition_has_no_spread():
    found = repeated([Estimate(7.0, 6.5, 7.5, 'dB')])
    assert found.mean.value == 7.0
    assert 'record five' in found.spread.reason
    with pytest.raises(DataError):
        repeated([])
