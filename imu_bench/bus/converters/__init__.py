# SPDX-License-Identifier: Apache-2.0
"""Analog-to-digital converters behind which a sensor with a voltage lives, one file each."""

from imu_bench.bus.converters.ads1115 import Ads1115, Ads1115Registers
from imu_bench.bus.converters.converter import Converter, Reading
from imu_bench.bus.converters.mcc172 import Mcc172
from imu_bench.bus.converters.mcp3208 import Mcp3208

__all__ = ['Ads1115', 'Ads1115Registers', 'Converter', 'Mcc172', 'Mcp3208', 'Reading']
