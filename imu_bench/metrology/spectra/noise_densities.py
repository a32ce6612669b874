# SPDX-License-Identifier: Apache-2.0
"""Whether the noise densities of three methods agree, and what it means if they do not."""

from __future__ import annotations

from dataclasses import dataclass
import math

from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate

AGREE = 0.10
"""
Densities that differ by no more than this are called equal whatever their intervals: a bandwidth
that is off by 20 % makes as much of sigma/√bandwidth.
"""


@dataclass(frozen=True)
class NoiseDensities:
    """One-sided noise density by three methods, and what their difference means."""

    from_sigma: Estimate  # standard deviation over the square root of the noise bandwidth
    from_plateau: Estimate  # flat part of the spectrum
    from_allan: Estimate  # square root of 2 times N
    agree: bool  # whether all that are observable agree
    verdict: str  # one sentence for the user


def compare_densities(
    from_sigma: Estimate, from_plateau: Estimate, from_allan: Estimate
) -> NoiseDensities:
    """
    Return the three one-sided noise densities with a verdict on whether they agree.

    Parameters
    ----------
    from_sigma : Estimate
        Of `spectrum.density_from_sigma`.
    from_plateau : Estimate
        Of `spectrum.plateau`.
    from_allan : Estimate
        One-sided, `spectrum.one_sided(N)`.

    Notes
    -----
    Two densities agree when their intervals overlap or they differ by less than
    `AGREE`.  The plateau and N are two views of the same white noise; sigma
    counts everything in the band, and trusts the bandwidth it is given.

    Examples
    --------
    >>> def density(value):
    ...     return Estimate(value, 0.99 * value, 1.01 * value, 'm/s²/√Hz')
    >>> compare_densities(density(1.5), density(1.0), density(1.02)).agree
    False
    """
    found = {'sigma': from_sigma, 'plateau': from_plateau, 'allan': from_allan}
    units = {estimate.unit for estimate in found.values()}
    if len(units) > 1:
        raise DataError(f'densities in different units: {", ".join(sorted(units))}')
    present = {name: e for name, e in found.items() if e.observable}
    if len(present) < 2:
        verdict = 'fewer than two methods give a noise density; nothing to compare'
        return NoiseDensities(from_sigma, from_plateau, from_allan, True, verdict)
    verdict = _difference(present)
    return NoiseDensities(
        from_sigma, from_plateau, from_allan, not verdict,
        verdict or f'{len(present)} methods agree',
    )  # fmt: skip


def _agree(first: Estimate, second: Estimate) -> bool:
    a, b = first.value or 0.0, second.value or 0.0
    if abs(a - b) <= AGREE * max(a, b):
        return True
    bounds = (first.low, first.high, second.low, second.high)
    low1, high1, low2, high2 = (math.nan if bound is None else bound for bound in bounds)
    return low1 <= high2 and low2 <= high1


def _difference(present: dict[str, Estimate]) -> str:
    """Return why the densities disagree; empty if they agree."""

    def ratio(first: str, second: str) -> float:
        return (present[first].value or 0.0) / (present[second].value or math.inf)

    if {'plateau', 'allan'} <= present.keys() and not _agree(present['plateau'], present['allan']):
        return (
            f'the plateau of the spectrum is {ratio("plateau", "allan"):.2f} times the density '
            'from N: the noise is not white between the plateau and the averaging times of N '
            '(tones, a filter, flicker or quantisation noise); trust the plateau in its own band'
        )
    white = 'plateau' if 'plateau' in present else 'allan'
    if 'sigma' not in present or white not in present or _agree(present['sigma'], present[white]):
        return ''
    if ratio('sigma', white) > 1:
        return (
            f'sigma over the bandwidth is {ratio("sigma", white):.2f} times the white noise: '
            'tones, drift or motion add to sigma, or the true noise bandwidth is wider than given'
        )
    return (
        f'sigma over the bandwidth is {ratio("sigma", white):.2f} times the white noise: '
        'the true noise bandwidth is narrower than given'
    )
