# SPDX-License-Identifier: Apache-2.0
"""An MTN/1100 behind each of the converters its driver knows."""

from __future__ import annotations

from typing import Any

from imu_bench.bus.interface import Clock
from imu_bench.drivers.driver import Driver
from imu_bench.drivers.mtn1100 import Mtn1100
from imu_bench.emulators.ads1115 import Ads1115Chip
from imu_bench.emulators.frames import EmulatedFrameBus
from imu_bench.emulators.line import Line
from imu_bench.emulators.mcc172 import EmulatedMcc172
from imu_bench.emulators.mcp3208 import Mcp3208Chip
from imu_bench.emulators.register_map import EmulatedBus, Source


def create(
    driver: type[Driver],
    kind: str,
    name: str,
    source: Source,
    clock: Clock,
    line: Line,
    **options: float,
) -> dict[str, Any]:
    """Return the board, the bus of an ADS1115, or that of an MCP3208."""
    if kind == 'daqhat':
        board = EmulatedMcc172(name, Mtn1100.acceleration_mcc172, source, clock, **options)
        return {'': board}
    if kind == 'i2c':
        chip = Ads1115Chip(Mtn1100.acceleration_ads1115, source, clock.now_ns(), **options)
        return {'': EmulatedBus(name, line, chip)}
    converter = Mcp3208Chip(Mtn1100.acceleration_mcp3208, source, clock.now_ns())
    return {'': EmulatedFrameBus(name, line, converter)}
