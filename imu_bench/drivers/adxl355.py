# SPDX-License-Identifier: Apache-2.0
"""
Analog Devices ADXL355: accelerometer of low noise.

Document: ADXL354/ADXL355 data sheet rev. C (DS), which was not at hand.  Its facts were taken from
the maker's driver in C (no-OS, drivers/accel/adxl355) and compared one by one with the maker's in
Rust (R: analogdevicesinc/adi-adxl355-rs, its comments quote DS), Linux (L: adxl355_core.c) and
Zephyr (Z: drivers/sensor/adi/adxl355).  Those that have a fact have the same: addresses (R, L, Z),
identities, codes of FILTER with rates and high-pass, reset code (R, L, Z); low-pass of a quarter,
bits of STATUS and POWER_CTL, I²C addresses (R); fields of RANGE, read bit of SPI (Z); range codes,
tag of the x axis (R, Z); temperature (R, L); shadow registers after a reset (R, L; DS page 43 in
plasmapper/adxl355-arduino, issue 5); standby resets the pointers of the FIFO (R); entries arrive
one by one (no-OS, issue 2431).  The scale is 256000 LSB/g in Z, and 3.9 µg/LSB, rounded, 0.16 %
less, in R and L.  Noise and bandwidth are from a quotation of DS.

To be checked against DS: start-up times, entries behind the FIFO (R: 96 at most; 99 are let pass),
timing of the buses, offset and its drift, scale error, right-handed axes, and that reading STATUS
clears the overrun flag.  The ADXL357 has the same part number; its ranges are five times wider.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

from imu_bench.bus.interface import Clock
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, FifoDriver, Identity, Setting, Typical, Witness
from imu_bench.errors import BusError, FrameError, NoAnswer
from imu_bench.registers import (
    Codes,
    Field,
    Fifo,
    Frame,
    Register,
    Scalar,
    Until,
    Value,
    Vector,
    Wait,
    Write,
)
from imu_bench.samples import Samples
from imu_bench.units import STANDARD_GRAVITY
import numpy as np

_Answer = TypeVar('_Answer')
G = STANDARD_GRAVITY
BEHIND = 3
"""Entries that may wait behind the 96 of the FIFO (DS, STATUS register)."""

RESETS = 5
"""DS, software reset: a race may spoil it; repeat until the shadow registers are as before."""

ENTRY_BYTES = 3
TURN_ON_NS = 10_000_000
"""DS table 1, at the most."""

TAG, EMPTY = 0x01, 0x02
"""Lowest bits of an entry: x axis; nothing was there."""


class Adxl355(FifoDriver):
    """Analog Devices ADXL355, FIFO bursts of 20 bits, through I²C or SPI."""

    # --- document and identity -----------------------------------------------------------
    name = 'adxl355'
    title = 'Analog Devices ADXL355'
    document = 'ADXL354/ADXL355 rev. C'
    bus_kinds = ('i2c', 'spi')
    data_ready_pin = 'INT1'
    rises_at_watermark = True
    start_up_s = 0.01  # DS table 1: power-on to standby
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # DS, serial communications; the address stands above the read bit on SPI
        '': Wiring(i2c_addresses=(0x1D, 0x53), spi_max_hz=10_000_000, spi_read=0x01, spi_shift=1),
    }

    # --- register map (DS, register map) -------------------------------------------------
    DEVID_AD = Register(0x00, reset=0xAD, access='ro')
    DEVID_MST = Register(0x01, reset=0x1D, access='ro')
    PARTID = Register(0x02, reset=0xED, access='ro')
    REVID = Register(0x03, reset=0x01, access='ro')
    STATUS = Register(0x04, access='ro', clear_on_read=True)
    FIFO_ENTRIES = Register(0x05, access='ro')
    TEMP = Register(0x06, access='ro', size=2)
    DATA = Register(0x08, access='ro', size=9)
    FIFO_DATA = Register(0x11, access='ro')
    OFFSET_X = Register(0x1E, size=2)
    OFFSET_Y = Register(0x20, size=2)
    OFFSET_Z = Register(0x22, size=2)
    ACT_EN = Register(0x24)
    ACT_THRESH = Register(0x25, size=2)
    ACT_COUNT = Register(0x27, reset=0x01)
    FILTER = Register(0x28)
    FIFO_SAMPLES = Register(0x29, reset=0x60)
    INT_MAP = Register(0x2A)
    SYNC = Register(0x2B)
    RANGE = Register(0x2C, reset=0x81)
    POWER_CTL = Register(0x2D, reset=0x01)
    SELF_TEST = Register(0x2E)
    RESET = Register(0x2F, access='wo')
    SHADOW = Register(0x50, reset=None, access='ro', size=5)

    # --- fields and codes ----------------------------------------------------------------
    nvm_busy = Field(STATUS, 4)
    activity = Field(STATUS, 3)
    fifo_overrun = Field(STATUS, 2)
    fifo_full = Field(STATUS, 1)
    data_ready = Field(STATUS, 0)
    # fmt: off
    high_pass = Field(  # share of the rate
        FILTER, (6, 4), Codes({0.0: 0, 24.7e-4: 1, 6.2084e-4: 2, 1.5545e-4: 3, 0.3862e-4: 4,
                               0.0954e-4: 5, 0.0238e-4: 6}))
    sample_rate = Field(
        FILTER, (3, 0), Codes({4000.0: 0, 2000.0: 1, 1000.0: 2, 500.0: 3, 250.0: 4, 125.0: 5,
                               62.5: 6, 31.25: 7, 15.625: 8, 7.813: 9, 3.906: 10}), 'Hz')
    # fmt: on
    full_interrupt = Field(INT_MAP, 1)
    fast_i2c = Field(RANGE, 7)
    interrupt_polarity = Field(RANGE, 6)
    accelerometer_range = Field(RANGE, (1, 0), Codes({2.0: 1, 4.0: 2, 8.0: 3}), 'g')
    data_ready_off = Field(POWER_CTL, 2)
    temperature_off = Field(POWER_CTL, 1)
    mode = Field(POWER_CTL, 0, Codes({'measurement': 0, 'standby': 1}))
    soft_reset = Field(RESET, (7, 0), Codes({'reset': 0x52}), self_clearing=True)

    identities = (
        Identity(PARTID, {0xED: 'Analog Devices ADXL355'}, {0xE9: 'ADXL359'}),
        Identity(DEVID_AD, {0xAD: 'Analog Devices'}),
        Identity(DEVID_MST, {0x1D: 'MEMS'}),
    )

    # --- channels (DS table 1) -----------------------------------------------------------
    # fmt: off
    acceleration = Vector(
        first=DATA, quantity='acceleration', unit='m/s²', dtype='>i3', shift=4,
        scaled_by=accelerometer_range,
        si_per_lsb={2.0: G / 256000, 4.0: G / 128000, 8.0: G / 64000},
    )
    temperature = Scalar(
        first=TEMP, quantity='temperature', unit='°C', dtype='>u2', limits=(0, 4095),
        si_per_lsb=-1 / 9.05, offset=25.0 + 1885 / 9.05,
    )
    fifo = Fifo(
        port=FIFO_DATA, frame=Frame(acceleration), depth=32, count=FIFO_ENTRIES, units=3,
        pin=(full_interrupt, FIFO_SAMPLES, interrupt_polarity),
        overrun=fifo_overrun, rate=sample_rate, runs=(mode, 'measurement'), low_pass=0.25,
        marks=bytes([0, 0, TAG, 0, 0, 0, 0, 0, 0]), empty=bytes([0, 0, EMPTY]),
    )
    depth = fifo.depth

    # --- settings ------------------------------------------------------------------------
    settings = (
        Setting('rate_hz', 1000.0, 'Output data rate; the low-pass is a quarter of it.',
                sample_rate.allowed, unit='Hz'),
        choice('accelerometer_range', accelerometer_range, 2.0, 'Full scale.'),
    )
    # fmt: on
    counter_names = ('tag_errors', 'repeated_resets')

    # --- sequences -----------------------------------------------------------------------
    reset_steps = (
        Write({soft_reset: 'reset'}),
        Wait(0.005, 'no time given; as Linux'),
        Until(nvm_busy, 0, 1.0),
    )
    start_steps = stop_steps = (Write({mode: 'standby'}),)
    measure_steps = (Write({mode: 'measurement'}),)

    # --- typical values ------------------------------------------------------------------
    # fmt: off
    typical: ClassVar[Mapping[str, Typical]] = {
        'acceleration': Typical(
            'DS rev. C table 1, noise and scale; the others are assumed',
            noise_density=22.5e-6 * G, bandwidth=250.0, range=2.048 * G, resolution=G / 256000,
            bias=0.025 * G, bias_per_kelvin=0.02e-3 * G, scale_error=0.08,
            scale_per_kelvin=0.01e-2, nonlinearity=0.001, cross_axis=0.01),
        'temperature': Typical('DS rev. C table 1', resolution=1 / 9.05),
    }

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        Witness(acceleration, 'f91b5100fd90c32a20', (-1.081604, 0.155412, -9.545572),
                'read from a FIFO, Arduino Stack Exchange question 35627: '
                '-28235, 4057, -249182 of 256000 LSB/g', 2.0),
        Witness(acceleration, '0000001f4000000000', (0, 9.80665, 0), 'DS: 128000 LSB/g', 4.0),
        Witness(acceleration, '000000000000f06000', (0, 0, -9.80665), 'DS: 64000 LSB/g', 8.0),
        Witness(temperature, '075d', (25.0,), 'DS: 1885 LSB at 25 °C'),
        Witness(temperature, '06a8', (45.0,), 'DS: -9.05 LSB/K; 1885 - 181'),
    )
    # fmt: on

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        self._shadow: bytes | None = None
        self._heard_ns = self._valid_ns = 0

    def assignments(self) -> dict[Any, Value]:
        """Return the settings, without a high-pass."""
        wanted = {**super().assignments(), self.sample_rate: self.rate_hz, self.high_pass: 0.0}
        if self.edges is None:
            return wanted
        entries = self.fifo.units * self.watermark()
        line = {self.FIFO_SAMPLES: entries, self.full_interrupt: 1}
        return {**wanted, **line, self.interrupt_polarity: 1}

    def configure(self) -> None:
        """Reset until the shadow registers are as before, check the identity, configure."""
        if self._shadow is None:
            self.identify()
            self._shadow = self.registers.burst(self.SHADOW)
        for _ in range(RESETS):
            super().configure()
            if self.registers.burst(self.SHADOW) == self._shadow:
                return
            self.counters['repeated_resets'] += 1
        self.configured, self._shadow = False, None
        raise BusError(
            f'{self._wires[""].name}: {self.SHADOW} differs after {RESETS} resets; switch the '
            'chip off and on'
        )

    def start(self) -> None:
        """Empty the FIFO while nothing comes, then measure."""
        super().start()
        entries = min(self.registers.word(self.FIFO_ENTRIES), self.fifo.capacity + BEHIND)
        if entries:
            self.registers.burst(self.FIFO_DATA, entries * ENTRY_BYTES)
        self.registers.word(self.STATUS)
        self.registers.run(self.measure_steps)
        self._heard_ns = self.clock.now_ns()
        self._valid_ns = self._heard_ns + TURN_ON_NS

    def read(self) -> list[Samples]:
        """Return everything new; nothing that was in the FIFO when it ran over."""
        if self.torn or not self.configured:
            self.restart()
        head, latched = _twice(self.latch, self.STATUS, 4)
        status, entries = head[0], head[1]
        self.check_level(self.FIFO_ENTRIES, entries, self.fifo.capacity + BEHIND)
        if status & self.fifo_overrun.mask:
            return self._overflow()
        # entries are stored one by one: the last sample may not be whole yet
        n = entries // self.fifo.units
        if not n:
            return self._silence()
        self.torn = True  # until the burst has been taken out whole
        words = self._burst(n)
        # far behind: it may have run over before the burst began
        if n > self.fifo.depth // 2 and self.registers.word(self.STATUS) & self.fifo_overrun.mask:
            return self._overflow()
        self.torn = False
        self._heard_ns = latched
        return self._samples(words, int.from_bytes(head[2:], 'big') & 0xFFF, latched)

    def _overflow(self) -> list[Samples]:
        """Empty the FIFO and begin anew."""
        self.counters['fifo_overflows'] += 1
        self.start()
        return []

    def _silence(self) -> list[Samples]:
        """Find out why nothing comes: after a dip the chip is in standby, at its reset values."""
        quiet_ns = self.clock.now_ns() - self._heard_ns
        if quiet_ns > 4e9 / self.rate_hz + 2e9 * self.poll_period_s:
            self.restart()
        return []

    def _burst(self, n: int) -> np.ndarray:
        data = _twice(self.registers.burst, self.FIFO_DATA, n * self.fifo.frame.size)
        tags = np.frombuffer(data, np.uint8).reshape(-1, 3, 3)[:, :, 2] & (TAG | EMPTY)
        if (tags != (TAG, 0, 0)).any():
            self.counters['tag_errors'] += 1
            raise FrameError(
                f'{self._wires[""].name}: FIFO entries without the tag of their axis; the FIFO '
                'will be emptied'
            )
        return self.fifo.frame.unpack(data)

    def _samples(self, words: np.ndarray, temperature: int, latched: int) -> list[Samples]:
        """Return what was measured after the sensor had turned on."""
        stamps = self.stamps(latched, len(words))
        if len(stamps) and stamps[0] < self._valid_ns:
            words, stamps = words[stamps >= self._valid_ns], stamps[stamps >= self._valid_ns]
        if not len(stamps):
            return []
        celsius = self.temperature.decode(np.full(len(stamps), temperature))
        return [Samples(stamps, **self.decode(words, self.acceleration), temperature=celsius)]


def _twice(ask: Callable[..., _Answer], *what: Any) -> _Answer:
    """Ask once more for what was not acknowledged."""
    # In a read the chip acknowledges its address alone (NXP UM10204, section 3.1.6): where it does
    # not, nothing was taken out of the FIFO.
    try:
        return ask(*what)
    except NoAnswer:
        return ask(*what)
