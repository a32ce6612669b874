# SPDX-License-Identifier: Apache-2.0
"""
TDK InvenSense IIM-42652: accelerometer and gyroscope for industry.

Document: DS-000401 rev. 1.2 (DS).  Where it contradicts itself the choice is said: length of
the timestamp's tick (both are accepted), byte order of FIFO_LOST_PKT (as the register's text).
Not offered: the low-power mode of the accelerometer, rates of its own for each sensor, and other
anti-alias filters than those of a reset, 585 Hz (gyroscope) and 1163 Hz (accelerometer).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from imu_bench.bus.banked import BankedBus
from imu_bench.bus.framing import fifo_packets
from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, FifoDriver, Identity, Setting, Typical, Witness
from imu_bench.errors import ConfigError, FrameError
from imu_bench.registers import Codes, Field, Register, Scalar, Until, Value, Vector, Wait, Write
from imu_bench.samples import Samples
from imu_bench.units import DEGREE, STANDARD_GRAVITY
import numpy as np

G = STANDARD_GRAVITY
FIFO_BYTES = 2048  # DS section 6.1; up to 2 packets more in the cache of the read port
RATES = {
    32000.0: 1, 16000.0: 2, 8000.0: 3, 4000.0: 4, 2000.0: 5, 1000.0: 6, 200.0: 7, 100.0: 8,
    50.0: 9, 25.0: 10, 12.5: 11, 500.0: 15,
}  # fmt: skip
"""DS section 14.36: the codes do not rise with the rate; 7 is 200 Hz, 500 Hz is 15."""

BANDWIDTHS = {
    'ODR/2': 0, 'ODR/4': 1, 'ODR/5': 2, 'ODR/8': 3, 'ODR/10': 4, 'ODR/16': 5, 'ODR/20': 6,
    'ODR/40': 7, 'low latency': 14, 'low latency x8': 15,
}  # fmt: skip
# 20 bits: full scale is 16 g and 2000 °/s whatever is set
ACCELERATION_20, ANGULAR_VELOCITY_20 = G / 32768, DEGREE / 262


class Iim42652(FifoDriver):
    """TDK InvenSense IIM-42652, FIFO bursts of 16 or 20 bits, through I²C or SPI."""

    # --- document and identity -----------------------------------------------------------
    name = 'iim42652'
    title = 'TDK InvenSense IIM-42652'
    document = 'DS-000401 rev. 1.2'
    bus_kinds = ('i2c', 'spi')
    data_ready_pin = 'INT1'
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # DS sections 9.3, 9.6
        '': Wiring(i2c_addresses=(0x68, 0x69), spi_max_hz=24_000_000),
    }

    # --- register map (DS section 13) ----------------------------------------------------
    DEVICE_CONFIG = Register(0x11, bank=0)
    DRIVE_CONFIG = Register(0x13, reset=0x05, bank=0)
    INT_CONFIG = Register(0x14, bank=0)
    FIFO_CONFIG = Register(0x16, bank=0)
    TEMP_DATA = Register(0x1D, reset=0x8000, access='ro', size=2, bank=0)
    ACCEL_DATA = Register(0x1F, reset=0x800080008000, access='ro', size=6, bank=0)
    GYRO_DATA = Register(0x25, reset=0x800080008000, access='ro', size=6, bank=0)
    TMST_FSYNC = Register(0x2B, access='ro', size=2, bank=0)
    INT_STATUS = Register(0x2D, reset=0x10, access='ro', bank=0, clear_on_read=True)
    FIFO_COUNT = Register(0x2E, access='ro', size=2, bank=0)
    FIFO_DATA = Register(0x30, reset=0xFF, access='ro', bank=0)
    INT_STATUS2 = Register(0x37, access='ro', bank=0, clear_on_read=True)
    INT_STATUS3 = Register(0x38, access='ro', bank=0, clear_on_read=True)
    SIGNAL_PATH_RESET = Register(0x4B, bank=0)
    INTF_CONFIG0 = Register(0x4C, reset=0x30, bank=0)
    INTF_CONFIG1 = Register(0x4D, reset=0x91, bank=0)
    PWR_MGMT0 = Register(0x4E, bank=0)
    GYRO_CONFIG0 = Register(0x4F, reset=0x06, bank=0)
    ACCEL_CONFIG0 = Register(0x50, reset=0x06, bank=0)
    GYRO_CONFIG1 = Register(0x51, reset=0x16, bank=0)
    GYRO_ACCEL_CONFIG0 = Register(0x52, reset=0x11, bank=0)
    ACCEL_CONFIG1 = Register(0x53, reset=0x0D, bank=0)
    TMST_CONFIG = Register(0x54, reset=0x23, bank=0)
    FIFO_CONFIG1 = Register(0x5F, bank=0)
    FIFO_CONFIG2 = Register(0x60, bank=0)
    FIFO_CONFIG3 = Register(0x61, bank=0)
    FSYNC_CONFIG = Register(0x62, reset=0x10, bank=0)
    INT_CONFIG0 = Register(0x63, bank=0)
    INT_CONFIG1 = Register(0x64, reset=0x10, bank=0)
    INT_SOURCE0 = Register(0x65, reset=0x10, bank=0)
    INT_SOURCE1 = Register(0x66, bank=0)
    INT_SOURCE3 = Register(0x68, bank=0)
    INT_SOURCE4 = Register(0x69, bank=0)
    FIFO_LOST_PKT = Register(0x6C, access='ro', size=2, order='little', bank=0)
    SELF_TEST_CONFIG = Register(0x70, bank=0)
    WHO_AM_I = Register(0x75, reset=0x6F, access='ro', bank=0)
    REG_BANK_SEL = Register(0x76)
    SENSOR_CONFIG0 = Register(0x03, reset=0x80, bank=1)
    GYRO_CONFIG_STATIC2 = Register(0x0B, reset=0xA0, bank=1)
    GYRO_CONFIG_STATIC3 = Register(0x0C, reset=0x0D, bank=1)
    GYRO_CONFIG_STATIC4 = Register(0x0D, reset=0xAA, bank=1)
    GYRO_CONFIG_STATIC5 = Register(0x0E, reset=0x80, bank=1)
    GYRO_NOTCH = Register(0x0F, reset=None, size=5, bank=1)
    TMSTVAL = Register(0x62, access='ro', size=3, order='little', bank=1)
    INTF_CONFIG4 = Register(0x7A, reset=0x03, bank=1)
    INTF_CONFIG5 = Register(0x7B, reset=0x20, bank=1)
    INTF_CONFIG6 = Register(0x7C, reset=0x5F, bank=1)
    ACCEL_CONFIG_STATIC2 = Register(0x03, reset=0x30, bank=2)
    ACCEL_CONFIG_STATIC3 = Register(0x04, reset=0x40, bank=2)
    ACCEL_CONFIG_STATIC4 = Register(0x05, reset=0x62, bank=2)
    OFFSET_USER = Register(0x77, size=9, bank=4)

    # --- fields and codes ----------------------------------------------------------------
    soft_reset = Field(DEVICE_CONFIG, 0, self_clearing=True)
    fifo_mode = Field(FIFO_CONFIG, (7, 6), Codes({'bypass': 0, 'stream': 1, 'stop': 2},
                      aliases={3: ('stop', 'DS section 14.4: 10 and 11')}))  # fmt: skip
    pll_ready = Field(INT_STATUS, 5)
    reset_done = Field(INT_STATUS, 4)
    data_ready = Field(INT_STATUS, 3)
    fifo_threshold = Field(INT_STATUS, 2)
    fifo_full = Field(INT_STATUS, 1)
    fifo_flush = Field(SIGNAL_PATH_RESET, 1, self_clearing=True)
    hold_last_data = Field(INTF_CONFIG0, 7)
    count_unit = Field(INTF_CONFIG0, 6, Codes({'bytes': 0, 'records': 1}))
    count_big_endian = Field(INTF_CONFIG0, 5)
    data_big_endian = Field(INTF_CONFIG0, 4)
    # in no document; users found it (ArduPilot, issue 25025)
    adaptive_full_scale = Field(INTF_CONFIG1, (7, 6), Codes({True: 2, False: 1}))
    temperature_off = Field(PWR_MGMT0, 5)
    gyroscope_mode = Field(PWR_MGMT0, (3, 2), Codes({'off': 0, 'standby': 1, 'low noise': 3}))
    accelerometer_mode = Field(
        PWR_MGMT0,
        (1, 0),
        Codes(
            {'off': 0, 'low power': 2, 'low noise': 3},
            aliases={1: ('off', 'DS section 14.34: 00 and 01')},
        ),
    )
    # fmt: off
    gyroscope_range = Field(
        GYRO_CONFIG0, (7, 5),
        Codes({2000.0: 0, 1000.0: 1, 500.0: 2, 250.0: 3, 125.0: 4, 62.5: 5, 31.25: 6, 15.625: 7}),
        '°/s')
    gyroscope_rate = Field(GYRO_CONFIG0, (3, 0), Codes(RATES), 'Hz')
    accelerometer_range = Field(
        ACCEL_CONFIG0, (7, 5), Codes({16.0: 0, 8.0: 1, 4.0: 2, 2.0: 3}), 'g')
    accelerometer_rate = Field(
        ACCEL_CONFIG0, (3, 0), Codes({**RATES, 6.25: 12, 3.125: 13, 1.5625: 14}), 'Hz')
    gyroscope_order = Field(GYRO_CONFIG1, (3, 2), Codes({1: 0, 2: 1, 3: 2}))
    accelerometer_order = Field(ACCEL_CONFIG1, (4, 3), Codes({1: 0, 2: 1, 3: 2}))
    accelerometer_bandwidth = Field(GYRO_ACCEL_CONFIG0, (7, 4), Codes(BANDWIDTHS))
    gyroscope_bandwidth = Field(GYRO_ACCEL_CONFIG0, (3, 0), Codes(BANDWIDTHS))
    # fmt: on
    timestamp_tick = Field(TMST_CONFIG, 3, Codes({1: 0, 16: 1}), 'µs')
    timestamp_on = Field(TMST_CONFIG, 0)
    fifo_bits = Field(FIFO_CONFIG1, 4, Codes({16: 0, 20: 1}))
    fifo_timestamp = Field(FIFO_CONFIG1, 3)
    fifo_temperature = Field(FIFO_CONFIG1, 2)
    fifo_gyroscope = Field(FIFO_CONFIG1, 1)
    fifo_accelerometer = Field(FIFO_CONFIG1, 0)
    interrupt_push_pull = Field(INT_CONFIG, 1)
    interrupt_active_high = Field(INT_CONFIG, 0)
    data_ready_interrupt = Field(INT_SOURCE0, 3)
    short_pulse = Field(INT_CONFIG1, 6)
    no_deassertion = Field(INT_CONFIG1, 5)
    asynchronous_reset = Field(INT_CONFIG1, 4)
    i3c = Field(INTF_CONFIG6, (1, 0))

    identities = (
        Identity(WHO_AM_I, {0x6F: 'TDK InvenSense IIM-42652'},
                 {0x47: 'ICM-42688-P', 0x42: 'ICM-42605'}),
    )  # fmt: skip

    # --- channels (DS tables 1 to 4) -----------------------------------------------------
    # fmt: off
    acceleration = Vector(
        first=ACCEL_DATA, quantity='acceleration', unit='m/s²', dtype='>i2',
        scaled_by=accelerometer_range, limits=(-32766, 32767),
        si_per_lsb={16.0: G / 2048, 8.0: G / 4096, 4.0: G / 8192, 2.0: G / 16384},
    )
    angular_velocity = Vector(
        first=GYRO_DATA, quantity='angular_velocity', unit='rad/s', dtype='>i2',
        scaled_by=gyroscope_range, limits=(-32766, 32767),
        si_per_lsb={2000.0: DEGREE / 16.4, 1000.0: DEGREE / 32.8, 500.0: DEGREE / 65.5,
                    250.0: DEGREE / 131, 125.0: DEGREE / 262, 62.5: DEGREE / 524.3,
                    31.25: DEGREE / 1048.6, 15.625: DEGREE / 2097.2},
    )
    temperature = Scalar(
        first=TEMP_DATA, quantity='temperature', unit='°C', dtype='>i2',
        si_per_lsb=1 / 132.48, offset=25.0,
    )

    # --- settings ------------------------------------------------------------------------
    settings = (
        Setting('rate_hz', 500.0, 'Output data rate of both.', tuple(sorted(RATES)), unit='Hz'),
        choice('accelerometer_range', accelerometer_range, 16.0, 'Full scale.'),
        choice('gyroscope_range', gyroscope_range, 2000.0, 'Full scale.'),
        choice('accelerometer_bandwidth', accelerometer_bandwidth, 'ODR/4',
               'Low-pass; below 400 Hz as at 400 Hz, but for ODR/2.'),
        choice('gyroscope_bandwidth', gyroscope_bandwidth, 'ODR/4',
               'Low-pass; below 400 Hz as at 400 Hz, but for ODR/2.'),
        choice('accelerometer_order', accelerometer_order, 2, 'Order of its low-pass.'),
        choice('gyroscope_order', gyroscope_order, 2, 'Order of its low-pass.'),
        choice('adaptive_full_scale', adaptive_full_scale, True,
               'As after a reset; without, the gyroscope may no more stand still for 2 ms near '
               '100 °/s, as users found. In no document.'),
        choice('fifo_bits', fifo_bits, 16, 'Bits per sample; 20 at 16 g and 2000 °/s only.'),
    )
    # fmt: on
    counter_names = ('packets_lost', 'header_errors', 'invalid')

    # --- sequences (DS section 12) -------------------------------------------------------
    reset_steps = (
        Write({soft_reset: 1}),
        Wait(0.001, 'DS section 14.1'),
        Until(reset_done, 1, 1.0),
    )
    power_steps = (
        Write({gyroscope_mode: 'low noise', accelerometer_mode: 'low noise'}),
        Wait(0.06, 'gyroscope 45 ms, DS table 1; the driver of the maker discards 60 ms'),
    )
    start_steps = (
        Write({fifo_mode: 'stream'}),
        Write({fifo_flush: 1}),
        Wait(0.001, 'no time given; as PX4'),
    )
    stop_steps = (Write({fifo_mode: 'bypass'}),)

    # --- typical values (DS tables 1, 2, 4) ----------------------------------------------
    # fmt: off
    typical: ClassVar[Mapping[str, Typical]] = {
        'acceleration': Typical(
            'DS-000401 rev. 1.2 table 2', noise_density=70e-6 * G, bandwidth=115.3, range=16 * G,
            resolution=G / 2048, bias=0.02 * G, bias_per_kelvin=0.15e-3 * G, scale_error=0.005,
            scale_per_kelvin=0.005e-2, nonlinearity=0.001, cross_axis=0.01),
        'angular_velocity': Typical(
            'DS-000401 rev. 1.2 table 1', noise_density=0.0038 * DEGREE, bandwidth=115.3,
            range=2000 * DEGREE, resolution=DEGREE / 16.4, bias=0.5 * DEGREE,
            bias_per_kelvin=0.02 * DEGREE, scale_error=0.005, scale_per_kelvin=0.005e-2,
            nonlinearity=0.001, cross_axis=0.0125),
        'temperature': Typical('DS-000401 rev. 1.2 table 4', resolution=1 / 132.48, bias=5.0),
    }

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        Witness(acceleration, '000000000800', (0, 0, 9.80665), 'DS: 2048 LSB/g', 16.0),
        Witness(acceleration, '000010000000', (0, 9.80665, 0), 'DS: 4096 LSB/g', 8.0),
        Witness(acceleration, 'f00000000000', (-4.903325, 0, 0), '-4096 of 8192 LSB/g', 4.0),
        Witness(acceleration, '000000004000', (0, 0, 9.80665), 'DS: 16384 LSB/g', 2.0),
        Witness(angular_velocity, '00a400000000', (0.174533, 0, 0), '164 LSB = 10 °/s', 2000.0),
        Witness(angular_velocity, '0000ff5c0000', (0, -0.0872665, 0), '32.8 LSB/(°/s)', 1000.0),
        Witness(angular_velocity, '000000000083', (0, 0, 0.0349066), '131 of 65.5', 500.0),
        Witness(angular_velocity, '008300000000', (0.0174533, 0, 0), '131 LSB/(°/s)', 250.0),
        Witness(angular_velocity, '010600000000', (0.0174533, 0, 0), '262 LSB/(°/s)', 125.0),
        Witness(angular_velocity, '147b00000000', (0.174533, 0, 0), '5243 of 524.3', 62.5),
        Witness(angular_velocity, '28f600000000', (0.174533, 0, 0), '10486 of 1048.6', 31.25),
        Witness(angular_velocity, '51ec00000000', (0.174533, 0, 0), '20972 of 2097.2', 15.625),
        Witness(temperature, '052d', (35.0,), 'DS section 4.13: 1325/132.48 + 25'),
        Witness(temperature, 'fd6a', (20.0,), 'DS section 4.13: -662/132.48 + 25'),
    )
    # fmt: on

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        self._bits = int(self.values['fifo_bits'])
        self._packet_bytes = fifo_packets.PACKETS[self._bits].itemsize
        self.depth = FIFO_BYTES // self._packet_bytes
        # 16 bits of 1 µs wrap before a sample at 12.5 Hz is over
        self._tick_us = 1 if self.rate_hz >= 500.0 else 16
        self._continuity = fifo_packets.Continuity(self.rate_hz, self._tick_us)

    @classmethod
    def check_settings(cls, given: Mapping[str, object]) -> dict[str, Value]:
        """Return every setting; 20 bits have one range only."""
        values = super().check_settings(given)
        ranges = (values['accelerometer_range'], values['gyroscope_range'])
        if values['fifo_bits'] == 20 and ranges != (16.0, 2000.0):
            raise ConfigError(
                f'{cls.name}.fifo_bits: 20 means accelerometer_range: 16.0 and gyroscope_range: '
                f'2000.0; they are {ranges[0]:g} and {ranges[1]:g}'
            )
        return values

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        """Return the registers with their banks."""
        self._banks = BankedBus(wires[''], self.REG_BANK_SEL.address)
        return {'': self._banks}

    def assignments(self) -> dict[Any, Value]:
        """Return the settings, and what the stream needs."""
        fast = int(self.rate_hz >= 4000.0)  # DS section 14.50: both bits from 4 kHz on
        wired = int(self.edges is not None)
        return {
            self.i3c: 0,
            self.hold_last_data: 0,
            self.count_unit: 'bytes',
            self.count_big_endian: 1,
            self.data_big_endian: 1,
            **super().assignments(),
            **dict.fromkeys((self.gyroscope_rate, self.accelerometer_rate), self.rate_hz),
            self.timestamp_tick: self._tick_us,
            self.timestamp_on: 1,
            **dict.fromkeys((self.fifo_timestamp, self.fifo_temperature), 1),
            **dict.fromkeys((self.fifo_gyroscope, self.fifo_accelerometer), 1),
            **dict.fromkeys((self.short_pulse, self.no_deassertion), fast),
            self.asynchronous_reset: 0,
            **dict.fromkeys((self.interrupt_push_pull, self.interrupt_active_high), wired),
            self.data_ready_interrupt: wired,
        }

    def configure(self) -> None:
        """Reset, check the identity, configure, read back; then switch the sensors on."""
        self._banks.forget()
        super().configure()

    def configure_parts(self) -> None:
        """Switch both sensors on, last of all (DS section 12.9)."""
        self.registers.run(self.power_steps)
        self.registers.verify(self.power_steps[0].values)

    def start(self) -> None:
        """Let packets flow into an empty FIFO."""
        super().start()
        self.registers.word(self.INT_STATUS)
        self._continuity.restart()

    def read(self) -> list[Samples]:
        """Return everything new; nothing that was in the FIFO when it ran over."""
        if self.torn or not self.configured:
            self.restart()
        head, latched = self.latch(self.INT_STATUS, 1 + self.FIFO_COUNT.size)
        status, count = head[0], self.FIFO_COUNT.unpack(head[1:])
        self.check_level(self.FIFO_COUNT, count, FIFO_BYTES + 2 * self._packet_bytes)
        self.torn = True  # until the burst has been taken out whole
        if status & self.reset_done.mask:
            self.restart()
            return []
        if status & self.fifo_full.mask or count > FIFO_BYTES - self._packet_bytes:
            return self._overflow()
        packets = self._burst(count // self._packet_bytes)
        if not self._continuity.take(packets['timestamp']):
            return self._overflow()
        self.torn = False
        return self._samples(packets, latched)

    def _overflow(self) -> list[Samples]:
        """Empty the FIFO and begin anew."""
        self.counters['fifo_overflows'] += 1
        self.counters['packets_lost'] += self.registers.word(self.FIFO_LOST_PKT)
        self.start()
        return []

    def _burst(self, n: int) -> np.ndarray:
        data = self.registers.burst(self.FIFO_DATA, n * self._packet_bytes) if n else b''
        try:
            return fifo_packets.unpack(data, self._bits)
        except FrameError as error:
            self.counters['header_errors'] += 1
            name = self._wires[''].name
            raise FrameError(f'{name}: {error}; the FIFO will be emptied') from error

    def _samples(self, packets: np.ndarray, latched: int) -> list[Samples]:
        stamps = self.stamps(latched, len(packets))
        invalid = fifo_packets.invalid(packets)
        if invalid.any():
            self.counters['invalid'] += int(invalid.sum())
            self.continuity += 1
            self.edge = None
            packets, stamps = packets[~invalid], stamps[~invalid]
        if not len(packets):
            return []
        columns = self._decoded(packets)
        # the FIFO has 8 bits of the temperature only
        word = np.frombuffer(self.registers.burst(self.TEMP_DATA), dtype='>i2')
        measured = word[0] != fifo_packets.INVALID
        temperature = np.repeat(self.temperature.decode(word), len(stamps)) if measured else None
        return [Samples(stamps, **columns, temperature=temperature)]

    def _decoded(self, packets: np.ndarray) -> dict[str, np.ndarray]:
        """Return acceleration and angular velocity in SI; count the samples at a limit."""
        if self._bits == 16:
            return self.decode(packets, self.acceleration, self.angular_velocity)
        fine, turn = fifo_packets.words_20(packets)
        largest = np.maximum(np.abs(fine), np.abs(turn)).max(axis=1)
        self.counters['saturated'] += int((largest >= fifo_packets.LIMIT_20).sum())
        return {
            'acceleration': fine * ACCELERATION_20,
            'angular_velocity': turn * ANGULAR_VELOCITY_20,
        }
