# SPDX-License-Identifier: Apache-2.0
"""
Deviations of records that lose single samples: averages that lack a few of them count.

Scattered losses leave no long average complete.  Where the user says so, an average counts if
at least a share of its samples is there, and is the mean of those; nothing is interpolated.
I. Sesia and P. Tavella, "Estimating the Allan variance in the presence of long periods of
missing data and outliers", Metrologia 45 (2008) S134, leave missing data out of the averages in
the same way.  What that costs:

* White noise in two averages of n and n' samples has the Allan variance of m = 2 n n'/(n + n')
  samples.  The counts are known, so the white part of each point is brought back to full
  averages; uncorrected, it would look like a filter, because short averages lack nothing.
* Averages that lack samples at one end have their middle elsewhere.  Losses at random cancel
  out; a hole that is just allowed changes the distance of two neighbours by up to half of the
  share that may be missing, and the deviation of a ramp or a slow walk likewise.
"""

from __future__ import annotations

from imu_bench.errors import DataError
from imu_bench.metrology import blockwise
from imu_bench.metrology.blockwise import Run, square_sum
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.deviations import confidence as trust
from imu_bench.metrology.deviations import noise_type
from imu_bench.metrology.deviations.allan_curve import NoAveragingTime
from imu_bench.metrology.deviations.averaging import averaging_factors, decimation, Taus
from imu_bench.metrology.deviations.integral import cumulate, TOO_LARGE
from imu_bench.metrology.stretches import stretches
import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

TINY = 1e-300
"""Keeps quotients of nothing finite."""


def check_share(min_share: float, kind: str, data_type: str) -> None:
    """Refuse a share that makes no sense, or a deviation whose averages must be complete."""
    if not 0.5 <= min_share <= 1.0:
        raise DataError(f'min_share must lie between 0.5 and 1, got {min_share}')
    if min_share < 1.0 and (kind != 'oadev' or data_type != 'rate'):
        raise DataError(
            f"min_share below 1 is for kind='oadev' and data_type='rate', "
            f'not for {kind!r} of {data_type!r}'
        )


def deviation_of_most(
    values: npt.NDArray[np.generic], valid: Mask, rate_hz: float, tau: Taus, min_share: float,
    unit: str, confidence: float, thin: bool, intervals: str, run: Run,
) -> DeviationCurve:  # fmt: skip
    """
    Return the overlapped Allan deviation over averages that have most of their samples.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Rate samples.
    min_share : float
        Least share of its samples that an average needs.
    thin : bool
        Whether long averages may start at every 3rd, 9th, ... sample.
    rate_hz, tau, unit, confidence, intervals
        As for `allan.deviation`.
    run : callable
        From `blockwise.cores`.

    Notes
    -----
    Degrees of freedom are those of a record without gaps that has as many differences.
    """
    phase = cumulate(values, valid, run)
    count = np.concatenate([[0], np.cumsum(valid)])
    wanted = averaging_factors(values.size, tau, rate_hz, 'oadev')
    stride = decimation(wanted, values.size) if thin else np.ones(wanted.size, np.int64)
    sums, terms, excess = _sums(phase, count, wanted, stride, min_share, run)
    some = terms > 0
    if not some.any():
        raise NoAveragingTime(
            f'no two neighbouring averages have {100.0 * min_share:g} % of their samples at any '
            'averaging time; allow for fewer, or record longer'
        )
    m, stride, terms = wanted[some], stride[some], terms[some]
    sums, excess = sums[some], excess[some]
    together, stretches = _moved_together(phase, valid, count, m, min_share)
    alpha = noise_type.identify_within(stretches, together, m)
    again = (alpha > 0) & (stride > 1)
    if again.any():
        stride[again] = 1
        sums[again], terms[again], excess[again] = _sums(
            phase, count, m[again], stride[again], min_share, run
        )
    if not np.all(np.isfinite(sums)):
        raise DataError(TOO_LARGE)
    period = 1.0 / rate_hz
    deviation = np.sqrt(_of_full_averages(sums / (2.0 * terms), m, excess, values.size))
    alike = terms * stride + 2 * m - 1
    degrees = trust.edf('oadev', alpha, m, np.minimum(alike, values.size))
    samples = int(count[-1])
    if intervals == 'simple':
        low, high = trust.simple_interval(deviation, m, samples, confidence)
    else:
        low, high = trust.interval(deviation, degrees, confidence)
    reason = f'no two neighbouring averages have {100.0 * min_share:g} % of their samples'
    return DeviationCurve(
        'oadev', unit, period, samples, values.size, m, np.asarray(m * period, np.float64),
        deviation, low, high, degrees, terms, alpha, confidence,
        tuple((factor * period, reason) for factor in wanted[~some].tolist()), min_share,
    )  # fmt: skip


