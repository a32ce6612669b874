# SPDX-License-Identifier: Apache-2.0
"""Any sensor whose document is declared whole, registers and at most a FIFO, run backwards."""

from __future__ import annotations

from imu_bench.drivers.driver import Driver
from imu_bench.emulators.ahead import Source
from imu_bench.emulators.generic_fifo import GenericFifoChip
from imu_bench.emulators.register_map import EmulatedBus, EmulatedChip
from imu_bench.emulators.socket import Socket
from imu_bench.errors import ConfigError
from imu_bench.registers import Fifo, Frame, Register
from imu_bench.samples import Samples


class _Newest:
    """The newest sample of a source that several dies share."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._sample: Samples | None = None

    def at(self, t_ns: int) -> Samples | None:
        """Return the newest sample at a time, None before the first one."""
        samples = self._source.samples_until(t_ns)
        if len(samples):
            self._sample = samples[-1:]
        return self._sample


class GenericChip(EmulatedChip):
    """One die whose data registers hold the newest sample, at the range they are set to."""

    def __init__(self, driver: type[Driver], part: str, newest: _Newest) -> None:
        super().__init__(r for r in driver.declared(Register).values() if r.part == part)
        channels = driver.channels().values()
        self._channels = [c for c in channels if c.first.part == part]
        wiring = driver.wiring[part]
        self._burst_bits = wiring.i2c_increment | wiring.spi_increment
        self._newest = newest

    def decode_address(self, first: int) -> tuple[int, bool]:
        """Return the register; without its burst bit a chip that has one does not increment."""
        if not self._burst_bits:
            return first, True
        return first & ~self._burst_bits, bool(first & self._burst_bits)

    def advance(self, to_ns: int) -> None:
        """Put the newest sample into the data registers."""
        sample = self._newest.at(to_ns)
        for channel in self._channels if sample is not None else ():
            si = getattr(sample, channel.quantity)
            if si is not None:
                words = {channel.quantity: self.memory.quantise(channel, si)}
                self.memory.fill(channel.first, Frame(channel).pack(words, 1))


def create(at: Socket) -> dict[str, EmulatedBus]:
    """Return one bus for each die."""
    driver = at.driver
    fifos = driver.declared(Fifo)
    if fifos and (len(fifos) > 1 or len(driver.wiring) > 1):
        raise ConfigError(
            f'{driver.name}: a FIFO beside other dies needs imu_bench/emulators/{driver.name}.py'
        )
    if fifos:
        return {'': at.bus(GenericFifoChip(driver, at.source, at.clock.now_ns()))}
    newest = _Newest(at.source)
    return {part: at.bus(GenericChip(driver, part, newest), part) for part in driver.wiring}
