# SPDX-License-Identifier: Apache-2.0
"""Where an emulated chip is put: its driver, its kind of bus, what it senses, its wire."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from imu_bench.bus.interface import Clock
from imu_bench.drivers.driver import Driver
from imu_bench.emulators.ahead import Source
from imu_bench.emulators.line import Line
from imu_bench.emulators.register_map import EmulatedBus, EmulatedChip


@dataclass(frozen=True)
class Socket:
    """Where an emulated chip is put."""

    driver: type[Driver]
    kind: str  # one of the driver's `bus_kinds`
    name: str  # for error texts and diagnostics; says that it is emulated
    source: Source  # what the chip samples
    clock: Clock
    line: Line
    addresses: Mapping[str, int] = field(default_factory=dict)  # of its dies, where they matter

    def bus(self, chip: EmulatedChip, part: str = '') -> EmulatedBus:
        """Return the bus of a die on I²C or SPI, with the burst bit that its wiring has."""
        on_i2c, wiring = self.kind == 'i2c', self.driver.wiring[part]
        increment = wiring.i2c_increment if on_i2c else wiring.spi_increment
        name = f'{self.name} {part}'.rstrip()
        stretch_s = wiring.i2c_stretch_s if on_i2c else 0.0
        return EmulatedBus(
            name, self.line, chip, increment, acknowledges=on_i2c, stretch_s=stretch_s,
            address=self.addresses.get(part),
        )  # fmt: skip
