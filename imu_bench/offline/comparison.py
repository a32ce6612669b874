# SPDX-License-Identifier: Apache-2.0
"""Several sensors side by side, and each against its datasheet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
import math
from pathlib import PurePath
from typing import Any, Protocol

from imu_bench import drivers
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline import datasheets
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.results import RecordingResult
from imu_bench.registers import Typical
from imu_bench.samples import AXES, IMU_QUANTITIES, Quantity

_SAME = 1.2  # datasheet typicals are rounded, and parts scatter; closer is agreement


@dataclass(frozen=True)
class Standing:
    """
    One sensor among others in one quantity.

    Attributes
    ----------
    index : int
        Position of the recording in the analysis.
    label : str
        Short name of the sensor, unique in the analysis.
    noise_density : Estimate
        Root of the mean square over the axes: the density of the noise of the vector over √axes.
        Not observable where no axis shows white noise.
    ratio : Estimate
        Noise density over that of the reference sensor.
    """

    index: int
    label: str
    noise_density: Estimate
    ratio: Estimate


@dataclass(frozen=True)
class Verdict:
    """
    One measured number against the typical value of the datasheet.

    Attributes
    ----------
    label, axis : str
        Sensor and axis name.
    parameter : str
        'noise density', 'bias instability' or 'bias'.
    measured : Estimate
    typical : float
        In the unit of the estimate.
    source : str
        Document and table.
    verdict : str
        'better', 'as specified', 'worse' or 'not observable'.
    """

    label: str
    axis: str
    parameter: str
    measured: Estimate
    typical: float
    source: str
    verdict: str


@dataclass(frozen=True)
class Comparison:
    """
    The sensors of one analysis against each other and against their datasheets.

    Attributes
    ----------
    labels : tuple of str
        One per recording, unique.
    reference : str
        Label of the sensor that the ratios refer to; empty for the quietest of each quantity.
    standings : mapping of str to tuple of Standing
        By quantity name, the quietest first.
    verdicts : tuple of Verdict
        For sensors that have a driver with typical values.
    """

    labels: tuple[str, ...]
    reference: str
    standings: dict[str, tuple[Standing, ...]]
    verdicts: tuple[Verdict, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object."""
        return {
            'labels': list(self.labels),
            'reference': self.reference,
            'ranking': {
                name: [
                    {
                        'label': s.label,
                        'noise_density': s.noise_density.to_json(),
                        'ratio': s.ratio.to_json(),
                    }
                    for s in rows
                ]
                for name, rows in self.standings.items()
            },
            'datasheet': [
                {
                    'label': v.label,
                    'axis': v.axis,
                    'parameter': v.parameter,
                    'measured': v.measured.to_json(),
                    'typical': v.typical,
                    'source': v.source,
                    'verdict': v.verdict,
                }
                for v in self.verdicts
            ],
        }


def compare(
    recordings: Sequence[RecordingResult],
    reference: str = '',
    sheets: datasheets.Document | None = None,
) -> Comparison:
    """
    Return how the sensors stand against each other and against their datasheets.

    Parameters
    ----------
    recordings : sequence of RecordingResult
    reference : str
        Label of the sensor that ratios refer to; the quietest one if empty or unknown.
    sheets : mapping, optional
        Typical values by label, from `datasheets.read`; they go before those of a driver.
    """
    names = labels(recordings)
    standings = {
        quantity.name: rows
        for quantity in IMU_QUANTITIES
        if (rows := tuple(_rank(recordings, names, quantity, reference)))
    }
    verdicts = tuple(
        verdict
        for recording, label in zip(recordings, names, strict=True)
        for verdict in _verdicts(recording, label, sheets or {})
    )
    return Comparison(tuple(names), reference, standings, verdicts)


class Named(Protocol):
    """What a label is made of: a recording, or the result of one."""

    @property
    def source(self) -> str: ...
    @property
    def topic(self) -> str: ...


def labels(recordings: Sequence[Named]) -> list[str]:
    """Return a short unique name for each recording: the sensor, the topic or the file."""
    short = [_short(r) for r in recordings]
    used = Counter(short)
    longer = [
        f'{PurePath(r.source).stem} {name}' if used[name] > 1 and name != _stem(r) else name
        for r, name in zip(recordings, short, strict=True)
    ]
    again = Counter(longer)
    seen: Counter[str] = Counter()
    result = []
    for name in longer:
        seen[name] += 1
        result.append(f'{name} ({seen[name]})' if again[name] > 1 else name)
    return result


