# SPDX-License-Identifier: Apache-2.0
"""
InvenSense MPU-9250: accelerometer, gyroscope, and the magnetometer AK8963 behind it.

Documents: PS-MPU-9250A-01 rev. 1.1 (PS), RM-MPU-9250A-00 rev. 1.6 (RM), and for the
magnetometer AK8963 MS1356-E-02 (AK).  Not offered: rates above 1 kHz, with which the FIFO would
be full in a few ms; the low-power mode; and 14 bits of the magnetometer, four times coarser.
The magnetometer is read by the chip's own I²C master, so that two chips do not collide at 0x0C.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, ClassVar

from imu_bench.bus.auxiliary import AuxiliaryBus
from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.bus.polled_quantity import PolledQuantity
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, FifoDriver, Identity, Setting, Typical, Witness
from imu_bench.errors import BusError, NoAnswer
from imu_bench.registers import Codes, Field, Frame, Register, Scalar, Value, Vector, Wait, Write
from imu_bench.samples import Samples
from imu_bench.units import DEGREE, STANDARD_GRAVITY
import numpy as np

G = STANDARD_GRAVITY
MAG = 'magnetometer'
FIFO_BYTES = 512  # PS section 4.17
MPU_6500 = 0x70
RATES = tuple(round(1000.0 / n, 3) for n in range(1, 257))


class Mpu9250(FifoDriver):
    """InvenSense MPU-9250, FIFO bursts, through I²C or SPI."""

    # --- document and identity -----------------------------------------------------------
    name = 'mpu9250'
    title = 'InvenSense MPU-9250'
    document = 'PS-MPU-9250A-01 rev. 1.1, RM-MPU-9250A-00 rev. 1.6, AK8963 MS1356-E-02'
    bus_kinds = ('i2c', 'spi')
    data_ready_pin = 'INT'  # RM register 55: at its reset value high for 50 µs
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # PS sections 7.2, 7.5: 1 MHz is the limit of SPI for every register
        '': Wiring(i2c_addresses=(0x68, 0x69), spi_max_hz=1_000_000),
        # AK section 7.2; seen on the main bus when BYPASS_EN is set, never on SPI
        MAG: Wiring(i2c_addresses=(0x0C,), only_with='magnetometer_bypass'),
    }

    # --- register map (RM section 3) -----------------------------------------------------
    GYRO_OFFSET = Register(0x13, size=6)
    SMPLRT_DIV = Register(0x19)
    CONFIG = Register(0x1A)
    GYRO_CONFIG = Register(0x1B)
    ACCEL_CONFIG = Register(0x1C)
    ACCEL_CONFIG2 = Register(0x1D)
    LP_ACCEL_ODR = Register(0x1E)
    WOM_THR = Register(0x1F)
    FIFO_EN = Register(0x23)
    I2C_MST_CTRL = Register(0x24)
    I2C_SLV0_ADDR = Register(0x25)
    I2C_SLV0_REG = Register(0x26)
    I2C_SLV0_CTRL = Register(0x27)
    I2C_SLV1 = Register(0x28, size=3)
    I2C_SLV2 = Register(0x2B, size=3)
    I2C_SLV3 = Register(0x2E, size=3)
    I2C_SLV4_ADDR = Register(0x31)
    I2C_SLV4_REG = Register(0x32)
    I2C_SLV4_DO = Register(0x33)
    I2C_SLV4_CTRL = Register(0x34)
    I2C_SLV4_DI = Register(0x35, access='ro')
    I2C_MST_STATUS = Register(0x36, access='ro', clear_on_read=True)
    INT_PIN_CFG = Register(0x37)
    INT_ENABLE = Register(0x38)
    INT_STATUS = Register(0x3A, access='ro', clear_on_read=True)
    ACCEL_OUT = Register(0x3B, access='ro', size=6)
    TEMP_OUT = Register(0x41, access='ro', size=2)
    GYRO_OUT = Register(0x43, access='ro', size=6)
    EXT_SENS_DATA = Register(0x49, access='ro', size=24)
    I2C_SLV_DO = Register(0x63, size=4)
    I2C_MST_DELAY_CTRL = Register(0x67)
    SIGNAL_PATH_RESET = Register(0x68)
    MOT_DETECT_CTRL = Register(0x69)
    USER_CTRL = Register(0x6A)
    PWR_MGMT_1 = Register(0x6B, reset=0x01)
    PWR_MGMT_2 = Register(0x6C)
    FIFO_COUNT = Register(0x72, access='ro', size=2)
    FIFO_R_W = Register(0x74)
    WHO_AM_I = Register(0x75, access='ro', reset=0x71)
    XA_OFFSET = Register(0x77, size=2, reset=None)
    YA_OFFSET = Register(0x7A, size=2, reset=None)
    ZA_OFFSET = Register(0x7D, size=2, reset=None)

    # AK section 8.2
    WIA = Register(0x00, access='ro', reset=0x48, part=MAG)
    INFO = Register(0x01, access='ro', reset=None, part=MAG)
    ST1 = Register(0x02, access='ro', part=MAG)
    MAG_OUT = Register(0x03, access='ro', size=6, reset=None, order='little', part=MAG)
    ST2 = Register(0x09, access='ro', part=MAG)
    CNTL1 = Register(0x0A, part=MAG)
    CNTL2 = Register(0x0B, part=MAG)
    ASTC = Register(0x0C, part=MAG)
    ASA = Register(0x10, access='ro', size=3, reset=None, part=MAG)

    # --- fields and codes ----------------------------------------------------------------
    sample_rate = Field(SMPLRT_DIV, (7, 0), Codes({hz: n for n, hz in enumerate(RATES)}), 'Hz')
    fifo_stops_when_full = Field(CONFIG, 6)
    # fmt: off
    gyroscope_bandwidth = Field(  # 0 and 7 run at 8 kHz
        CONFIG, (2, 0),
        Codes({250.0: 0, 184.0: 1, 92.0: 2, 41.0: 3, 20.0: 4, 10.0: 5, 5.0: 6, 3600.0: 7}), 'Hz')
    gyroscope_range = Field(
        GYRO_CONFIG, (4, 3), Codes({250.0: 0, 500.0: 1, 1000.0: 2, 2000.0: 3}), '°/s')
    gyroscope_filter_bypass = Field(GYRO_CONFIG, (1, 0))
    accelerometer_range = Field(
        ACCEL_CONFIG, (4, 3), Codes({2.0: 0, 4.0: 1, 8.0: 2, 16.0: 3}), 'g')
    # RM rev. 1.6, and Zephyr.  Rev. 1.4, which others cite, has 460, 184, 92, 41, 20, 10 and 5 Hz:
    # the figures of the gyroscope's table
    accelerometer_bandwidth = Field(
        ACCEL_CONFIG2, (2, 0),
        Codes({420.0: 7, 218.1: 1, 99.0: 2, 44.8: 3, 21.2: 4, 10.2: 5, 5.05: 6},
              aliases={0: (218.1, 'RM rev. 1.6 prints it for 0 and 1')}),
        'Hz')
    accelerometer_filter_bypass = Field(ACCEL_CONFIG2, 3)
    # fmt: on
    fifo_temperature = Field(FIFO_EN, 7)
    fifo_gyroscope = Field(FIFO_EN, (6, 4))
    fifo_accelerometer = Field(FIFO_EN, 3)
    fifo_slave0 = Field(FIFO_EN, 0)
    bypass = Field(INT_PIN_CFG, 1)
    overflow_interrupt = Field(INT_ENABLE, 4)
    data_interrupt = Field(INT_ENABLE, 0)
    fifo_overflow = Field(INT_STATUS, 4)
    data_ready = Field(INT_STATUS, 0)
    fifo_enable = Field(USER_CTRL, 6)
    master_enable = Field(USER_CTRL, 5)
    i2c_disable = Field(USER_CTRL, 4)
    fifo_reset = Field(USER_CTRL, 2, self_clearing=True)
    device_reset = Field(PWR_MGMT_1, 7, self_clearing=True)
    sleep = Field(PWR_MGMT_1, 6)
    clock_source = Field(PWR_MGMT_1, (2, 0), Codes({'internal': 0, 'pll': 1, 'stopped': 7}))
    magnetometer_ready = Field(ST1, 0)
    magnetometer_overrun = Field(ST1, 1)
    magnetometer_overflow = Field(ST2, 3)
    magnetometer_mode = Field(
        CNTL1, (3, 0), Codes({0.0: 0, 8.0: 2, 100.0: 6, 'once': 1, 'trim': 15}), 'Hz'
    )
    magnetometer_bits = Field(CNTL1, 4, Codes({14: 0, 16: 1}))
    magnetometer_reset = Field(CNTL2, 0, self_clearing=True)

    identities = (
        Identity(
            WHO_AM_I,
            {0x71: 'MPU-9250', 0x73: 'MPU-9255'},
            {
                MPU_6500: 'MPU-6500, often sold as MPU-9250, without a magnetometer; '
                'magnetometer_rate_hz: 0.0 does without it',
                0x68: 'MPU-6050',
            },
        ),
    )

    # --- channels (PS section 3; AK section 8.3) -----------------------------------------
    # fmt: off
    acceleration = Vector(
        first=ACCEL_OUT, quantity='acceleration', unit='m/s²', dtype='>i2',
        scaled_by=accelerometer_range,
        si_per_lsb={2.0: G / 16384, 4.0: G / 8192, 8.0: G / 4096, 16.0: G / 2048},
    )
    angular_velocity = Vector(
        first=GYRO_OUT, quantity='angular_velocity', unit='rad/s', dtype='>i2',
        scaled_by=gyroscope_range,
        si_per_lsb={250.0: DEGREE / 131, 500.0: DEGREE / 65.5,
                    1000.0: DEGREE / 32.8, 2000.0: DEGREE / 16.4},
    )
    temperature = Scalar(
        first=TEMP_OUT, quantity='temperature', unit='°C', dtype='>i2',
        si_per_lsb=1 / 333.87, offset=21.0,
    )
    magnetic_field = Vector(  # 16 bit; axes by PS figures 4 and 5
        first=MAG_OUT, quantity='magnetic_field', unit='T', dtype='<i2',
        si_per_lsb=0.15e-6, limits=(-32760, 32760),
        axes=((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    )

    # --- settings ------------------------------------------------------------------------
    settings = (
        Setting('rate_hz', 1000.0, 'Output data rate: 1000/(1 + n).', RATES, unit='Hz'),
        choice('accelerometer_range', accelerometer_range, 16.0, 'Full scale.'),
        choice('accelerometer_bandwidth', accelerometer_bandwidth, 420.0, 'Low-pass, -3 dB.'),
        choice('gyroscope_range', gyroscope_range, 2000.0, 'Full scale.'),
        Setting('gyroscope_bandwidth', 184.0, 'Low-pass, -3 dB; wider ones run at 8 kHz only.',
                (184.0, 92.0, 41.0, 20.0, 10.0, 5.0), unit='Hz'),
        Setting('magnetometer_rate_hz', 100.0, 'Rate of the magnetometer; 0 is off.',
                (0.0, 8.0, 100.0), unit='Hz'),
        Setting('magnetometer_bypass', False, 'I²C: read the magnetometer at its own address, '
                '0x0C; less on the bus, for one MPU-9250 on it.'),
    )
    # fmt: on
    counter_names = ('magnetometer_lost', 'magnetometer_overflows')

    # --- sequences (RM section 4; AK section 9.3) ----------------------------------------
    reset_steps = (
        Write({device_reset: 1}),
        Wait(0.1, 'register access 100 ms after power-up at the latest, PS table 3'),
        Write({clock_source: 'pll', sleep: 0, PWR_MGMT_2: 0}),
        Wait(0.035, 'gyroscope start-up, PS table 1'),
    )
    start_steps = (
        Write({INT_ENABLE: 0, FIFO_EN: 0, fifo_enable: 0}),
        Write({fifo_reset: 1}),
        Write({fifo_enable: 1, overflow_interrupt: 1, data_interrupt: 1}),
    )
    stop_steps = (Write({FIFO_EN: 0, fifo_enable: 0, INT_ENABLE: 0}),)
    bypass_steps = (Write({master_enable: 0, bypass: 1}),)
    master_steps = (Write({bypass: 0, I2C_MST_CTRL: 0x4D, master_enable: 1}),)  # 400 kHz, waits
    # slave 0 reads ST1, data, ST2: 8 bytes per sample
    cyclic_steps = (Write({I2C_SLV0_ADDR: 0x8C, I2C_SLV0_REG: 0x02, I2C_SLV0_CTRL: 0x88}),)
    magnetometer_trim_steps = (
        Write({magnetometer_reset: 1}),
        Wait(0.01, 'AK gives no time for the reset; 100 µs between modes'),
        Write({magnetometer_mode: 'trim', magnetometer_bits: 16}),
        Wait(0.01),
    )
    magnetometer_off_steps = (Write({magnetometer_mode: 0.0, magnetometer_bits: 16}), Wait(0.01))

    # --- typical values ------------------------------------------------------------------
    # fmt: off
    typical: ClassVar[Mapping[str, Typical]] = {
        'acceleration': Typical(
            'PS rev. 1.1 table 2', noise_density=300e-6 * G, bandwidth=420.0, range=16 * G,
            resolution=G / 2048, bias=(0.06 * G, 0.06 * G, 0.08 * G), bias_per_kelvin=1.5e-3 * G,
            scale_error=0.03, scale_per_kelvin=0.026e-2, nonlinearity=0.005, cross_axis=0.02),
        'angular_velocity': Typical(
            'PS rev. 1.1 table 1; bias over temperature ±30 °/s for -40…85 °C, from 25 °C on',
            noise_density=0.01 * DEGREE, bandwidth=184.0, range=2000 * DEGREE,
            resolution=DEGREE / 16.4, bias=5 * DEGREE, bias_per_kelvin=30 * DEGREE / 65,
            scale_error=0.03, nonlinearity=0.001, cross_axis=0.02),
        'magnetic_field': Typical(
            'AK table 5.3; noise not given', range=4912e-6, resolution=0.15e-6, bias=300e-6),
        'temperature': Typical('PS rev. 1.1 table 3', resolution=1 / 333.87),
    }

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        Witness(acceleration, '400000000000', (9.80665, 0, 0), 'PS: 16384 LSB/g', 2.0),
        Witness(acceleration, '0000e0000000', (0, -9.80665, 0), 'PS: 8192 LSB/g', 4.0),
        Witness(acceleration, '000000001000', (0, 0, 9.80665), 'PS: 4096 LSB/g', 8.0),
        Witness(acceleration, '000000000800', (0, 0, 9.80665), 'PS: 2048 LSB/g', 16.0),
        Witness(angular_velocity, '008300000000', (0.01745329, 0, 0), '131 LSB = 1 °/s', 250.0),
        Witness(angular_velocity, '0000ff7d0000', (0, -0.03490659, 0), '65.5 LSB/(°/s)', 500.0),
        Witness(angular_velocity, '0000000000a4', (0, 0, 0.08726646), '32.8 LSB/(°/s)', 1000.0),
        Witness(angular_velocity, '066800000000', (1.745329, 0, 0), '1640 LSB = 100 °/s', 2000.0),
        Witness(temperature, '0d0b', (31.0,), 'PS: 333.87 LSB/K, 0 at 21 °C; 3339'),
        Witness(magnetic_field, '2c0100000000', (0, 53.4375e-6, 0),
                'AK section 8.3.11, ASA = 176, H = 300', trim=(1.1875, 1.0, 1.0)),
    )
    # fmt: on

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        self._field = PolledQuantity(clock, float(self.values['magnetometer_rate_hz']))
        rate = self._field.rate_hz
        self.rates_hz = {'magnetic_field': rate} if rate else {}
        self._mode = {self.magnetometer_mode: rate, self.magnetometer_bits: 16}
        self._in_fifo = rate > 0.0 and not self._bypass
        inertial = (self.acceleration, self.temperature, self.angular_velocity)
        behind = (self.ST1, self.magnetic_field, self.ST2)
        self._frame = Frame(*inertial, *(behind if self._in_fifo else ()))
        self._magnetometer_frame = Frame(*behind)
        self.depth = FIFO_BYTES // self._frame.size

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        """Return the bus of the chip, and that of the magnetometer: slave 4, or bypass."""
        self._bypass = bool(self.values['magnetometer_bypass']) and MAG in wires
        behind = wires[MAG] if self._bypass else AuxiliaryBus(wires[''], self.clock, 0x0C)
        return {'': wires[''], MAG: behind}

    def check_identity(self, identity: Identity) -> str:
        """Return the name of the part that answers; an MPU-6500 will do without magnetometer."""
        if MPU_6500 in identity.others and not self.values['magnetometer_rate_hz']:
            expected = {**identity.expected, MPU_6500: 'MPU-6500'}
            identity = replace(identity, expected=expected)
        return super().check_identity(identity)

    def assignments(self) -> dict[Any, Value]:
        """Return the settings, with the filters on and, on SPI, I²C off (RM register 106)."""
        return {
            **super().assignments(),
            self.sample_rate: self.rate_hz,
            self.gyroscope_filter_bypass: 0,
            self.accelerometer_filter_bypass: 0,
            self.fifo_stops_when_full: 0,
            self.i2c_disable: int(MAG not in self._wires),
        }

    def configure_parts(self) -> None:
        """Configure the magnetometer and fetch its sensitivity."""
        if self._field.rate_hz:
            try:
                self._configure_magnetometer()
            except NoAnswer as error:
                raise NoAnswer(f'{error}; magnetometer_rate_hz: 0.0 does without it') from error

    def _configure_magnetometer(self) -> None:
        registers = self.registers
        registers.run(self.bypass_steps if self._bypass else self.master_steps)
        self.check_identity(Identity(self.WIA, {0x48: 'AK8963'}))
        registers.run(self.magnetometer_trim_steps)
        adjust = np.frombuffer(registers.burst(self.ASA), dtype=np.uint8)
        # AK section 8.3.11
        self.trims['magnetic_field'] = (adjust - 128.0) * 0.5 / 128.0 + 1.0
        registers.run(self.magnetometer_off_steps)
        registers.write({self.magnetometer_mode: self._field.rate_hz})
        registers.verify(self._mode)
        if self._in_fifo:
            registers.run(self.cyclic_steps)

    def start(self) -> None:
        """Empty the FIFO and start it: RM register 35, PS section 4.17."""
        super().start()
        channels = {self.fifo_temperature: 1, self.fifo_gyroscope: 7, self.fifo_accelerometer: 1}
        self.registers.write({**channels, self.fifo_slave0: int(self._in_fifo)})
        self.registers.word(self.INT_STATUS)
        self._field.begin()

    def read(self) -> list[Samples]:
        """Return everything new; nothing that was in the FIFO when it ran over."""
        if self.torn or not self.configured:
            self.restart()
        level, latched = self.latch(self.FIFO_COUNT)
        count = self.FIFO_COUNT.unpack(level)
        self.check_level(self.FIFO_COUNT, count, FIFO_BYTES)
        self.torn = True  # until the burst has been taken out whole
        whole = count - count % self._frame.size
        data = self.registers.burst(self.FIFO_R_W, whole) if whole else b''
        if not self._sound(count):
            return []
        self.torn = False
        words = self._frame.unpack(data)
        stamps = self.stamps(latched, len(words))
        runs = [self._inertial(words, stamps)] if len(words) else []
        if self._field.rate_hz:
            with suppress(BusError):  # counted by the bus; what the FIFO gave is delivered
                runs += self._behind(words, stamps) if self._in_fifo else self._beside()
                if self._field.silent:
                    self.look_after(self._mode)
        return runs

    def _sound(self, count: int) -> bool:
        """Return whether what was read can be trusted; put things right if not."""
        status = self.registers.word(self.INT_STATUS)
        user, power = self.registers.burst(self.USER_CTRL, 2)
        if not user & self.fifo_enable.mask or power & self.sleep.mask:
            self.restart()
        elif count == FIFO_BYTES or status & self.fifo_overflow.mask:
            self.counters['fifo_overflows'] += 1
            self.start()
        else:
            return True
        return False

    def _inertial(self, words: np.ndarray, stamps: np.ndarray) -> Samples:
        columns = self.decode(words, self.acceleration, self.angular_velocity)
        return Samples(
            stamps, **columns, temperature=self.temperature.decode(words['temperature'])
        )

    def _beside(self) -> list[Samples]:
        """Read the magnetometer through the bypass; it was ready some time since the last look."""
        data = self.registers.burst(self.ST1, self._magnetometer_frame.size)
        if not data[0] & self.magnetometer_ready.mask:
            return self._field.pass_by()
        stamps = self._field.found(bool(data[0] & self.magnetometer_overrun.mask))
        self.counters['magnetometer_lost'] = self._field.lost
        return self._magnetic(self._magnetometer_frame.unpack(data), stamps)

    def _behind(self, words: np.ndarray, stamps: np.ndarray) -> list[Samples]:
        """Return what slave 0 has put into the FIFO: ST1 says new or lost."""
        status = words['ST1']
        new = status & self.magnetometer_ready.mask != 0
        lost = np.count_nonzero(status & self.magnetometer_overrun.mask)
        self.counters['magnetometer_lost'] += int(lost)
        if new.any():
            self._field.heard()
        return self._magnetic(words[new], stamps[new])

    def _magnetic(self, words: np.ndarray, stamps: np.ndarray) -> list[Samples]:
        """Return those that were not too strong: ST2."""
        strong = words['ST2'] & self.magnetometer_overflow.mask != 0
        self.counters['magnetometer_overflows'] += int(strong.sum())
        trim = self.trims['magnetic_field']
        field = self.magnetic_field.decode(words['magnetic_field'][~strong], trim=trim)
        return [Samples(stamps[~strong], magnetic_field=field)] if len(field) else []
