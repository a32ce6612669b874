# SPDX-License-Identifier: Apache-2.0
"""What a sensor's file may say about its calibration: true = matrix (raw - bias)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from imu_bench.config.schema import Setting
from msg_conversions.quantities import AXES, IMU_QUANTITIES, MAGNETIC_FIELD

CALIBRATED = {q.field: q.unit for q in (*IMU_QUANTITIES, MAGNETIC_FIELD)}
"""Quantities that can be corrected, with the unit of their bias."""

_LARGEST = 0.5
"""A matrix farther from that of no correction is a mistake, such as one of a raw count."""


@dataclass(frozen=True)
class Affine:
    """The correction of one quantity."""

    bias: tuple[float, ...]  # per axis, SI
    matrix: tuple[tuple[float, ...], ...]  # rows x, y, z


def _settings() -> Iterator[Setting]:
    for name, unit in CALIBRATED.items():
        prefix = f'calibration.{name}'
        text = 'Taken off before the matrix; one value or one per axis.'
        yield Setting(f'{prefix}.bias', None, text, unit=unit, kind='quantity')
        for row in AXES:
            yield Setting(
                f'{prefix}.matrix.{row}', None,
                f'Share of x, y, z less their bias in corrected {row}.', unit='1', kind='quantity',
            )  # fmt: skip


CALIBRATION_SETTINGS = tuple(_settings())
"""Correction of what a sensor measures before it is published; none by default."""


def corrections(values: Mapping[str, Any], source: str, problems: list[str]) -> dict[str, Affine]:
    """Return the correction of every quantity that has one."""
    found = {}
    for name in CALIBRATED:
        prefix = f'calibration.{name}'
        bias = values.get(f'{prefix}.bias')
        rows = [values.get(f'{prefix}.matrix.{row}') for row in AXES]
        if bias is None and all(row is None for row in rows):
            continue
        unity = [tuple(float(a == b) for b in range(3)) for a in range(3)]
        matrix = [own if row is None else row for row, own in zip(rows, unity, strict=True)]
        for row, given, own in zip(AXES, matrix, unity, strict=True):
            if len(given) != len(AXES):
                problems.append(
                    f'{source}.{prefix}.matrix.{row}: one value is no row; give three, for x, y, z'
                )
            elif max(abs(a - b) for a, b in zip(given, own, strict=True)) > _LARGEST:
                problems.append(
                    f'{source}.{prefix}.matrix.{row}: {", ".join(f"{v:g}" for v in given)} is no '
                    f'correction: every value must be within {_LARGEST:g} of '
                    f'{", ".join(f"{v:g}" for v in own)}'
                )
        bias = (0.0,) if bias is None else bias
        found[name] = Affine(bias if len(bias) == len(AXES) else bias * len(AXES), tuple(matrix))
    return found
