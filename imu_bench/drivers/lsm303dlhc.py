# SPDX-License-Identifier: Apache-2.0
"""
ST LSM303DLHC: accelerometer on one die, magnetometer and thermometer on another.

Document: Doc ID 018771 rev. 1 (DS).  It leaves some things open; what is assumed about them
is said where it is used: depth of the FIFO, zero of the thermometer, time for a reboot, and
whether reading the field clears its ready flag.  Its low-power mode (1620 and 5376 Hz, with a
resolution the document does not give) is not offered.  The thermometer's 8 LSB/K are those of DS;
a driver that others wrote (vznncv) has 16.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, ClassVar

from imu_bench.bus.interface import Clock
from imu_bench.bus.polled_quantity import PolledQuantity
from imu_bench.bus.slots import SlotFifo
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, Identity, Setting, SlotDriver, Typical, Witness
from imu_bench.errors import BusError
from imu_bench.registers import (
    Codes,
    Field,
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
from imu_bench.units import GAUSS, STANDARD_GRAVITY
import numpy as np

G = STANDARD_GRAVITY
MAG = 'magnetometer'
SLOTS = 32  # not in DS; as in the relative LIS3DH, DocID17530 rev. 2 section 5.1
TURN_ON = 7  # samples to throw away: DS gives 7/ODR of turn-on time
TEMPERATURE_ZERO = 20.0  # °C; DS gives no zero: so users found, and it can be set
OVERFLOW = -4096  # an axis out of range, as in the relative HMC5883L; DS does not say


def _field_lsb(gain_xy: float, gain_z: float) -> tuple[float, float, float]:
    """Return T per LSB in the order of the registers, x, z, y, from LSB per gauss."""
    return GAUSS / gain_xy, GAUSS / gain_z, GAUSS / gain_xy


class Lsm303dlhc(SlotDriver):
    """ST LSM303DLHC, FIFO bursts, through I²C."""

    # --- document and identity -----------------------------------------------------------
    name = 'lsm303dlhc'
    title = 'ST LSM303DLHC'
    document = 'Doc ID 018771 rev. 1'
    bus_kinds = ('i2c',)
    data_ready_pin = 'INT1'
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # DS sections 5.1.2, 5.1.3: bit 7 lets the accelerometer increment, the other does so
        '': Wiring(i2c_addresses=(0x19,), i2c_increment=0x80),
        MAG: Wiring(i2c_addresses=(0x1E,)),
    }

    # --- register map --------------------------------------------------------------------
    CTRL_REG1_A = Register(0x20, reset=0x07)
    CTRL_REG2_A = Register(0x21)
    CTRL_REG3_A = Register(0x22)
    CTRL_REG4_A = Register(0x23)
    CTRL_REG5_A = Register(0x24)
    CTRL_REG6_A = Register(0x25)
    REFERENCE_A = Register(0x26)
    STATUS_REG_A = Register(0x27, access='ro')
    OUT_A = Register(0x28, access='ro', size=6, reset=None, order='little')
    FIFO_CTRL_REG_A = Register(0x2E)
    FIFO_SRC_REG_A = Register(0x2F, access='ro', reset=None)
    INT1_CFG_A = Register(0x30)
    INT1_SRC_A = Register(0x31, access='ro')
    INT1_THS_A = Register(0x32)
    INT1_DURATION_A = Register(0x33)
    INT2_CFG_A = Register(0x34)
    INT2_SRC_A = Register(0x35, access='ro')
    INT2_THS_A = Register(0x36)
    INT2_DURATION_A = Register(0x37)
    CLICK_CFG_A = Register(0x38)
    CLICK_SRC_A = Register(0x39, access='ro')
    CLICK_THS_A = Register(0x3A)
    TIME_LIMIT_A = Register(0x3B)
    TIME_LATENCY_A = Register(0x3C)
    TIME_WINDOW_A = Register(0x3D)

    CRA_REG_M = Register(0x00, reset=0x10, part=MAG)
    CRB_REG_M = Register(0x01, reset=0x20, part=MAG)
    MR_REG_M = Register(0x02, reset=0x03, part=MAG)
    OUT_M = Register(0x03, access='ro', size=6, reset=None, part=MAG)
    SR_REG_M = Register(0x09, access='ro', part=MAG)
    IR_REG_M = Register(0x0A, access='ro', size=3, reset=0x483433, part=MAG)
    TEMP_OUT_M = Register(0x31, access='ro', size=2, reset=None, part=MAG)

    # --- fields and codes ----------------------------------------------------------------
    # fmt: off
    sample_rate = Field(  # code 9 is 1344 Hz without low power, 5376 Hz with it
        CTRL_REG1_A, (7, 4),
        Codes({0.0: 0, 1.0: 1, 10.0: 2, 25.0: 3, 50.0: 4, 100.0: 5, 200.0: 6, 400.0: 7,
               1344.0: 9}), 'Hz')
    low_power = Field(CTRL_REG1_A, 3)
    axes_enabled = Field(CTRL_REG1_A, (2, 0))
    watermark_interrupt = Field(CTRL_REG3_A, 2)
    block_update = Field(CTRL_REG4_A, 7)
    accelerometer_range = Field(
        CTRL_REG4_A, (5, 4), Codes({2.0: 0, 4.0: 1, 8.0: 2, 16.0: 3}), 'g')
    high_resolution = Field(CTRL_REG4_A, 3)
    boot = Field(CTRL_REG5_A, 7, self_clearing=True)
    fifo_enable = Field(CTRL_REG5_A, 6)
    fifo_mode = Field(
        FIFO_CTRL_REG_A, (7, 6), Codes({'bypass': 0, 'fifo': 1, 'stream': 2, 'trigger': 3}))
    fifo_trigger = Field(FIFO_CTRL_REG_A, 5)
    fifo_threshold = Field(FIFO_CTRL_REG_A, (4, 0))
    fifo_reached = Field(FIFO_SRC_REG_A, 7)
    fifo_overrun = Field(FIFO_SRC_REG_A, 6)
    fifo_empty = Field(FIFO_SRC_REG_A, 5)
    fifo_level = Field(FIFO_SRC_REG_A, (4, 0))
    temperature_enable = Field(CRA_REG_M, 7)
    magnetometer_rate = Field(  # DS: at least so fast
        CRA_REG_M, (4, 2),
        Codes({0.75: 0, 1.5: 1, 3.0: 2, 7.5: 3, 15.0: 4, 30.0: 5, 75.0: 6, 220.0: 7}), 'Hz')
    magnetometer_range = Field(
        CRB_REG_M, (7, 5),
        Codes({1.3: 1, 1.9: 2, 2.5: 3, 4.0: 4, 4.7: 5, 5.6: 6, 8.1: 7}), 'G')
    magnetometer_mode = Field(
        MR_REG_M, (1, 0),
        Codes({'continuous': 0, 'single': 1, 'sleep': 3},
              aliases={2: ('sleep', 'DS prints 10 and 11 as sleep mode')}))
    magnetometer_lock = Field(SR_REG_M, 1)
    magnetometer_ready = Field(SR_REG_M, 0)
    # fmt: on

    identities = (Identity(IR_REG_M, {0x483433: 'LSM303DLHC'}),)  # the other die has none

    # --- channels (DS table 3; figure 4: both right-handed and alike) ----------------------
    # fmt: off
    acceleration = Vector(  # 12 bit, left-justified
        first=OUT_A, quantity='acceleration', unit='m/s²', dtype='<i2', shift=4,
        scaled_by=accelerometer_range,
        si_per_lsb={2.0: 1e-3 * G, 4.0: 2e-3 * G, 8.0: 4e-3 * G, 16.0: 12e-3 * G},
    )
    magnetic_field = Vector(  # DS table 75; the registers are x, z, y
        first=OUT_M, quantity='magnetic_field', unit='T', dtype='>i2', limits=(-2048, 2047),
        scaled_by=magnetometer_range, axes=((1, 0, 0), (0, 0, 1), (0, 1, 0)),
        si_per_lsb={1.3: _field_lsb(1100, 980), 1.9: _field_lsb(855, 760),
                    2.5: _field_lsb(670, 600), 4.0: _field_lsb(450, 400),
                    4.7: _field_lsb(400, 355), 5.6: _field_lsb(330, 295),
                    8.1: _field_lsb(230, 205)},
    )
    temperature = Scalar(  # 12 bit, left-justified
        first=TEMP_OUT_M, quantity='temperature', unit='°C', dtype='>i2', shift=4,
        si_per_lsb=1 / 8, offset=TEMPERATURE_ZERO,
    )
    depth = SLOTS

    # --- settings ------------------------------------------------------------------------
    settings = (
        Setting('rate_hz', 1344.0, 'Output data rate; the bandwidth is a ninth of it.',
                (1.0, 10.0, 25.0, 50.0, 100.0, 200.0, 400.0, 1344.0), unit='Hz'),
        choice('accelerometer_range', accelerometer_range, 16.0, 'Full scale.'),
        choice('magnetometer_range', magnetometer_range, 1.3, 'Full scale.'),
        Setting('magnetometer_rate_hz', 75.0,
                'Rate of magnetometer and thermometer, at least so fast; 0 is off.',
                (0.0, *magnetometer_rate.allowed), unit='Hz'),
        Setting('temperature_zero', TEMPERATURE_ZERO,
                'Temperature at reading 0; the document gives none, so find it out.',
                bounds=(-100.0, 100.0), unit='°C'),
    )
    # fmt: on
    counter_names = ('magnetometer_lost', 'magnetometer_overflows')

    # --- sequences (a reboot reloads the trim and leaves the control registers) -------------
    reset_steps = (
        Write({CTRL_REG5_A: 0x80}),
        Wait(0.005, 'DS gives no time; as is usual with relatives'),
        Until(boot, 0, 1.0),
        Write(
            {
                CTRL_REG1_A: 0x07,
                CTRL_REG2_A: 0x00,
                CTRL_REG3_A: 0x00,
                CTRL_REG4_A: 0x00,
                CTRL_REG5_A: 0x00,
                CTRL_REG6_A: 0x00,
                FIFO_CTRL_REG_A: 0x00,
                CRA_REG_M: 0x10,
                CRB_REG_M: 0x20,
                MR_REG_M: 0x03,
            }
        ),
    )
    start_steps = (
        Write({FIFO_CTRL_REG_A: 0x00}),
        Write({fifo_mode: 'stream', fifo_trigger: 0, fifo_threshold: 0}),
    )
    stop_steps = (Write({FIFO_CTRL_REG_A: 0x00}),)

    # --- typical values (DS table 3) -----------------------------------------------------
    # fmt: off
    typical: ClassVar[Mapping[str, Typical]] = {
        'acceleration': Typical(
            'DS table 3; noise at ±2 g; bandwidth ODR/9',
            noise_density=220e-6 * G, bandwidth=1344 / 9, range=16 * G, resolution=12e-3 * G,
            bias=60e-3 * G, bias_per_kelvin=0.5e-3 * G, scale_per_kelvin=1e-4),
        'magnetic_field': Typical(
            'DS table 3; neither offset nor noise given', range=1.3 * GAUSS,
            resolution=2e-3 * GAUSS),
        'temperature': Typical('DS: 8 LSB/K', resolution=1 / 8),
    }

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        Witness(acceleration, '003e00000000', (9.7282, 0, 0), '992 at 1 mg', 2.0),
        Witness(acceleration, '0000401f0000', (0, 9.80665, 0), '500 at 2 mg', 4.0),
        Witness(acceleration, '0000000060f0', (0, 0, -9.80665), '-250 at 4 mg', 8.0),
        Witness(acceleration, '000000003005', (0, 0, 9.76742), '83 at 12 mg', 16.0),
        Witness(magnetic_field, '022601ea0000', (50e-6, 0, 50e-6),
                '550 at 1100, 490 at 980 LSB/G; x, z, y', 1.3),
        Witness(magnetic_field, '000002f80357', (0, 100e-6, 100e-6), '760 and 855 LSB/G', 1.9),
        Witness(magnetic_field, '029e02580000', (100e-6, 0, 100e-6), '670 and 600 LSB/G', 2.5),
        Witness(magnetic_field, '01c20190fe3e', (100e-6, -100e-6, 100e-6), '450, 400 LSB/G', 4.0),
        Witness(magnetic_field, '019001630000', (100e-6, 0, 100e-6), '400 and 355 LSB/G', 4.7),
        Witness(magnetic_field, '00000127014a', (0, 100e-6, 100e-6), '295 and 330 LSB/G', 5.6),
        Witness(magnetic_field, '00e6ff330000', (100e-6, 0, -100e-6), '230 and 205 LSB/G', 8.1),
        Witness(temperature, '0500', (30.0,), '80 at 8 LSB/K; zero assumed at 20 °C'),
    )
    # fmt: on

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        self.fifo = SlotFifo(
            self.registers, clock, self.counters, control=self.FIFO_CTRL_REG_A,
            running=self.fifo_mode.insert(0, 'stream'),
            level=self.fifo_level, overrun=self.fifo_overrun, first=self.OUT_A,
            frame=Frame(self.acceleration), depth=self.depth, rate_hz=self.rate_hz,
            edges=self.edges,
        )  # fmt: skip
        self._field = PolledQuantity(clock, float(self.values['magnetometer_rate_hz']))
        self._field_frame = Frame(self.magnetic_field)
        rate = self._field.rate_hz
        self.rates_hz = {'magnetic_field': rate, 'temperature': rate} if rate else {}
        self._last_field = b''
        self._ready_stays = False
        self.fifo.rise_at(self.watermark())

    @property
    def poll_period_s(self) -> float:
        """Return a quarter of the FIFO, or half a period of the magnetometer, which is a limit."""
        return min(super().poll_period_s, *(0.5 / rate for rate in self.rates_hz.values()), 0.25)

    def assignments(self) -> dict[Any, Value]:
        """Return the settings, and everything that must be as the stream needs it."""
        return {
            **super().assignments(),
            self.sample_rate: self.rate_hz,
            self.low_power: 0,
            self.axes_enabled: 7,
            self.block_update: 1,
            self.high_resolution: 1,
            self.CTRL_REG2_A: 0x00,
            self.watermark_interrupt: int(self.edges is not None),
            self.CTRL_REG5_A: 0x40,  # FIFO
            **self._magnetometer_assignments(),
        }

    def _magnetometer_assignments(self) -> dict[Any, Value]:
        rate = self._field.rate_hz
        return {
            self.temperature_enable: 1,
            self.magnetometer_rate: rate or 15.0,
            self.magnetometer_range: self.values['magnetometer_range'],
            self.magnetometer_mode: 'continuous' if rate else 'sleep',
        }

    def configure_parts(self) -> None:
        """Throw the first samples away; find out whether reading clears the ready flag."""
        self.fifo.skip = TURN_ON
        if self._field.rate_hz:
            timeout_s = 0.1 + 3 / self._field.rate_hz
            self.registers.run((Until(self.magnetometer_ready, 1, timeout_s),))
            # a new field, or one just being written, may show the other answer once
            self._ready_stays = sum(self._ready_after_reading() for _ in range(5)) > 2

    def _ready_after_reading(self) -> bool:
        self._last_field = self.registers.burst(self.OUT_M)
        return bool(self.registers.read(self.magnetometer_ready))

    def start(self) -> None:
        """Empty the FIFO and start it."""
        super().start()
        self._field.begin()

    def read(self) -> list[Samples]:
        """Return everything new; after an overrun what is left of it, as a new beginning."""
        slots = self.take()
        if slots is None:
            return []
        runs: list[Samples] = []
        if len(slots.words):
            runs.append(Samples(slots.stamps, **self.decode(slots.words, self.acceleration)))
        if self._field.rate_hz:
            with suppress(BusError):  # counted by the bus; what the FIFO gave is delivered
                runs += self._read_field()
        return runs

    def _read_field(self) -> list[Samples]:
        """Return field and temperature if they are new; find out why if not for long."""
        ready = bool(self.registers.read(self.magnetometer_ready))
        data = self.registers.burst(self.OUT_M) if ready else b''
        if data and self._is_new(data):
            self._last_field = data
            return self._fields(data, self.registers.bytewise(self.TEMP_OUT_M))
        if self._field.silent:
            self.look_after(self._magnetometer_assignments())
        return self._field.pass_by()

    def _is_new(self, data: bytes) -> bool:
        return not self._ready_stays or data != self._last_field or self._field.overdue

    def _fields(self, data: bytes, warmth: bytes) -> list[Samples]:
        """Return a sample of both, none if the field was too strong."""
        stamps = self._field.found()
        self.counters['magnetometer_lost'] = self._field.lost
        words = self._field_frame.unpack(data)
        if (words['magnetic_field'] == OVERFLOW).any():
            self.counters['magnetometer_overflows'] += 1
            return []
        degrees = self.temperature.decode(np.frombuffer(warmth, self.temperature.dtype))
        degrees += float(self.values['temperature_zero']) - TEMPERATURE_ZERO
        return [Samples(stamps, **self.decode(words, self.magnetic_field), temperature=degrees)]
