# SPDX-License-Identifier: Apache-2.0
"""How long a record must be for a noise coefficient to be known well enough."""

from __future__ import annotations

import math

from imu_bench.metrology.curve import Floats
from imu_bench.metrology.fitting.noise_model import density_basis
import numpy as np

TARGET = 0.1
"""Relative standard deviation of a coefficient that counts as known."""

LONGEST = 1e7
"""Records beyond this many seconds (116 days) are not worth a number."""

_POINTS = 240


def seconds_needed(
    terms: str, squares: Floats, term: str, period: float, record: float, deviation: float
) -> float:
    """
    Return the length of a record in s that gives a coefficient to `TARGET`; inf beyond `LONGEST`.

    The best possible error of a record of length T follows from the Fisher information of its
    spectrum between 1/T and half the sample rate (P. Whittle 1953): every resolved frequency
    tells each share of the density with the scatter of an exponential variable.  The error
    reached in the present record over its best possible one is taken to stay as it is.

    Parameters
    ----------
    terms : str
        Terms of the model, of 'QNBKR', with `term` among them.
    squares : ndarray, shape (len(terms),)
        Squared coefficients.
    term : str
        The coefficient in question.
    period, record : float
        Sample period and length of the present record in s.
    deviation : float
        Standard deviation of the square of `term` in the present record.
    """
    square = float(squares[terms.index(term)])
    relative = deviation / (2.0 * square)
    if relative <= TARGET:
        return record
    if term == 'R':
        return _for_ramp(terms, squares, relative, record)
    random = [i for i, t in enumerate(terms) if t != 'R']
    letters = ''.join(terms[i] for i in random)
    shares = _shares(letters, squares[random], period, max(LONGEST, 10.0 * record))
    lengths, best = _best_errors(*shares, letters.index(term), record)
    reached = np.interp(math.log(record), np.log(lengths), np.log(best))
    wanted = math.log(TARGET / relative) + reached
    falling = np.minimum.accumulate(np.log(best))
    if falling[-1] > wanted:
        return math.inf
    return float(math.exp(np.interp(-wanted, -falling, np.log(lengths))))


def _for_ramp(terms: str, squares: Floats, relative: float, record: float) -> float:
    """Return the length for a ramp: its error falls as T^-1/2, T^-1, T^-3/2 by the noise."""
    present = {t for t, s in zip(terms, squares, strict=True) if s > 0.0}
    power = 0.5 if 'K' in present else 1.0 if 'B' in present else 1.5
    seconds = record * (relative / TARGET) ** (1.0 / power)
    return seconds if seconds <= LONGEST else math.inf


def _shares(
    terms: str, squares: Floats, period: float, longest: float
) -> tuple[Floats, Floats, Floats]:
    """Return frequencies, descending, their widths, and each term's share of the density."""
    log_f = np.linspace(math.log(0.5 / period), -math.log(longest), _POINTS)
    frequency = np.exp(log_f)
    parts = squares[:, None] * density_basis(frequency, period, terms)
    return frequency, frequency * (log_f[0] - log_f[1]), parts / parts.sum(axis=0)


def _best_errors(
    frequency: Floats, width: Floats, shares: Floats, index: int, record: float
) -> tuple[Floats, Floats]:
    """Return record lengths, ascending, and the best relative error of one square in each."""
    products = shares[:, None, :] * shares[None, :, :] * width
    information = np.moveaxis(np.cumsum(products, axis=-1), -1, 0)
    lengths = 1.0 / frequency
    long = lengths >= 0.5 * record
    matrices = information[long] * lengths[long, None, None]
    matrices = matrices + 1e-12 * np.eye(len(shares))
    variance = np.linalg.inv(matrices)[:, index, index]
    return lengths[long], np.sqrt(np.maximum(variance, 1e-300))
