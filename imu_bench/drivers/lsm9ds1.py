# SPDX-License-Identifier: Apache-2.0
"""
ST LSM9DS1: accelerometer and gyroscope on one die, magnetometer on another.

Document: DocID025715 rev. 2 (DS).  It leaves some things open; what is assumed about them is
said where it is used: order and removal of FIFO slots, time for a reset, and noise.  Not offered:
the accelerometer alone (10, 50 Hz) or behind CTRL_REG7_XL's filter, and the high-pass filters.
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
from imu_bench.errors import BusError, ConfigError
from imu_bench.registers import Codes, Field, Frame, Register, Scalar, Value, Vector, Wait, Write
from imu_bench.samples import Samples
from imu_bench.units import DEGREE, GAUSS, STANDARD_GRAVITY
import numpy as np

G = STANDARD_GRAVITY
MAG = 'magnetometer'
SLOTS = 32  # DS section 3.5
TRIED = 4  # slots, to find out how they are read
UNDRIVEN = 0xFF  # SPI has no acknowledge: what nobody drives reads ones
TEMPERATURE_HZ = 59.5  # with the gyroscope on: DS, temperature sensor characteristics

# DS, register CTRL_REG1_G: second low-pass by BW_G 0 to 3; there is none at 14.9 Hz
LOW_PASS_2: Mapping[float, tuple[float, ...]] = {
    14.9: (), 59.5: (16.0,) * 4, 119.0: (14.0, 31.0, 31.0, 31.0), 238.0: (14.0, 29.0, 63.0, 78.0),
    476.0: (21.0, 28.0, 57.0, 100.0), 952.0: (33.0, 40.0, 58.0, 100.0),
}  # fmt: skip
# DS tables 11 and 12, the longest of all filters: samples to throw away after turn-on
TURN_ON = {14.9: 2, 59.5: 13, 119.0: 13, 238.0: 14, 476.0: 15, 952.0: 18}


class Lsm9ds1(SlotDriver):
    """ST LSM9DS1, FIFO bursts, through I²C or SPI."""

    # --- document and identity -----------------------------------------------------------
    name = 'lsm9ds1'
    title = 'ST LSM9DS1'
    document = 'DocID025715 rev. 2'
    bus_kinds = ('i2c', 'spi')
    data_ready_pin = 'INT1_A/G'
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # DS tables 19 and 20; CTRL_REG8 lets the main die increment.  SDO low is the usual one
        # here, because that is clear of an LSM303DLHC, whose magnetometer is at 0x1E too
        '': Wiring(i2c_addresses=(0x6A, 0x6B), spi_mode=3, spi_max_hz=10_000_000),
        MAG: Wiring(
            i2c_addresses=(0x1C, 0x1E), i2c_increment=0x80,
            spi_mode=3, spi_max_hz=10_000_000, spi_increment=0x40,
        ),
    }  # fmt: skip

    # --- register map --------------------------------------------------------------------
    ACT_THS = Register(0x04)
    ACT_DUR = Register(0x05)
    INT_GEN_CFG_XL = Register(0x06)
    INT_GEN_THS_XL = Register(0x07, size=3)
    INT_GEN_DUR_XL = Register(0x0A)
    REFERENCE_G = Register(0x0B)
    INT1_CTRL = Register(0x0C)
    INT2_CTRL = Register(0x0D)
    WHO_AM_I = Register(0x0F, access='ro', reset=0x68)
    CTRL_REG1_G = Register(0x10)
    CTRL_REG2_G = Register(0x11)
    CTRL_REG3_G = Register(0x12)
    ORIENT_CFG_G = Register(0x13)
    INT_GEN_SRC_G = Register(0x14, access='ro', reset=None)
    OUT_TEMP = Register(0x15, access='ro', size=2, reset=None, order='little')
    STATUS_REG = Register(0x17, access='ro', reset=None)
    OUT_G = Register(0x18, access='ro', size=6, reset=None, order='little')
    CTRL_REG4 = Register(0x1E, reset=0x38)
    CTRL_REG5_XL = Register(0x1F, reset=0x38)
    CTRL_REG6_XL = Register(0x20)
    CTRL_REG7_XL = Register(0x21)
    CTRL_REG8 = Register(0x22, reset=0x04)
    CTRL_REG9 = Register(0x23)
    CTRL_REG10 = Register(0x24)
    INT_GEN_SRC_XL = Register(0x26, access='ro', reset=None)
    STATUS_REG_27 = Register(0x27, access='ro', reset=None)
    OUT_XL = Register(0x28, access='ro', size=6, reset=None, order='little')
    FIFO_CTRL = Register(0x2E)
    FIFO_SRC = Register(0x2F, access='ro', reset=None)
    INT_GEN_CFG_G = Register(0x30)
    INT_GEN_THS_G = Register(0x31, size=6)
    INT_GEN_DUR_G = Register(0x37)

    OFFSET_REG_M = Register(0x05, size=6, order='little', part=MAG)
    WHO_AM_I_M = Register(0x0F, access='ro', reset=0x3D, part=MAG)
    CTRL_REG1_M = Register(0x20, reset=0x10, part=MAG)
    CTRL_REG2_M = Register(0x21, part=MAG)
    CTRL_REG3_M = Register(0x22, reset=0x03, part=MAG)
    CTRL_REG4_M = Register(0x23, part=MAG)
    CTRL_REG5_M = Register(0x24, part=MAG)
    STATUS_REG_M = Register(0x27, access='ro', reset=None, part=MAG)
    OUT_M = Register(0x28, access='ro', size=6, reset=None, order='little', part=MAG)
    INT_CFG_M = Register(0x30, reset=0x08, part=MAG)
    INT_SRC_M = Register(0x31, access='ro', part=MAG)
    INT_THS_M = Register(0x32, size=2, order='little', part=MAG)

    # --- fields and codes ----------------------------------------------------------------
    # fmt: off
    sample_rate = Field(  # of both, while the gyroscope is on
        CTRL_REG1_G, (7, 5),
        Codes({0.0: 0, 14.9: 1, 59.5: 2, 119.0: 3, 238.0: 4, 476.0: 5, 952.0: 6}), 'Hz')
    gyroscope_range = Field(CTRL_REG1_G, (4, 3), Codes({245.0: 0, 500.0: 1, 2000.0: 3}), '°/s')
    gyroscope_low_pass = Field(CTRL_REG1_G, (1, 0))
    gyroscope_output = Field(
        CTRL_REG2_G, (1, 0),
        Codes({'low-pass 1': 0, 'high-pass': 1, 'low-pass 2': 2},
              aliases={3: ('low-pass 2', 'DS prints 10 and 11 at one input')}))
    accelerometer_rate = Field(  # with the gyroscope off
        CTRL_REG6_XL, (7, 5),
        Codes({0.0: 0, 10.0: 1, 50.0: 2, 119.0: 3, 238.0: 4, 476.0: 5, 952.0: 6}), 'Hz')
    accelerometer_range = Field(  # 16 g is the second code, not the last
        CTRL_REG6_XL, (4, 3), Codes({2.0: 0, 16.0: 1, 4.0: 2, 8.0: 3}), 'g')
    bandwidth_by_hand = Field(CTRL_REG6_XL, 2)
    accelerometer_bandwidth = Field(
        CTRL_REG6_XL, (1, 0), Codes({408.0: 0, 211.0: 1, 105.0: 2, 50.0: 3}), 'Hz')
    temperature_ready = Field(STATUS_REG, 2)
    boot = Field(CTRL_REG8, 7, self_clearing=True)
    block_update = Field(CTRL_REG8, 6)
    increment = Field(CTRL_REG8, 2)
    software_reset = Field(CTRL_REG8, 0, self_clearing=True)
    fifo_enable = Field(CTRL_REG9, 1)
    fifo_stops_at_threshold = Field(CTRL_REG9, 0)
    fifo_mode = Field(
        FIFO_CTRL, (7, 5),
        Codes({'bypass': 0, 'fifo': 1, 'continuous to fifo': 3, 'bypass to continuous': 4,
               'continuous': 6}))
    fifo_threshold = Field(FIFO_CTRL, (4, 0))
    threshold_interrupt = Field(INT1_CTRL, 3)
    fifo_reached = Field(FIFO_SRC, 7)
    fifo_overrun = Field(FIFO_SRC, 6)
    fifo_level = Field(FIFO_SRC, (5, 0))
    magnetometer_compensation = Field(CTRL_REG1_M, 7)
    magnetometer_quality = Field(
        CTRL_REG1_M, (6, 5), Codes({'low': 0, 'medium': 1, 'high': 2, 'ultra-high': 3}))
    magnetometer_rate = Field(
        CTRL_REG1_M, (4, 2),
        Codes({0.625: 0, 1.25: 1, 2.5: 2, 5.0: 3, 10.0: 4, 20.0: 5, 40.0: 6, 80.0: 7}), 'Hz')
    magnetometer_range = Field(
        CTRL_REG2_M, (6, 5), Codes({4.0: 0, 8.0: 1, 12.0: 2, 16.0: 3}), 'G')
    magnetometer_reset = Field(CTRL_REG2_M, 2, self_clearing=True)
    magnetometer_mode = Field(
        CTRL_REG3_M, (1, 0),
        Codes({'continuous': 0, 'single': 1, 'off': 3},
              aliases={2: ('off', 'DS prints 10 and 11 as power-down')}))
    magnetometer_quality_z = Field(
        CTRL_REG4_M, (3, 2), Codes({'low': 0, 'medium': 1, 'high': 2, 'ultra-high': 3}))
    # fmt: on
    magnetometer_block_update = Field(CTRL_REG5_M, 6)
    magnetometer_overrun = Field(STATUS_REG_M, 7)
    magnetometer_ready = Field(STATUS_REG_M, 3)

    identities = (
        Identity(WHO_AM_I, {0x68: 'LSM9DS1'}, {0xD4: 'gyroscope of an LSM9DS0 or L3GD20'}),
        Identity(WHO_AM_I_M, {0x3D: 'LSM9DS1'}, {0x49: 'LSM9DS0 or LSM303D'}),
    )

    # --- channels (DS table 3; figure 1: the accelerometer's x, y, z are left-handed, so its x
    # is turned round, and with it the rotation about it; the magnetometer is right-handed) ---
    # fmt: off
    acceleration = Vector(
        first=OUT_XL, quantity='acceleration', unit='m/s²', dtype='<i2',
        scaled_by=accelerometer_range, axes=((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
        si_per_lsb={2.0: 0.061e-3 * G, 4.0: 0.122e-3 * G, 8.0: 0.244e-3 * G, 16.0: 0.732e-3 * G},
    )
    angular_velocity = Vector(
        first=OUT_G, quantity='angular_velocity', unit='rad/s', dtype='<i2',
        scaled_by=gyroscope_range, axes=((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
        si_per_lsb={245.0: 8.75e-3 * DEGREE, 500.0: 17.5e-3 * DEGREE, 2000.0: 70e-3 * DEGREE},
    )
    # DS prints 0.14, 0.29, 0.43 and 0.58 mG: two digits, cut off, of one over 6842, 3421, 2281 and
    # 1711 LSB/G.  Those are the LIS3MDL's, the same die (identity 3Dh); Linux has them for both
    # (st_magn_core.c, commit 062809ef7733: 146, 292, 438, 584 µG), and ±4 G are then 27368 LSB
    magnetic_field = Vector(
        first=OUT_M, quantity='magnetic_field', unit='T', dtype='<i2',
        scaled_by=magnetometer_range,
        si_per_lsb={4.0: GAUSS / 6842, 8.0: GAUSS / 3421, 12.0: GAUSS / 2281, 16.0: GAUSS / 1711},
    )
    temperature = Scalar(  # 12 bit, sign extended
        first=OUT_TEMP, quantity='temperature', unit='°C', dtype='<i2', si_per_lsb=1 / 16,
        offset=25.0, limits=(-2048, 2047),
    )
    depth = SLOTS

    # --- settings ------------------------------------------------------------------------
    settings = (
        Setting('rate_hz', 952.0, 'Output data rate of both.', tuple(LOW_PASS_2), unit='Hz'),
        choice('accelerometer_range', accelerometer_range, 16.0, 'Full scale.'),
        choice('accelerometer_bandwidth', accelerometer_bandwidth, 408.0,
               'Anti-alias filter; 50 Hz goes with 119 Hz.'),
        choice('gyroscope_range', gyroscope_range, 2000.0, 'Full scale.'),
        Setting('gyroscope_low_pass_2', 0.0,
                'Second low-pass; 0 is without: the first one is left, 5, 19, 38, 76, 100, 100 Hz '
                'at the six rates.',
                (0.0, *sorted({hz for row in LOW_PASS_2.values() for hz in row})), unit='Hz'),
        choice('magnetometer_range', magnetometer_range, 4.0, 'Full scale.'),
        Setting('magnetometer_rate_hz', 80.0, 'Rate of the magnetometer; 0 is off.',
                (0.0, *magnetometer_rate.allowed), unit='Hz'),
        choice('magnetometer_quality', magnetometer_quality, 'ultra-high', 'Noise, for current.'),
    )
    # fmt: on
    counter_names = ('magnetometer_lost', 'slots_apart')

    # --- sequences (DS section 3.5; no document gives the time of a reset) ------------------
    reset_steps = (Write({software_reset: 1, increment: 1}), Wait(0.01, "as in Adafruit's driver"))
    magnetometer_reset_steps = (Write({CTRL_REG2_M: 0x0C}), Wait(0.01, 'likewise'))
    start_steps = (
        Write({fifo_mode: 'bypass', fifo_threshold: 0}),
        Write({fifo_mode: 'continuous', fifo_threshold: 0}),
    )
    stop_steps = (Write({fifo_mode: 'bypass', fifo_threshold: 0}),)
    filling_steps = (
        Write({fifo_mode: 'bypass', fifo_threshold: 0}),
        Write({sample_rate: 952.0}),
        Write({fifo_mode: 'fifo', fifo_threshold: 0}),
        Wait(0.04, '32 slots at 952 Hz'),
    )

    # --- typical values (DS table 3; it gives no noise) ----------------------------------
    # fmt: off
    typical: ClassVar[Mapping[str, Typical]] = {
        'acceleration': Typical(
            'DS table 3; offset at ±8 g after soldering', bandwidth=408.0, range=16 * G,
            resolution=0.732e-3 * G, bias=90e-3 * G),
        'angular_velocity': Typical(
            'DS table 3 and register CTRL_REG1_G', bandwidth=100.0, range=2000 * DEGREE,
            resolution=70e-3 * DEGREE, bias=30 * DEGREE),
        'magnetic_field': Typical(
            'DS table 3', range=4 * GAUSS, resolution=GAUSS / 6842, bias=1 * GAUSS),
        'temperature': Typical('DS, temperature sensor characteristics', resolution=1 / 16),
    }

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        Witness(acceleration, '000000000940', (0, 0, 9.80640), '0x4009 at 0.061 mg', 2.0),
        Witness(acceleration, '000000000520', (0, 0, 9.80699), '8197 at 0.122 mg', 4.0),
        Witness(acceleration, '000002100000', (0, 9.80579, 0), '4098 at 0.244 mg', 8.0),
        Witness(acceleration, 'aafa00000000', (9.80579, 0, 0),
                '-1366 at 0.732 mg, x turned round', 16.0),
        Witness(angular_velocity, 'e80300000000', (-0.152716, 0, 0),
                '1000 at 8.75 m°/s, x turned round', 245.0),
        Witness(angular_velocity, '0000d0070000', (0, 0.610865, 0), '2000 at 17.5 m°/s', 500.0),
        Witness(angular_velocity, '00000000e803', (0, 0, 1.221730), '1000 at 70 m°/s', 2000.0),
        Witness(magnetic_field, '5d0d00000000', (50e-6, 0, 0), '3421 of 6842 LSB/G', 4.0),
        Witness(magnetic_field, '00005d0d0000', (0, 100e-6, 0), '3421 LSB/G', 8.0),
        Witness(magnetic_field, '0000000017f7', (0, 0, -100e-6), '-2281 of 2281 LSB/G', 12.0),
        Witness(magnetic_field, 'af0600000000', (100e-6, 0, 0), '1711 LSB/G', 16.0),
        Witness(temperature, 'a000', (35.0,), 'DS: 16 LSB/K, 0 at 25 °C'),
    )
    # fmt: on

    # --- the stream ----------------------------------------------------------------------
    # A slot is the gyroscope's six bytes, then the accelerometer's: a burst from OUT_G on jumps
    # from 1Dh to 28h and from 2Dh to 18h (DS section 3.3).  Nobody is known to read it so: PX4
    # reads 6 and 6 bytes (LSM9DS1.cpp, commit 050fa47acac5).  It is tried out at every start.
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        self._low_pass_2 = self._low_pass_code()
        self.fifo = SlotFifo(
            self.registers, clock, self.counters, control=self.FIFO_CTRL,
            running=self.fifo_mode.insert(0, 'continuous'), level=self.fifo_level,
            overrun=self.fifo_overrun, first=self.OUT_G, depth=self.depth, rate_hz=self.rate_hz,
            frame=Frame(self.angular_velocity, self.acceleration), edges=self.edges,
        )  # fmt: skip
        self._field_frame = Frame(self.STATUS_REG_M, self.magnetic_field)
        self._field = PolledQuantity(clock, float(self.values['magnetometer_rate_hz']))
        self._warmth = PolledQuantity(clock, min(TEMPERATURE_HZ, self.rate_hz))
        rates = {'temperature': self._warmth.rate_hz, 'magnetic_field': self._field.rate_hz}
        self.rates_hz = {quantity: rate for quantity, rate in rates.items() if rate}
        self.fifo.rise_at(self.watermark())

    def _low_pass_code(self) -> int | None:
        """Return BW_G for the second low-pass, None without it."""
        wanted, offered = float(self.values['gyroscope_low_pass_2']), LOW_PASS_2[self.rate_hz]
        if wanted and wanted not in offered:
            allowed = ', '.join(f'{hz:g}' for hz in sorted({0.0, *offered}))
            raise ConfigError(
                f'{self.name}.gyroscope_low_pass_2: {wanted:g} is not possible at rate_hz '
                f'{self.rate_hz:g}; allowed: {allowed} Hz'
            )
        return offered.index(wanted) if wanted else None

    def identify(self) -> str:
        """Return the name of the part; a magnetometer that is off is not asked."""
        return [self.check_identity(i) for i in self.identities if self._used(i.register)].pop()

    def assignments(self) -> dict[Any, Value]:
        """Return the settings, and everything that must be as the stream needs it."""
        code = self.sample_rate.encode(self.rate_hz)
        wanted = {
            **super().assignments(),
            self.sample_rate: self.rate_hz,
            self.gyroscope_low_pass: self._low_pass_2 or 0,
            self.gyroscope_output: 'low-pass 1' if self._low_pass_2 is None else 'low-pass 2',
            self.accelerometer_rate: self.accelerometer_rate.decode(code),
            self.bandwidth_by_hand: 1,
            self.threshold_interrupt: int(self.edges is not None),
            self.CTRL_REG7_XL: 0x00,
            self.CTRL_REG8: 0x44,  # block update, increment
            self.CTRL_REG9: 0x02,  # FIFO
            **self._magnetometer_assignments(),
        }
        return {target: value for target, value in wanted.items() if self._used(target)}

    def _magnetometer_assignments(self) -> dict[Any, Value]:
        quality = self.values['magnetometer_quality']
        return {
            self.magnetometer_compensation: 1,
            self.magnetometer_rate: self._field.rate_hz or 80.0,
            self.magnetometer_range: self.values['magnetometer_range'],
            self.magnetometer_mode: 'continuous',
            **dict.fromkeys((self.magnetometer_quality, self.magnetometer_quality_z), quality),
            self.magnetometer_block_update: 1,
        }

    def _used(self, target: Field | Register) -> bool:
        register = target.register if isinstance(target, Field) else target
        return register.part == '' or self._field.rate_hz > 0

    def configure(self) -> None:
        """Reset both dies, then check, write, read back and compare."""
        if self._field.rate_hz:
            self.registers.run(self.magnetometer_reset_steps)
        super().configure()

    def configure_parts(self) -> None:
        """Find out how slots can be read; remember that the first samples are no good."""
        self.registers.run(self.filling_steps)
        self.fifo.apart = ()
        if not self._goes_on_from_slot_to_slot():
            self.fifo.apart = (self.OUT_G, self.OUT_XL)
            self.counters['slots_apart'] += 1
        self.registers.run(self.stop_steps)
        self.registers.write({self.sample_rate: self.rate_hz})
        self.registers.verify(self.assignments())
        self.fifo.skip = TURN_ON[self.rate_hz]

    def _goes_on_from_slot_to_slot(self) -> bool:
        """Return whether a burst gives slots, each once, and not what lies behind OUT_G."""
        before = int(self.registers.read(self.fifo_level))
        data = self.fifo.slots(TRIED)
        taken = before - int(self.registers.read(self.fifo_level))
        behind = self.registers.burst(self.CTRL_REG4, self.OUT_XL.size)
        return 0 < taken <= TRIED and behind not in {data[k : k + 6] for k in (6, 18, 30, 42)}

    def start(self) -> None:
        """Empty the FIFO and start it."""
        super().start()
        self._field.begin()
        self._warmth.begin()

    def read(self) -> list[Samples]:
        """Return everything new; after an overrun what is left of it, as a new beginning."""
        slots = self.take()
        if slots is None:
            return []
        runs: list[Samples] = []
        if len(slots.words):
            inertial = self.decode(slots.words, self.acceleration, self.angular_velocity)
            runs.append(Samples(slots.stamps, **inertial))
        with suppress(BusError):  # counted by the bus; what came out of the FIFO is delivered
            runs += self._read_temperature()
            if self._field.rate_hz:
                runs += self._read_field()
        return runs

    def _read_temperature(self) -> list[Samples]:
        status = self.registers.word(self.STATUS_REG)
        if not status & self.temperature_ready.mask or status == UNDRIVEN:
            return self._warmth.pass_by()
        words = np.frombuffer(self.registers.burst(self.OUT_TEMP), self.temperature.dtype)
        return [Samples(self._warmth.found(), temperature=self.temperature.decode(words))]

    def _read_field(self) -> list[Samples]:
        """Return the field if it is new; find out why if it has not been for long."""
        data = self.registers.burst(self.STATUS_REG_M, self._field_frame.size)
        if not any(byte < UNDRIVEN for byte in data):
            self.counters['bus_errors'] += 1
        elif data[0] & self.magnetometer_ready.mask:
            stamps = self._field.found(bool(data[0] & self.magnetometer_overrun.mask))
            self.counters['magnetometer_lost'] = self._field.lost
            words = self._field_frame.unpack(data)
            return [Samples(stamps, **self.decode(words, self.magnetic_field))]
        if self._field.silent:
            self.look_after(self._magnetometer_assignments())
        return self._field.pass_by()
