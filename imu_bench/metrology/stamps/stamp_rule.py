# SPDX-License-Identifier: Apache-2.0
"""The sample period and the coarseness of stamps, found before anything is known of them."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.errors import DataError
import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]

GROUPED = 0.25
"""Samples closer than this, in periods, came together."""

_HALF = 0.5
_COARSE = 0.05
"""Step of the stamps in periods below which they are fine: rounding to it scatters by 1.4 %."""

_TWO = 1.2
"""Ratio of two steps from which they are two."""

_MULTIPLE = 0.05
"""How far from a whole number a ratio is that missing samples may leave."""

_FEW_STEPS = 40
_MANY = 1024
"""Stamps in which one that is missing changes the slope of a line by 1.5 per thousand at most."""

_STRETCH = 4096
_RESOLUTIONS = (10**9, 10**8, 10**7, 10**6, 10**5, 10**4)
"""Steps in ns that are looked for, from a second to 10 µs: decimals of a second in text."""


@dataclass(frozen=True)
class Rule:
    """What the judgement needs to know of the stamps."""

    period: float  # sample period in ns, good to a per cent
    resolution: float = 0.0  # step of the stamps in ns; 0 where it is much finer than the period
    # how much longer than the period, in periods, the longer of two usual steps is; 0 where there
    # is one, or the longer one is what a missing sample leaves
    uneven: float = 0.0

    @classmethod
    def of(cls, stamps: Integers, period: float | None = None) -> Rule:
        """Return the rule for these stamps, in ns; `period` in ns if it is known."""
        given = period
        if period is None:
            period = _rough_period(stamps)
        coarse = _coarseness(stamps, period)
        two = None if coarse else _two_steps(stamps)
        if two is None:
            return cls(period, coarse)
        mean, longer = two
        return cls(mean if given is None else period, 0.0, longer / mean - 1.0)

    @property
    def lateness(self) -> float:
        """Lateness in periods from which samples are called missing."""
        return _HALF + self.resolution / self.period + self.uneven


def _stretches(stamps: Integers) -> list[Integers]:
    """Return up to 16 stretches of stamps spread over the recording."""
    if stamps.size <= 16 * _STRETCH:
        return [stamps]
    starts = np.linspace(0, stamps.size - _STRETCH, 16).astype(np.int64)
    return [stamps[start : start + _STRETCH] for start in starts]


def _two_steps(stamps: Integers) -> tuple[float, float] | None:
    """Return the mean step and the longer one where stamps take two steps by turns."""
    # A sensor that is read on the ticks of something else does.  Where the longer step is a
    # multiple of the shorter one, samples may be missing, and this returns None.
    steps = np.concatenate([np.diff(stretch) for stretch in _stretches(stamps)])
    steps = np.sort(steps[steps > 0]).astype(np.float64)
    if steps.size < _FEW_STEPS:
        return None
    steps = steps[steps < 4.0 * steps[steps.size // 2]]
    edge = steps.size // 10
    split = edge + int(np.argmax(np.diff(steps[edge:-edge]))) + 1
    shorter, longer = steps[:split], steps[split:]
    apart = float(np.median(longer) - np.median(shorter))
    ratio = float(np.median(longer) / np.median(shorter))
    clear = max(np.subtract(*np.quantile(part, (0.9, 0.1))) for part in (shorter, longer))
    if ratio < _TWO or ratio > 3.5 or apart < 3.0 * clear or longer[0] - shorter[-1] < clear:
        return None
    return None if abs(ratio - round(ratio)) < _MULTIPLE else (float(steps.mean()), longer[-1])


def _rough_period(stamps: Integers) -> float:
    """Return the sample period in ns: the usual step, or a long-lag mean for uneven stamps."""
    stretches = _stretches(stamps)
    steps = np.concatenate([np.diff(stretch) for stretch in stretches])
    forward = steps[steps >= 0]
    if not np.any(steps > 0):
        fault = 'all stamps are equal' if not np.any(steps < 0) else 'the stamps run backwards'
        raise DataError(
            f'{fault} ({stamps.size} stamps from {int(stamps[0])} ns): no sample rate; '
            'give the rate, or use a recording whose stamps advance'
        )
    size = stretches[0].size
    lag = max(1, min(1024, size // 8 if size >= 256 else size // 4))
    lagged = np.concatenate([stretch[lag:] - stretch[:-lag] for stretch in stretches])
    lagged = lagged[lagged > 0]
    overall = float(np.median(lagged)) / lag if lagged.size else float(np.mean(forward))
    if _step_of(stretches[0], overall) and (steady := _steady_period(stretches)):
        return steady
    quarter, usual = np.quantile(forward, (0.25, 0.5), method='lower')
    if 0 < quarter < 0.75 * usual:  # more than half of the samples may be lost
        multiple = forward / quarter
        if np.mean(np.abs(multiple - np.rint(multiple)) < 0.2) > 0.8:
            usual = quarter
    early = np.mean(forward <= _HALF * usual)
    # losing four samples of five makes the overall rate five times lower, a burst far more
    if early > 0.1 or usual < 0.2 * overall or _coarseness(stamps, float(usual)):
        return _burst_period(stretches, overall)
    return float(np.mean(forward[np.abs(forward - usual) < _HALF * usual]))


def _steady_period(stretches: list[Integers]) -> float:
    """Return the slope of stamps that stay within a period of a straight line; 0 elsewhere."""
    # They do where fewer than one in a hundred is missing.  The usual step of coarse stamps is a
    # multiple of their own step instead, and with jitter a half or twice of it is as usual.
    if stretches[0].size < _MANY:
        return 0.0
    place = np.arange(_MANY) - 0.5 * (_MANY - 1)
    pieces = np.concatenate([s[: s.size // _MANY * _MANY].reshape(-1, _MANY) for s in stretches])
    late = (pieces - pieces[:, :1]).astype(np.float64)
    late -= late.mean(axis=1, keepdims=True)
    slope = late @ place / (place @ place)
    late -= slope[:, None] * place
    period = float(np.median(slope))
    return period if float(np.median(np.std(late, axis=1))) < period else 0.0


def _burst_period(stretches: list[Integers], period: float) -> float:
    """Return the sample period from the last stamps of bursts: how many came in what time."""
    found = []
    for stretch in stretches:
        ends = np.flatnonzero(np.diff(stretch) >= GROUPED * period)
        lag = max(1, min(256, ends.size // 4))
        if ends.size > lag:
            late, early = ends[lag:], ends[:-lag]
            found.append((stretch[late] - stretch[early]) / (late - early))
    usual = float(np.median(np.concatenate(found))) if found else 0.0
    return usual if usual > 0.0 else period  # stamps may step back as far as they advance


def _step_of(stamps: Integers, period: float) -> int:
    """Return the decimal step that nearly all stamps are multiples of; 0 if it is fine."""
    for step in _RESOLUTIONS:
        if step < _COARSE * period:
            break
        # a stamp that went through a float64 of epoch seconds is off by up to 240 ns
        off = np.abs((stamps + step // 2) % step - step // 2)
        if np.mean(off <= min(300, step // 20)) > 0.999:
            return step
    return 0


def _coarseness(stamps: Integers, period: float) -> float:
    """Return the step of stamps that were rounded to it, in ns; 0 if they were not."""
    # Stamps that advance by exactly one period are multiples of it as well.  What
    # tells rounded stamps apart is that their steps vary, and yet no stamp strays
    # from a straight line by more than the step.
    part = stamps[: 1 << 17]
    step = _step_of(part, period)
    if step == 0:
        return 0.0
    for size in (part.size, min(part.size, 16384), min(part.size, 1024)):
        pieces = part[: part.size // size * size].reshape(-1, size)
        jumps = np.count_nonzero(np.abs(np.diff(pieces, axis=1) - period) > _HALF * step, axis=1)
        place = np.arange(size, dtype=np.float64)
        place -= place.mean()
        late = (pieces - pieces[:, :1]).astype(np.float64)
        late -= late.mean(axis=1, keepdims=True)
        late -= np.outer(late @ place / max(float(place @ place), 1.0), place)
        straight = (np.ptp(late, axis=1) <= 1.1 * step + 600) & (jumps >= 4)
        if np.mean(straight) >= _HALF:
            return float(step)
    return 0.0
