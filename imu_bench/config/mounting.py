# SPDX-License-Identifier: Apache-2.0
"""What a sensor's file or its bench may say about where the sensor is mounted."""

from __future__ import annotations

from collections.abc import Mapping
import re
from typing import Any

from imu_bench.config.schema import Setting
from msg_conversions.quantities import AXES
from msg_conversions.transforms import Mounting

MOUNTING_SETTINGS = (
    Setting('mounting.parent', 'base_link', 'Frame in which the sensor has its place (REP-105).'),
    Setting(
        'mounting.xyz', None, 'Its place: three lengths; published on /tf_static.',
        unit='m', kind='quantity',
    ),
    Setting(
        'mounting.rpy', None, 'Roll, pitch, yaw about the fixed axes x, y, z (REP-103).',
        unit='rad', kind='quantity',
    ),
)  # fmt: skip

_FRAME = re.compile(r'[A-Za-z0-9_][\w./-]*')
"""tf2, BufferCore: no slash at the beginning, and not empty."""


def mounting(values: Mapping[str, Any], source: str, problems: list[str]) -> Mounting | None:
    """Return where a sensor is mounted, None if nobody says."""
    both = {name: values.get(f'mounting.{name}') for name in ('xyz', 'rpy')}
    given: dict[str, tuple[float, ...]] = {k: v for k, v in both.items() if v is not None}
    if not given:
        return None
    parent = values.get('mounting.parent', '')
    if not _FRAME.fullmatch(parent):
        problems.append(f'{source}.mounting.parent: {parent!r} is no frame; give base_link')
    for name, value in given.items():
        if len(value) != len(AXES):
            problems.append(f'{source}.mounting.{name}: one value; give three')
    return Mounting(parent, **given)