def _sums(
    phase: Floats, count: Integers, m: Integers, stride: Integers, min_share: float, run: Run
) -> tuple[Floats, Integers, Floats]:
    """Return sum and number of the squared differences of neighbouring averages."""
    # And by how much their white noise is above that of averages that lack nothing.
    sums, excess = np.zeros(m.size), np.zeros(m.size)
    terms = np.zeros(m.size, np.int64)
    thin_phase, thin_count, done = phase, count, 1
    for index in np.argsort(stride, kind='stable').tolist():
        if (step := int(stride[index])) > done:
            thin_phase, thin_count, done = phase[::step].copy(), count[::step].copy(), step
        # less a rounding, so that a share of exactly min_share counts
        least = max(min_share * int(m[index]) * (1.0 - 1e-12), 1.0)
        sums[index], terms[index], inverse = _of_factor(
            thin_phase, thin_count, int(m[index]) // step, least, run
        )
        excess[index] = 0.5 * int(m[index]) * inverse / max(terms[index], 1) - 1.0
    return sums, terms, excess


_PAST_FILTER = 30
"""Averaging factor from which filters of sensors no longer bend a curve much."""


def _of_full_averages(variance: Floats, m: Integers, excess: Floats, span: int) -> Floats:
    """Return Allan variances less what missing samples add to their white noise."""
    # How much of a variance is white says a sum of powers of m, weighted by what each point knows.
    flat = m >= _PAST_FILTER
    used = flat if np.count_nonzero(flat) >= 5 else np.ones(m.size, np.bool_)
    steps = m[used].astype(np.float64)
    columns = np.stack([(1.0 + excess[used]) / steps, steps**-2, steps**0, steps, steps**2])
    weights = np.sqrt(span / steps) / np.maximum(variance[used], TINY)
    scale = np.maximum(np.linalg.norm(columns * weights, axis=1), TINY)
    squares, _ = scipy.optimize.nnls(
        (columns * weights / scale[:, None]).T, weights * variance[used]
    )
    white = squares[0] / scale[0]
    return np.asarray(np.maximum(variance - excess * white / m, 0.5 * variance), np.float64)


def _of_factor(
    phase: Floats, count: Integers, m: int, least: float, run: Run
) -> tuple[float, int, float]:
    """Return sum and number of the squared differences of averages over m steps."""
    # And the sum of the inverse numbers of samples in the averages of each.

    def averages(start: int, stop: int) -> tuple[Floats, Mask, Integers]:
        mean = phase[start + m : stop + m] - phase[start:stop]
        present = count[start + m : stop + m] - count[start:stop]
        enough = present >= least
        np.divide(mean, present, out=mean, where=enough)
        return mean, enough, present

    def squares(start: int) -> tuple[float, int, float]:
        stop = min(start + blockwise.BLOCK, phase.size - 2 * m)
        first, enough, before = averages(start, stop)
        second, as_well, after = averages(start + m, stop + m)
        enough &= as_well
        inverse = float((1.0 / before[enough]).sum() + (1.0 / after[enough]).sum())
        second -= first
        np.copyto(second, 0.0, where=~enough)
        return square_sum(second), int(np.count_nonzero(enough)), inverse

    starts = range(0, max(phase.size - 2 * m, 0), blockwise.BLOCK)
    parts = [(0.0, 0, 0.0), *run(squares, starts)]
    total, number, inverse = (sum(column) for column in zip(*parts, strict=True))
    return float(total), int(number), float(inverse)


def _moved_together(
    phase: Floats, valid: Mask, count: Integers, m: Integers, min_share: float
) -> tuple[Floats, noise_type.Stretches]:
    """Return the phase of the samples that are there, and its stretches between long holes."""
    # It serves to tell white noise from flicker and walk, which a hole far shorter than the
    # averages does not change.
    together = np.concatenate([phase[:1], phase[1:][valid]])
    holes = stretches(~valid)
    long = holes[holes[:, 1] - holes[:, 0] > (1.0 - min_share) * int(m[-1])]
    cuts = np.unique(count[long[:, 0]])
    edges = np.concatenate([[0], cuts, [together.size - 1]])
    runs = np.stack([edges[:-1], edges[1:] + 1], axis=1)
    return together, noise_type.Stretches(runs[runs[:, 1] - runs[:, 0] > 1])
