# SPDX-License-Identifier: Apache-2.0
"""The deviations and intervals printed in NIST SP 1065 (2008), every digit."""

import json
import math

from imu_bench.metrology import allan
from imu_bench.metrology.deviations.confidence import edf, interval
import numpy as np
import pytest
from scipy import stats

KINDS = ('adev', 'oadev', 'mdev', 'tdev', 'hdev', 'ohdev', 'totdev')

MISPRINTS = {('hdev', 10, 1.0): 70.80608}
"""
Printed for the Hadamard deviation of ten points at tau 1.  Without averaging it is the
overlapped one, printed as 70.80607 beside it; the exact value is 70.806071.
"""


@pytest.fixture(scope='module')
def published(shared_data):
    return json.loads((shared_data / 'nbs14' / 'nbs14.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def ten(shared_data):
    return np.loadtxt(shared_data / 'nbs14' / 'nbs14_10_phase.csv')


def thousand():
    """Return the 1000-point set: NIST SP 1065 (2008), section 12."""
    numbers = [1234567890]
    while len(numbers) < 1000:
        numbers.append(16807 * numbers[-1] % 2147483647)
    return np.array(numbers) / 2147483647


def printed(value, like):
    """Return a value with as many significant digits as a printed one has."""
    digits = len(f'{like!r}'.replace('.', '').lstrip('0'))
    return float(f'{value:.{digits - 1}e}')


def row(table, kind):
    return next(values for name, values in table.items() if name.split('_')[0] == kind)


@pytest.mark.data
@pytest.mark.parametrize('kind', KINDS)
def test_thousand_points(published, kind):
    table = published['nbs14_1000']
    curve = allan.deviation(thousand(), 1.0, kind=kind, tau=table['tau_s'])
    for value, wanted in zip(curve.deviation, row(table, kind), strict=True):
        assert printed(value, wanted) == wanted


@pytest.mark.data
@pytest.mark.parametrize('kind', KINDS)
def test_ten_points(published, ten, kind):
    table = published['nbs14_10']
    curve = allan.deviation(ten, 1.0, kind=kind, tau=table['tau_s'], data_type='phase')
    for tau, value, wanted in zip(curve.tau, curve.deviation, row(table, kind), strict=True):
        if (kind, 10, tau) in MISPRINTS:
            assert wanted == MISPRINTS[kind, 10, tau]
            wanted = row(table, 'ohdev')[0]
        assert printed(value, wanted) == wanted


@pytest.mark.data
def test_the_data_file_is_the_printed_generator(shared_data):
    stored = np.loadtxt(shared_data / 'nbs14' / 'nbs14_1000_frequency.csv')
    np.testing.assert_allclose(thousand(), stored, rtol=1e-15)


def test_table_32_interval():
    """
    Table 32 (p. 109): overlapped deviation 9.159953e-2 at averaging factor 10, 95 %.

    The printed bounds take the chi-squared quantiles of 146 degrees of freedom where the
    table says 146.177; with the printed number they would be 0.06 % lower, which is what
    `interval` returns.
    """
    value, degrees = 9.159953e-2, 146.177
    printed_low, printed_high = 8.223942e-2, 1.035201e-1
    quantiles = stats.chi2.ppf([0.975, 0.025], 146)
    assert printed_low == pytest.approx(value * math.sqrt(degrees / quantiles[0]), rel=5e-6)
    assert printed_high == pytest.approx(value * math.sqrt(degrees / quantiles[1]), rel=5e-5)
    low, high = interval(value, degrees, 0.95)
    exact = value * np.sqrt(degrees / stats.chi2.ppf([0.975, 0.025], degrees))
    np.testing.assert_allclose([low, high], exact, rtol=1e-12)
    np.testing.assert_allclose([low, high], [printed_low, printed_high], rtol=7e-4)


def test_table_32_degrees_of_freedom():
    """
    Table 32 prints 146.177 for white noise, from the approximation in its table 5.

    The exact number is 146.07 (see test_confidence_exact), 0.07 % from it.
    """
    table_5 = (3 * 1000 / 20 - 2 * 999 / 1001) * 400 / 405
    assert table_5 == pytest.approx(146.177, abs=1e-3)
    assert float(edf('oadev', 0, 10, 1000)) == pytest.approx(146.177, rel=1e-3)


def test_table_32_as_one_call():
    curve = allan.deviation(thousand(), 1.0, tau=[10.0])
    assert curve.noise == ['white']
    assert curve.low[0] == pytest.approx(8.223942e-2, rel=1e-3)
    assert curve.high[0] == pytest.approx(1.035201e-1, rel=1e-3)
    assert curve.terms[0] == 981
