# SPDX-License-Identifier: Apache-2.0
"""What the temperature of a sensor does to its bias, and whether it is why the bias moved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from imu_bench.counting import listed
from imu_bench.errors import DataError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.trials import thermal
from imu_bench.metrology.trials.drifting import regress
from imu_bench.offline.analysis.blocks import Blocks
from imu_bench.offline.notation import text
from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.companions import companion
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_SURE = 0.999
"""Level at which a coefficient must not be zero: of six axes one errs in 170 recordings."""

_MOST = 1 << 18
"""Readings of the temperature that are looked at, as many as averages of an axis."""

_NAMED = 3


class Warmth(NamedTuple):
    """The temperature during a recording: s since its first sample, and °C."""

    time: Floats
    celsius: Floats


@dataclass(frozen=True)
class Effect:
    """How the bias of one axis went with the temperature."""

    coefficient: Estimate  # change of the bias, in the unit of the axis per K
    low: float  # lowest and highest temperature, in °C
    high: float
    follows: bool  # whether there is no doubt that it is not zero

    @property
    def telling(self) -> bool:
        """Whether it says something of the sensor: it was seen, or it was warmed enough to be."""
        return self.follows or self.high - self.low >= thermal.LEAST_SPAN

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object."""
        return {
            'coefficient': self.coefficient.to_json(),
            'low_celsius': self.low,
            'high_celsius': self.high,
            'follows': self.follows,
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Effect:
        """Return what `to_json` wrote."""
        return cls(
            Estimate.from_json(document['coefficient']),
            document['low_celsius'],
            document['high_celsius'],
            document['follows'],
        )


def warmth(recording: Recording) -> Warmth | None:
    """Return the temperature during a recording; None where nobody measured it."""
    found = companion(recording, 'temperature')
    if found is None:
        return None
    part = slice(None, None, -(-found.stamps.size // _MOST))
    since = found.stamps[part] - recording.samples.stamps[0]
    order = np.argsort(since, kind='stable')
    return Warmth(np.asarray(since[order] * 1e-9, np.float64), found.values[part, 0][order])


def effect(warm: Warmth, blocks: Blocks, unit: str, confidence: float) -> Effect | None:
    """Return what temperature did to the bias of an axis; None where it was always the same."""
    place = np.flatnonzero(blocks.valid)
    when = (place + 0.5) / blocks.rate_hz
    celsius = np.interp(when, *warm)
    if when.size < 2 or not np.ptp(celsius):
        return None
    try:
        held = thermal.averages(when, blocks.values[place], celsius)
        off = held.temperature - held.temperature.mean()
        model = regress(held.index, np.column_stack([np.ones_like(off), off]), held.bias)
    except DataError:
        # too short, or the averages of the temperature are all equal
        return None
    sure = model.coefficient(1, f'{unit}/K', _SURE)
    return Effect(
        model.coefficient(1, f'{unit}/K', confidence),
        float(celsius.min()),
        float(celsius.max()),
        follows=sure.low is not None and sure.high is not None and not sure.low <= 0 <= sure.high,
    )


def said(effects: Iterable[tuple[str, Effect | None]]) -> str:
    """Return whether the temperature is why axes, by name, moved; empty if nobody can tell."""
    known = [(name, found) for name, found in effects if found is not None]
    if not known:
        return ''
    low, high = min(e.low for _, e in known), max(e.high for _, e in known)
    span = f'the temperature, {low:.1f} to {high:.1f} °C'
    follow = [f'{name} by {text(found.coefficient)}' for name, found in known if found.follows]
    if not follow:
        return f'It does not follow {span}.'
    return f'It follows {span}: {listed(follow, _NAMED, "; ")}.'
