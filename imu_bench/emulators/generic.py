# SPDX-License-Identifier: Apache-2.0
"""Any sensor whose document is declared whole, registers and at most a FIFO, run backwards."""

from __future__ import annotations

from collections.abc import Iterable

from imu_bench.drivers.driver import Driver
from imu_bench.emulators.ahead import rows_of, Source, Stateful
from imu_bench.emulators.fifo_chip import FifoChip, SlotFifo
from imu_bench.emulators.low_pass import LowPass
from imu_bench.emulators.register_map import EmulatedBus, EmulatedChip
from imu_bench.emulators.socket import Socket
from imu_bench.errors import ConfigError
from imu_bench.registers import Field, Fifo, Frame, Register, Write
from imu_bench.samples import Samples
import numpy as np


def reset_registers(driver: type[Driver]) -> frozenset[Register]:
    """
    Return the registers whose writing resets the chip.

    They are those that the driver's reset sequence writes a self-clearing field of.
    """
    return frozenset(
        target.register
        for step in driver.reset_steps
        if isinstance(step, Write)
        for target in step.values
        if isinstance(target, Field) and target.self_clearing
    )


class GenericFifoChip(FifoChip):
    """Registers, and a FIFO behind one of them."""

    slot_numbers = ()

    def __init__(self, driver: type[Driver], source: Source, start_ns: int) -> None:
        (sheet,) = driver.declared(Fifo).values()
        super().__init__(driver.declared(Register).values(), source, SlotFifo(sheet.depth))
        self._sheet = sheet
        self._channels = tuple(driver.channels().values())
        self._resets = reset_registers(driver)
        self.start_up_ns = round(driver.start_up_s * 1e9)
        self.ports = self.quiet = frozenset({sheet.port.number})
        self.made = frozenset({sheet.count.number})
        self._torn = b''
        self.power_up(start_ns)

    def reset(self, at_ns: int) -> None:
        """Return to the reset values."""
        self._torn = b''
        super().reset(at_ns)

    def rate_hz(self) -> float:
        """Return the rate its registers ask for, 0 for none."""
        field, value = self._sheet.runs
        if self.memory.value(field) != value:
            return 0.0
        return float(self.memory.value(self._sheet.rate))

    def risen_at(self) -> int:
        """Return the watermark, if it is on the pin and the pin rises."""
        if self._sheet.pin is None:
            return 0
        on_pin, watermark, rises = self._sheet.pin
        if not (self.memory.code(on_pin) and self.memory.code(rises)):
            return 0
        return -(-self.memory.word(watermark) // self._sheet.units)

    def fifo_mode(self) -> str:
        """Return that a full FIFO gives up its oldest sample."""
        return 'overwrites'

    def settle(self, rate_hz: float) -> None:
        """Set up filters for a rate."""
        corner = self._sheet.low_pass * rate_hz
        self._filters = {channel: LowPass(corner, rate_hz) for channel in self._channels}

    def filters(self) -> Iterable[Stateful]:
        """Return the filters."""
        return self._filters.values()

    def converted(self, samples: Samples) -> tuple[list[bytes], list[bytes]]:
        """Return frames, and what the data registers show, one after the other."""
        if not self.rate_hz():
            return [], []
        words = self._words(samples)
        shown = [Frame(c).pack(words, len(samples)) for c in self._channels if c.quantity in words]
        registers = [np.frombuffer(data, np.uint8).reshape(len(samples), -1) for data in shown]
        self._shown = [c.first for c in self._channels if c.quantity in words]
        return rows_of(self._frames(words, len(samples))), rows_of(np.hstack(registers))

    def slots(self, samples: Samples) -> np.ndarray:
        """Return a frame of each sample."""
        return self._frames(self._words(samples), len(samples))

    def _words(self, samples: Samples) -> dict[str, np.ndarray]:
        words = {}
        for channel in self._channels:
            si = getattr(samples, channel.quantity)
            if si is not None:
                filtered = self._filters[channel].filter(si) if si.ndim > 1 else si
                words[channel.quantity] = self.memory.quantise(channel, filtered)
        return words

    def _frames(self, words: dict[str, np.ndarray], n: int) -> np.ndarray:
        frame = self._sheet.frame
        inside = {name: words[name] for name in frame.dtype.names or () if name in words}
        rows = np.frombuffer(frame.pack(inside, n), np.uint8).reshape(n, -1)
        return rows | np.frombuffer(self._sheet.marks or bytes(frame.size), np.uint8)

    def show(self, newest: bytes) -> None:
        """Put the newest words into the data registers."""
        start = 0
        for register in self._shown:
            self.memory.fill(register, newest[start : start + register.size])
            start += register.size

    def advance(self, to_ns: int) -> None:
        """Take every sample that is due; that one was lost is told until it was read."""
        super().advance(to_ns)
        if self.fifo.overrun:
            self.fifo.overrun = False
            self.memory.put(self._sheet.overrun, 1)

    # --- the wire ------------------------------------------------------------------------
    def reading(self, number: int, at_ns: int) -> None:
        """Latch the count, of what was begun its whole units."""
        sheet = self._sheet
        if number == sheet.count.number:
            begun = len(self._torn) * sheet.units // sheet.frame.size
            self.memory.set(sheet.count, len(self.fifo) * sheet.units + begun)

    def read_port(self, number: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Empty the FIFO; samples go on coming meanwhile."""
        out = bytearray(self._torn)
        while len(out) < length:
            self.advance(at_ns + round(len(out) * byte_ns))
            out += self.fifo.take(1) if len(self.fifo) else self._sheet.empty
        self._torn = bytes(out[length:])
        return bytes(out[:length])

    def written(self, register: Register, at_ns: int) -> None:
        """Reset, or sample at another rate."""
        if register in self._resets:
            self.reset(at_ns)
        elif register in (self._sheet.rate.register, self._sheet.runs[0].register):
            self.change_rate(at_ns)


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
