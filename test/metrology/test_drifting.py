# SPDX-License-Identifier: Apache-2.0
"""Regression under noise that wanders: intervals that hold, and are hardly wider than need be."""

from imu_bench.errors import DataError
from imu_bench.metrology.trials.drifting import regress
import numpy as np
import pytest
from scipy import fft, linalg, special

COUNT = 300
RUNS = 150
INDEX = np.arange(COUNT)
DESIGN = np.column_stack([
    np.ones(COUNT),
    np.interp(INDEX, [50, 125, 225, 300], [-1.0, 1.0, 1.0, -1.0]),
    np.where(INDEX > 225, 1.0 - np.interp(INDEX, [225, 300], [1.0, -1.0]) ** 2, 0.0),
])  # fmt: skip
TRUTH = np.array([9.8, 0.4, 0.0])


def lines(columns):
    """Return the lines of the cosine transform that see no constant."""
    return fft.dct(columns, axis=0, norm='ortho')[1:]


def covariance(white, flicker, walk):
    """
    Return the exact covariance of averages over stretches of length 1, but for a constant.

    A walk W(t) has the generalised covariance -|h|/2 and flicker noise -ln|h|; that of
    averages is its second difference after two integrations: -|h|³/12 and -h² ln|h| / 2.
    """
    h = np.abs(np.subtract.outer(INDEX, INDEX)).astype(float)

    def averaged(twice):
        return twice(h + 1.0) + twice(np.abs(h - 1.0)) - 2.0 * twice(h)

    noise = white**2 * np.eye(COUNT)
    noise += flicker**2 * averaged(lambda x: -0.5 * special.xlogy(x * x, x))
    noise += walk**2 * averaged(lambda x: -(x**3) / 12.0)
    return lines(lines(noise).T)


@pytest.mark.slow
@pytest.mark.parametrize(
    'noise',
    [
        (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.5, 0.0), (1.0, 0.0, 0.1),
        (0.0, 1.0, 0.2), (1.0, 0.3, 0.03),
    ],
    ids=str,
)  # fmt: skip
def test_intervals_cover_and_are_not_much_wider_than_the_narrowest(noise):
    """The narrowest are those of somebody who knows the noise."""
    rng = np.random.default_rng(11)
    known = covariance(*noise)
    root = linalg.cholesky(known, lower=True)
    columns = linalg.solve_triangular(root, lines(DESIGN[:, 1:]), lower=True)
    narrowest = 2.0 * 1.96 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    inside, widths = np.zeros(2), []
    for _ in range(RUNS):
        data = DESIGN @ TRUTH
        data += fft.idct(np.concatenate([[0.0], root @ rng.normal(size=COUNT - 1)]), norm='ortho')
        found = regress(INDEX, DESIGN, data)
        both = [found.coefficient(column, '1') for column in (1, 2)]
        inside += [e.low < truth < e.high for e, truth in zip(both, TRUTH[1:], strict=True)]
        widths.append([e.high - e.low for e in both])
    # 95 % with a scatter of 2 %
    assert np.all(inside >= 0.89 * RUNS)
    ratio = np.median(widths, axis=0) / narrowest
    assert np.all(ratio < 1.5)
    assert np.all(ratio > 0.85)


def test_missing_values_are_as_if_they_had_not_been_asked_for():
    """With white noise that is seen as such, least squares over what is there."""
    rng = np.random.default_rng(3)
    there = (INDEX < 90) | (INDEX > 120)
    data = (DESIGN @ TRUTH + 0.01 * rng.normal(size=COUNT))[there]
    found = regress(INDEX[there], DESIGN[there], data)
    expected = np.linalg.lstsq(DESIGN[there], data, rcond=None)[0]
    for column in (0, 1, 2):
        estimate = found.coefficient(column, '1')
        half = estimate.high - estimate.value
        level = expected[0] if column == 0 else expected[column]
        assert estimate.value == pytest.approx(level, abs=0.5 * half)
        assert estimate.low < TRUTH[column] < estimate.high


def test_a_contrast_knows_that_the_coefficients_hold_the_same_noise():
    """What the coefficients explain wholly has no error left."""
    rng = np.random.default_rng(4)
    data = DESIGN @ TRUTH + rng.normal(size=COUNT)
    found = regress(INDEX, DESIGN[:, :2], data)
    gram = DESIGN[:, :2].T @ DESIGN[:, :2]
    # the weights with which least squares make the slope
    slope = np.linalg.solve(gram, DESIGN[:, :2].T)[1]
    left = found.contrast(slope, 2, '1')
    whole = found.contrast(slope, 1, '1')
    assert left.high - left.low < 0.5 * (whole.high - whole.low)
    assert whole.value == pytest.approx(found.coefficient(1, '1').value, abs=0.05)


def test_data_without_noise_give_the_coefficients_exactly():
    found = regress(INDEX, DESIGN, DESIGN @ TRUTH)
    for column, truth in enumerate(TRUTH):
        estimate = found.coefficient(column, '1')
        assert estimate.value == pytest.approx(truth, abs=1e-12)
        assert estimate.high - estimate.low < 1e-10
    constant = regress(INDEX, DESIGN, np.full(COUNT, 9.8)).coefficient(1, '1')
    assert constant.low <= 0.0 <= constant.high


@pytest.mark.parametrize(
    ('design', 'text'),
    [
        (np.ones((3, 1)), '3 points are too few'),
        (np.arange(50.0)[:, None], 'first column of the design is not constant'),
        (np.ones((50, 2)), 'depend on one another'),
    ],
)
def test_a_regression_that_cannot_be_is_refused(design, text):
    count = len(design)
    with pytest.raises(DataError, match=text):
        regress(np.arange(count), design, np.arange(float(count)))
