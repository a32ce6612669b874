# SPDX-License-Identifier: Apache-2.0
"""An MTN/1100 behind each of the converters its driver knows."""

from __future__ import annotations

from typing import Any

from imu_bench.drivers.mtn1100 import Mtn1100
from imu_bench.emulators.ads1115 import Ads1115Chip
from imu_bench.emulators.frames import EmulatedFrameBus
from imu_bench.emulators.mcc172 import EmulatedMcc172
from imu_bench.emulators.mcp3208 import Mcp3208Chip
from imu_bench.emulators.socket import Socket


def create(at: Socket, **options: float) -> dict[str, Any]:
    """Return the board, the bus of an ADS1115, or that of an MCP3208."""
    if at.kind == 'daqhat':
        channel = Mtn1100.acceleration_mcc172
        return {'': EmulatedMcc172(at.name, channel, at.source, at.clock, **options)}
    start_ns = at.clock.now_ns()
    if at.kind == 'i2c':
        return {
            '': at.bus(Ads1115Chip(Mtn1100.acceleration_ads1115, at.source, start_ns, **options))
        }
    converter = Mcp3208Chip(Mtn1100.acceleration_mcp3208, at.source, start_ns)
    return {'': EmulatedFrameBus(at.name, at.line, converter)}
