# SPDX-License-Identifier: Apache-2.0
"""Total deviations, Thêo1, ThêoH, MTIE and TIE rms: published tables, definitions, theory."""

import json

from imu_bench.errors import DataError
from imu_bench.metrology.deviations import total
import numpy as np
import pytest

WHITE_BIAS = 1.0 - 0.005
"""Hadamard total over Hadamard variance of white noise: SP 1065, table in section 5.2.14."""


@pytest.fixture(scope='module')
def published(shared_data):
    return json.loads((shared_data / 'nbs14' / 'nbs14.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def ten(shared_data):
    return np.loadtxt(shared_data / 'nbs14' / 'nbs14_10_phase.csv')


def thousand():
    """Return the phase of the 1000-point set: NIST SP 1065 (2008), section 12."""
    numbers = [1234567890]
    while len(numbers) < 1000:
        numbers.append(16807 * numbers[-1] % 2147483647)
    return np.cumsum(np.concatenate([[0.0], np.array(numbers) / 2147483647]))


def as_printed(values, like):
    """Return values with as many significant digits as the printed ones have."""
    digits = [len(f'{one!r}'.replace('.', '').lstrip('0')) for one in like]
    return [float(f'{v:.{d - 1}e}') for v, d in zip(values, digits, strict=True)]


@pytest.mark.data
@pytest.mark.parametrize(
    ('kind', 'm', 'row'),
    [
        ('mtotdev', [1, 10, 100], 'mtotdev_stable32_1.60_no_bias_correction'),
        ('ttotdev', [1, 10, 100], 'ttotdev_stable32_1.60_no_bias_correction'),
        ('theo1', [10, 100, 1000], 'theo1_tau_10_100_1000_stable32_no_bias'),
    ],
)
def test_thousand_points(published, kind, m, row):
    wanted = published['nbs14_1000'][row]
    assert as_printed(getattr(total, kind)(thousand(), m, 1.0), wanted) == wanted


@pytest.mark.data
@pytest.mark.parametrize('kind', ['mtotdev', 'ttotdev'])
def test_ten_points(published, ten, kind):
    wanted = published['nbs14_10'][f'{kind}_stable32_no_bias']
    assert as_printed(getattr(total, kind)(ten, [1, 2], 1.0), wanted) == wanted


@pytest.mark.data
def test_hadamard_total_of_both_sets(published, ten):
    """Printed with the bias of white noise taken off beyond one sample."""
    for phase, m, row in (
        (thousand(), [1, 10, 100], published['nbs14_1000']['htotdev']),
        (ten, [1, 2], published['nbs14_10']['htotdev_published']),
    ):
        found = total.htotdev(phase, m, 1.0)
        found[1:] /= WHITE_BIAS**0.5
        np.testing.assert_allclose(found, row, rtol=1e-6)


@pytest.mark.parametrize(
    ('kind', 'rows'),
    [
        ('mtie', {1: 0.50597, 3: 1.2984, 7: 2.2922, 15: 2.9949, 31: 4.4550, 63: 6.5989,
                  127: 6.8061, 255: 7.8205, 511: 7.8205}),
        ('tie_rms', {1: 0.28832, 2: 0.40240, 10: 0.87588, 50: 1.9745, 101: 2.7603, 133: 2.9611,
                     200: 2.8163, 247: 2.6144}),
    ],
)  # fmt: skip
def test_intervals_of_time_as_stable32_prints_them(kind, rows):
    """
    Its PHASE.DAT is the 1000-point set without its mean frequency.

    Printed by Stable32 (allantools, tests/phase.dat: phase_dat_mtie.txt, phase_dat_tierms.txt).
    """
    phase = thousand()
    phase -= phase[-1] * np.arange(1001) / 1000
    found = getattr(total, kind)(phase, list(rows))
    # half a unit of the last of five digits
    assert found == pytest.approx(list(rows.values()), rel=5e-5)


def test_by_the_definitions():
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.normal(size=60))
    windows = [np.ptp(x[i : i + 8]) for i in range(x.size - 7)]
    assert total.mtie(x, [7])[0] == max(windows)
    steps = [x[i + 7] - x[i] for i in range(x.size - 7)]
    assert total.tie_rms(x, [7])[0] == pytest.approx(np.sqrt(np.mean(np.square(steps))))
    square = 0.0
    for i in range(x.size - 6):
        for d in range(3):
            square += (x[i] - x[i - d + 3] + x[i + 6] - x[i + d + 3]) ** 2 / (3 - d)
    wanted = np.sqrt(square / 0.75 / (x.size - 6)) / (6 * 0.1)
    assert total.theo1(x, [6], 0.1)[0] == pytest.approx(wanted)


@pytest.mark.slow
@pytest.mark.parametrize(('alpha', 'truth'), [(0, 1.0), (-1, None), (-2, None)])
def test_theoh_reaches_three_quarters_of_the_record_without_bias(noise, alpha, truth):
    """Against the mean Allan variance of records eight times as long."""
    n, m = 1024, [8, 128, 384, 720]
    found, known = [], []
    for seed in range(60):
        phase = np.cumsum(np.concatenate([[0.0], noise(seed, n, alpha)]))
        tau, deviation = total.theoh(phase, m, 1.0)
        found.append(deviation**2)
    if truth is not None:
        known = truth / tau
    else:
        for seed in range(100, 124):
            long = np.cumsum(noise(seed, 8 * n, alpha))
            known.append(
                [
                    np.mean((long[2 * f :] - 2 * long[f:-f] + long[: -2 * f]) ** 2) / (2 * f * f)
                    for f in np.rint(tau).astype(int)
                ]
            )
        known = np.mean(known, axis=0)
    assert tau[-1] == pytest.approx(720.0)
    np.testing.assert_allclose(np.mean(found, axis=0), known, rtol=0.35)
    np.testing.assert_allclose(np.mean(found, axis=0)[:2], np.asarray(known)[:2], rtol=0.2)


@pytest.mark.parametrize(
    ('kind', 'm', 'says'),
    [('mtotdev', [400], 'from 1 to 333'), ('theo1', [3], 'even'), ('htotdev', [], 'got')],
)
def test_refused(kind, m, says):
    with pytest.raises(DataError, match=says):
        getattr(total, kind)(np.arange(1000.0), m, 1.0)


def test_one_stretch_of_numbers():
    with pytest.raises(DataError, match='of one stretch'):
        total.mtie(np.array([0.0, np.nan, 1.0]), [1])