def _short(recording: Named) -> str:
    parts = [part for part in recording.topic.split('/') if part]
    if 'imu' in parts[1:]:
        return parts[parts.index('imu', 1) - 1]
    stem = _stem(recording)
    if not recording.topic.startswith('/') or not parts:
        # two files that are one sensor are named after both
        return recording.topic if ' + ' in recording.topic else stem
    return '/'.join(parts)


def _stem(recording: Named) -> str:
    return PurePath(recording.source).stem or recording.source


def _rank(
    recordings: Sequence[RecordingResult], names: Sequence[str], quantity: Quantity, wanted: str
) -> Iterator[Standing]:
    found = [
        (index, names[index], _overall(axes))
        for index, recording in enumerate(recordings)
        if (axes := recording.of(quantity.name))
    ]
    found.sort(key=lambda row: math.inf if row[2].value is None else row[2].value)
    if not found:
        return
    named = [density for _, label, density in found if label == wanted and density.value]
    yardstick = named[0] if named else found[0][2]
    for index, label, density in found:
        yield Standing(index, label, density, ratio(density, yardstick))


def _overall(axes: Sequence[AxisResult]) -> Estimate:
    seen = [axis.white_density for axis in axes if axis.white_density.value]
    if not seen:
        first = axes[0].noise_density
        return Estimate.not_observable(first.unit, 'no axis shows white noise')

    def mean(numbers: Iterable[float | None]) -> float | None:
        known = [n for n in numbers if n is not None]
        return math.sqrt(sum(n * n for n in known) / len(known)) if known else None

    return Estimate(
        mean(e.value for e in seen),
        mean(e.low for e in seen),
        mean(e.high for e in seen),
        seen[0].unit,
        seen[0].confidence,
        method='root of the mean square over the axes',
    )


def ratio(density: Estimate, yardstick: Estimate) -> Estimate:
    """Return the ratio of two independent estimates; relative half widths add as squares."""
    top, bottom = density.value, yardstick.value
    if not top or not bottom:
        reason = density.reason or yardstick.reason or 'one of the two is zero'
        return Estimate.not_observable('1', reason)
    if density is yardstick:
        return Estimate(1.0, 1.0, 1.0, '1', density.confidence)

    def side(up: float | None, down: float | None) -> float:
        return math.hypot((up or top) / top - 1.0, (down or bottom) / bottom - 1.0)

    low = top / bottom * max(0.0, 1.0 - side(density.low, yardstick.high))
    high = top / bottom * (1.0 + side(density.high, yardstick.low))
    return Estimate(top / bottom, low, high, '1', density.confidence)


def _verdicts(
    recording: RecordingResult, label: str, sheets: datasheets.Document
) -> Iterator[Verdict]:
    typical = typical_of(recording) | datasheets.typical(sheets, label)
    for quantity in IMU_QUANTITIES:
        sheet = typical.get(quantity.field)
        if sheet is None:
            continue
        for axis in recording.of(quantity.name):
            yield from _against(sheet, axis, AXES.index(axis.letter), label)


def _against(sheet: Typical, axis: AxisResult, position: int, label: str) -> Iterator[Verdict]:
    lines = [
        ('noise density', axis.white_density, sheet.noise_density),
        ('bias instability', axis.coefficient('B'), sheet.bias_instability),
    ]
    for parameter, measured, given in lines:
        value = given[position] if isinstance(given, tuple) else given
        if value is not None and value > 0.0:
            yield Verdict(
                label, axis.name, parameter, measured, value, sheet.source, _judge(measured, value)
            )


def _judge(measured: Estimate, typical: float) -> str:
    if measured.value is None:
        bound = measured.high
        return 'better' if bound is not None and bound < typical / _SAME else 'not observable'
    low = measured.value if measured.low is None else measured.low
    high = measured.value if measured.high is None else measured.high
    if high < typical / _SAME:
        return 'better'
    if low > typical * _SAME:
        return 'worse'
    return 'as specified'


def typical_of(recording: RecordingResult) -> dict[str, Typical]:
    """Return the typical values of the sensor whose driver topic or frame name, if any."""
    known = drivers.names()
    for part in (*recording.topic.split('/'), recording.frame_id.removesuffix('_link')):
        if part in known:
            return dict(drivers.load(part).typical)
    return {}
