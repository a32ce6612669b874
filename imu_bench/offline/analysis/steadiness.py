# SPDX-License-Identifier: Apache-2.0
"""Whether the noise of one axis stayed the same over a recording: dynamic Allan deviation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imu_bench.metrology import allan
from imu_bench.metrology.allan import DynamicDeviation
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.offline.analysis.json_forms import rows_from_json
from imu_bench.offline.notation import duration, number
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

WINDOWS = 12
"""Windows of a recording, which do not overlap."""

_TAUS = 6
_LONGEST = 20.0  # averaging times in a window at least: fewer have intervals that say nothing
_FEWEST = 200  # samples per window
_CHANGE = 1.1
"""The noise changed when the ratio is certainly above this: parts scatter more."""

_PLAIN = ('verdict', 'text', 'window_s', 'tau')
_ARRAYS = ('start', 'deviation', 'low', 'high')


@dataclass(frozen=True, eq=False)
class Steadiness:
    """The noise of one axis over time."""

    verdict: str  # 'steady', 'changes' or 'too short'
    text: str  # the verdict in words
    window_s: float  # length of each window
    tau: float  # averaging time in s at which the windows differ most clearly
    # largest over smallest deviation of a window there; its interval covers all windows and
    # averaging times that were looked at together
    ratio: Estimate
    # start, deviation, low, high: start of each window in s after the start of the recording,
    # deviation there with its interval (each at the level of the whole divided by the number of
    # looks)
    start: Floats
    deviation: Floats
    low: Floats
    high: Floats

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object."""
        return {
            'verdict': self.verdict,
            'text': self.text,
            'window_s': self.window_s,
            'tau': self.tau,
            'ratio': self.ratio.to_json(),
            'windows': {name: getattr(self, name).tolist() for name in _ARRAYS},
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Steadiness:
        """Return what `to_json` wrote."""
        fields: dict[str, Any] = {name: document[name] for name in _PLAIN}
        windows = document['windows']
        fields |= zip(_ARRAYS, rows_from_json(windows, _ARRAYS), strict=True)
        return cls(ratio=Estimate.from_json(document['ratio']), **fields)


def examine(
    placed: Floats,
    rate_hz: float,
    unit: str,
    *,
    valid: Bools | None = None,
    start_s: float = 0.0,
    confidence: float = CONFIDENCE,
) -> Steadiness:
    """Return whether the noise stayed the same."""
    size = placed.size // WINDOWS
    if size < _FEWEST:
        return _untested(f'{WINDOWS} windows of {_FEWEST} samples are needed', unit, confidence)
    window = size / rate_hz
    factors = np.unique(np.geomspace(1.0, size / _LONGEST, _TAUS).astype(np.int64))
    level = 1.0 - (1.0 - confidence) / (WINDOWS * factors.size)
    moving = allan.dynamic_deviation(
        placed, rate_hz, window, window, valid=valid, unit=unit, confidence=level,
        tau=(factors / rate_hz).tolist(),
    )  # fmt: skip
    clearest = max(_tables(moving, factors), key=_certain_ratio, default=None)
    if clearest is None:
        return _untested('gaps leave no two windows to compare', unit, confidence)
    start, (deviation, low, high) = start_s + moving.start[clearest.there], clearest.rows
    ratio = Estimate(
        float(deviation.max() / deviation.min()),
        max(_certain_ratio(clearest), 1.0),
        float(high.max() / low.min()),
        '1',
        confidence,
        method='dynamic Allan deviation',
    )
    changes = (ratio.low or 1.0) > _CHANGE
    tau = clearest.m / rate_hz
    return Steadiness(
        'changes' if changes else 'steady',
        _words(changes, ratio, tau, window),
        window, tau, ratio, start, deviation, low, high,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Table:
    """The windows at one averaging factor: which of them have it, and (3, w) numbers."""

    m: int
    there: Bools
    rows: Floats


def _tables(moving: DynamicDeviation, factors: npt.NDArray[np.int64]) -> list[_Table]:
    """Return one table for each averaging time that at least two windows have."""
    found = []
    for m in factors.tolist():
        rows = np.zeros((3, len(moving.curves)))
        for column, curve in enumerate(moving.curves):
            if curve is not None and m in curve.m:
                at = int(np.searchsorted(curve.m, m))
                rows[:, column] = curve.deviation[at], curve.low[at], curve.high[at]
        # a window without any noise is stuck, which the health check tells
        there: Bools = np.all(rows > 0.0, axis=0)
        if np.count_nonzero(there) > 1:
            found.append(_Table(m, there, rows[:, there]))
    return found


def _certain_ratio(table: _Table) -> float:
    """Return the ratio of the noisiest to the quietest window that is surely exceeded."""
    _, low, high = table.rows
    return float(low.max() / high.min())


def _words(changes: bool, ratio: Estimate, tau: float, window: float) -> str:
    at, of = f'the noise at τ = {duration(tau)}', f'windows of {duration(window)}'
    if not changes:
        return f'{at} stays within a factor of {number(ratio.high or 1.0, 3)} over {of}'
    low, high = number(ratio.low or 1.0, 2), number(ratio.high or 1.0, 2)
    factor = number(ratio.value or 1.0, 2)
    return f'{at} differs by a factor of {factor} ({low} to {high}) between {of}'


def _untested(reason: str, unit: str, confidence: float) -> Steadiness:
    nothing = np.empty(0)
    return Steadiness(
        'too short', f'not tested: {reason}', 0.0, 0.0,
        Estimate.not_observable('1', reason, confidence=confidence),
        nothing, nothing, nothing, nothing,
    )  # fmt: skip
