# SPDX-License-Identifier: Apache-2.0
"""
Several sensors side by side, and each against its datasheet.

Typical values of sensors that have no driver here come from a YAML file:

    imu_7:                                   # as the analysis names the sensor
      source: XY-100 data sheet, revision 3, table 2
      linear_acceleration:
        noise_density: 120 µg/√Hz            # one value, or three for x, y and z
        bias_instability: 40 µg
        bias_per_kelvin: 0.1 mg/K            # its size: documents give ±
      angular_velocity:
        noise_density: 0.007 °/s/√Hz
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path, PurePath
from typing import Any, Protocol, TYPE_CHECKING

from imu_bench import drivers
from imu_bench.config.files import read_yaml
from imu_bench.config.schema import check_all, Setting
from imu_bench.errors import ConfigError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.results import RecordingResult, without_foreign
from imu_bench.offline.analysis.typed import fields_of, plain
from msg_conversions.quantities import AXES, IMU_QUANTITIES, Quantity

if TYPE_CHECKING:
    from imu_bench.drivers.driver import Driver
    from imu_bench.registers import Typical

Datasheets = Mapping[str, Mapping[str, Any]]
"""By sensor: its source, and by quantity its numbers in SI; as it stands in a JSON document."""

_SOURCE = 'source'
_EXAMPLE = "an entry is like 'my_imu: {linear_acceleration: {noise_density: 120 µg/√Hz}}'"
_MOST = 3
"""Problems spelled out in an error text."""


def read_datasheets(path: Path) -> Datasheets:
    """
    Return the typical values in a file, in SI.

    Raises
    ------
    ConfigError
        If the file cannot be read, or names something unknown or without a usable unit; the
        first three problems are told.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> path = Path(mkdtemp()) / 'sheets.yaml'
    >>> _ = path.write_text('a: {angular_velocity: {bias_instability: 1 °/s}}')
    >>> read_datasheets(path)['a']['angular_velocity']
    {'bias_instability': [0.017453292519943295]}
    """
    document = read_yaml(path)
    problems: list[str] = []
    known = {quantity.name: quantity for quantity in IMU_QUANTITIES}
    found: dict[str, dict[str, Any]] = {}
    for sensor, entries in document.items():
        where = f'{path}: {sensor}'
        sheet: dict[str, Any] = {_SOURCE: path.name}
        found[str(sensor)] = sheet
        if not isinstance(entries, dict):
            problems.append(f'{where}: must hold {", ".join(known)}')
            continue
        for name, entry in entries.items():
            if name == _SOURCE:
                sheet[_SOURCE] = str(entry)
            elif name in known and isinstance(entry, dict):
                given = check_all(entry, _settings(known[name]), f'{where}.{name}', problems)
                sheet[name] = {key: list(value) for key, value in given.items() if value}
            else:
                problems.append(f'{where}.{name}: not one of {", ".join((_SOURCE, *known))}')
    if problems:
        more = f' (and {len(problems) - _MOST} more)' if len(problems) > _MOST else ''
        raise ConfigError(f'{"; ".join(problems[:_MOST])}{more}; {_EXAMPLE}')
    return found


def _typical(document: Datasheets, sensor: str) -> dict[str, Typical]:
    """Return the typical values of a sensor by the fields of `Samples`; empty if not listed."""
    from imu_bench.registers import Typical

    sheet = document.get(sensor, {})
    return {
        quantity.field: Typical(
            source=str(sheet[_SOURCE]),
            **{name: _one_or_three(value) for name, value in sheet[quantity.name].items()},
        )
        for quantity in IMU_QUANTITIES
        if quantity.name in sheet
    }


def _settings(quantity: Quantity) -> tuple[Setting, ...]:
    return (
        Setting(
            'noise_density', None, 'White noise, one-sided.', unit=f'{quantity.unit}/√Hz',
            kind='quantity',
        ),
        Setting(
            'bias_instability', None, 'Coefficient B.', unit=quantity.unit, kind='quantity'
        ),
        Setting(
            'bias_per_kelvin', None, 'Change of the bias with the temperature, its size.',
            unit=f'{quantity.unit}/K', kind='quantity',
        ),
    )  # fmt: skip


def _one_or_three(value: list[float]) -> Any:
    return value[0] if len(value) == 1 else tuple(value)


_SAME = 1.2  # datasheet typicals are rounded, and parts scatter; closer is agreement


@dataclass(frozen=True)
class Standing:
    """One sensor among others in one quantity."""

    index: int  # position of the recording in the analysis
    label: str  # short name of the sensor, unique in the analysis
    # root of the mean square over the axes: the density of the noise of the vector over √axes. Not
    # observable where no axis shows white noise
    noise_density: Estimate
    ratio: Estimate  # noise density over that of the reference sensor


@dataclass(frozen=True)
class Verdict:
    """One measured number against the typical value of the datasheet."""

    # label, axis: sensor and axis name
    label: str
    axis: str
    parameter: str  # 'noise density', 'bias instability' or 'temperature coefficient'
    measured: Estimate
    typical: float  # in the unit of the estimate
    source: str  # datasheets and table
    verdict: str  # 'better', 'as specified', 'worse' or 'not observable'


@dataclass(frozen=True)
class Comparison:
    """The sensors of one analysis against each other and against their datasheets."""

    labels: tuple[str, ...]  # one per recording, unique
    # label of the sensor that the ratios refer to; empty for the quietest of each quantity
    reference: str
    standings: dict[str, tuple[Standing, ...]]  # by quantity name, the quietest first
    verdicts: tuple[Verdict, ...]  # for sensors that have a driver with typical values

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object."""
        return {
            'labels': list(self.labels),
            'reference': self.reference,
            'ranking': {
                name: [fields_of(row, but=('index',)) for row in rows]
                for name, rows in self.standings.items()
            },
            'datasheet': plain(self.verdicts),
        }


