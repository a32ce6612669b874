# SPDX-License-Identifier: Apache-2.0
"""
Typical values of sensors that have no driver here, from a YAML file.

    imu_7:                                   # as the analysis names the sensor
      source: XY-100 data sheet, revision 3, table 2
      linear_acceleration:
        noise_density: 120 µg/√Hz            # one value, or three for x, y and z
        bias_instability: 40 µg
      angular_velocity:
        noise_density: 0.007 °/s/√Hz
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from imu_bench.config.files import read_yaml
from imu_bench.config.schema import check_all, Setting
from imu_bench.errors import ConfigError
from imu_bench.registers import Typical
from imu_bench.samples import IMU_QUANTITIES, Quantity

Document = Mapping[str, Mapping[str, Any]]
"""By sensor: its source, and by quantity its numbers in SI; as it stands in a JSON document."""

_SOURCE = 'source'
_EXAMPLE = "an entry is like 'my_imu: {linear_acceleration: {noise_density: 120 µg/√Hz}}'"
_TOLD = 3
"""Problems spelled out in an error text."""


def read(path: Path) -> Document:
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
    >>> read(path)['a']['angular_velocity']
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
        more = f' (and {len(problems) - _TOLD} more)' if len(problems) > _TOLD else ''
        raise ConfigError(f'{"; ".join(problems[:_TOLD])}{more}; {_EXAMPLE}')
    return found


def typical(document: Document, sensor: str) -> dict[str, Typical]:
    """Return the typical values of a sensor by the fields of `Samples`; empty if not listed."""
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
    )  # fmt: skip


def _one_or_three(value: list[float]) -> Any:
    return value[0] if len(value) == 1 else tuple(value)