def compare(
    recordings: Sequence[RecordingResult],
    reference: str = '',
    sheets: Datasheets | None = None,
) -> Comparison:
    """
    Return how the sensors stand against each other and against their datasheets.

    Parameters
    ----------
    reference : str
        Label of the sensor that ratios refer to; the quietest one if empty or unknown.
    sheets : mapping, optional
        Typical values by label, from `read_datasheets`; they go before those of a driver.
    """
    names = labels(recordings)
    standings = {
        quantity.name: rows
        for quantity in IMU_QUANTITIES
        if (rows := tuple(_rank(recordings, names, quantity, reference)))
    }
    asked = without_foreign(recordings)
    verdicts = tuple(
        verdict
        for recording, label in zip(recordings, names, strict=True)
        if recording in asked
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
        # files that are one sensor are named after what they have in common
        several = ' + ' in recording.topic or bool(getattr(recording, 'runs', None))
        return recording.topic if several else stem
    return '/'.join(parts)


def _stem(recording: Named) -> str:
    return PurePath(recording.source).stem or recording.source


def _rank(
    recordings: Sequence[RecordingResult], names: Sequence[str], quantity: Quantity, wanted: str
) -> Iterator[Standing]:
    asked = without_foreign(recordings)
    found = [
        (index, names[index], _overall(axes))
        for index, recording in enumerate(recordings)
        if recording in asked and (axes := recording.of(quantity.name))
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


def _verdicts(recording: RecordingResult, label: str, sheets: Datasheets) -> Iterator[Verdict]:
    typical = typical_of(recording) | _typical(sheets, label)
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
    if (slope := axis.per_kelvin) is not None:
        lines.append(('temperature coefficient', _size(slope), sheet.bias_per_kelvin))
    for parameter, measured, given in lines:
        value = given[position] if isinstance(given, tuple) else given
        if value is not None and value > 0.0:
            yield Verdict(
                label, axis.name, parameter, measured, value, sheet.source, _judge(measured, value)
            )


def _size(signed: Estimate) -> Estimate:
    """Return the size of a number that may be of either sign; a bound where that is not known."""
    value, low, high = signed.value, signed.low, signed.high
    if value is None or low is None or high is None:
        return signed
    if low <= 0.0 <= high:
        return Estimate.not_observable(
            signed.unit, 'the interval holds zero', high=max(-low, high),
            confidence=signed.confidence,
        )  # fmt: skip
    near, far = sorted((abs(low), abs(high)))
    return replace(signed, value=abs(value), low=near, high=far)


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


def driver_of(recording: RecordingResult) -> type[Driver] | None:
    """Return the driver of the sensor whose driver topic or frame name, if any."""
    known = drivers.names()
    for part in (*recording.topic.split('/'), recording.frame_id.removesuffix('_link')):
        if part in known:
            return drivers.load(part)
    return None


def typical_of(recording: RecordingResult) -> dict[str, Typical]:
    """Return the typical values of the sensor that topic or frame name, if any."""
    driver = driver_of(recording)
    return {} if driver is None else dict(driver.typical)


def stated_rate(driver: type[Driver] | None, measured_hz: float | None) -> float | None:
    """
    Return the data rate of a document that is nearest to a measured one, in Hz, by their ratio.

    None without a driver, or if any rate can be set.
    """
    if driver is None or not measured_hz:
        return None
    rates = [s.allowed for s in driver.settings if s.name == 'rate_hz' and s.allowed]
    offered = [float(rate) for rate in rates[0] if rate] if rates else []
    return min(offered, key=lambda rate: abs(math.log(rate / measured_hz)), default=None)
