# SPDX-License-Identifier: Apache-2.0
"""
Bosch BNO055: accelerometer, gyroscope, magnetometer, and fusion of its own.

Document: BST-BNO055-DS000-12 rev. 1.2 (DS).  Neither FIFO nor counter, and no data-ready in the
document's firmware: see `PolledDriver`.  The phase of a sample is uncertain by a period.

It stretches the clock of I²C after every byte, which a Raspberry Pi handles wrongly: bytes get
corrupted.  What no BNO055 sends is refused; use the serial line or a software bus (i2c-gpio).
Some hang after a software reset (dotnet/iot, issue 777): registers are written back instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NoReturn

from imu_bench.bus.banked import BankedBus
from imu_bench.bus.calibration_profile import CalibrationProfile
from imu_bench.bus.interface import ByteStream, Clock, RegisterBus
from imu_bench.bus.plausible import plausible
from imu_bench.bus.uart_registers import UartRegisters
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, Identity, PolledDriver, Setting, Typical, Witness
from imu_bench.errors import ConfigError, FrameError, NoAnswer, NotReady
from imu_bench.registers import (
    Channel,
    Codes,
    Field,
    Frame,
    Quaternion,
    Register,
    Scalar,
    Until,
    Value,
    Vector,
    Wait,
    Write,
)
from imu_bench.samples import Samples
from imu_bench.units import DEGREE, STANDARD_GRAVITY
import numpy as np

G = STANDARD_GRAVITY
PLAIN_HZ = 100.0  # DS does not say how often the registers are written without fusion: assumed
HOUSEKEEPING_NS = 1_000_000_000
SPECIFIED = 'BST-BNO055-DS000-12 section 1.2'
# per byte, on one scope: Bosch community, "BNO055 / Minimum I2C communication interval"
STRETCH_S = 180e-6
UNIT_NORM = 2**14  # of the fused quaternion

# DS tables 3-3 and 3-5: what is measured in a mode, and the rates of those with fusion in Hz
MEASURED = {
    'acconly': 'A', 'gyronly': 'G', 'accmag': 'AM', 'accgyro': 'AG', 'maggyro': 'MG', 'amg': 'AMG',
    'imu': 'AG', 'compass': 'AM', 'm4g': 'AM', 'ndof_fmc_off': 'AMG', 'ndof': 'AMG',
}  # fmt: skip
FUSED_HZ = {'imu': 100.0, 'compass': 20.0, 'm4g': 50.0, 'ndof_fmc_off': 100.0, 'ndof': 100.0}
FIELD_HZ = {'compass': 20.0, 'm4g': 50.0, 'ndof_fmc_off': 20.0, 'ndof': 20.0}


class Bno055(PolledDriver):
    """Bosch BNO055, polled, through I²C or a serial line."""

    # --- document and identity -----------------------------------------------------------
    name = 'bno055'
    title = 'Bosch BNO055'
    document = 'BST-BNO055-DS000-12 rev. 1.2'
    reset_pin = 'nRESET'
    bus_kinds = ('i2c', 'serial')
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # DS section 4.6: 0x28 with COM3 low, as on most boards; section 4.7 the serial line
        '': Wiring(i2c_addresses=(0x28, 0x29), i2c_stretch_s=STRETCH_S, serial_baud=115_200),
    }
    start_up_s = 0.45  # DS table 0-2: 400 ms to CONFIG

    # --- register map (DS sections 4.2.1, 4.2.2) -----------------------------------------
    CHIP_ID = Register(0x00, access='ro', reset=0xA0, bank=0)
    ACC_MAG_GYR_ID = Register(0x01, access='ro', reset=0xFB320F, size=3, bank=0)
    SW_REV_ID = Register(0x04, access='ro', reset=0x0308, size=2, order='little', bank=0)
    PAGE_ID = Register(0x07)
    ACC_DATA = Register(0x08, access='ro', size=6, order='little', bank=0)
    MAG_DATA = Register(0x0E, access='ro', size=6, order='little', bank=0)
    GYR_DATA = Register(0x14, access='ro', size=6, order='little', bank=0)
    EUL_DATA = Register(0x1A, access='ro', size=6, order='little', bank=0)
    QUA_DATA = Register(0x20, access='ro', size=8, order='little', bank=0)
    LIA_DATA = Register(0x28, access='ro', size=6, order='little', bank=0)
    GRV_DATA = Register(0x2E, access='ro', size=6, order='little', bank=0)
    TEMP = Register(0x34, access='ro', bank=0)
    CALIB_STAT = Register(0x35, access='ro', bank=0)
    ST_RESULT = Register(0x36, access='ro', reset=0x0F, bank=0)
    SYS_CLK_STATUS = Register(0x38, access='ro', bank=0)
    SYS_STATUS = Register(0x39, access='ro', bank=0)
    SYS_ERR = Register(0x3A, access='ro', bank=0)
    UNIT_SEL = Register(0x3B, reset=0x80, bank=0)
    # DS prints 0x1C for OPR_MODE, and that CONFIG is the mode after reset
    OPR_MODE = Register(0x3D, reset=0x10, bank=0)
    PWR_MODE = Register(0x3E, bank=0)
    SYS_TRIGGER = Register(0x3F, access='wo', bank=0)
    AXIS_MAP_CONFIG = Register(0x41, reset=0x24, bank=0)
    AXIS_MAP_SIGN = Register(0x42, bank=0)
    OFFSETS = Register(0x55, size=18, order='little', bank=0)
    RADII = Register(0x67, size=4, order='little', bank=0)
    ACC_CONFIG = Register(0x08, reset=0x0D, bank=1)
    # DS prints 0x6D in the map; its description and section 3.5 have 0x0B
    MAG_CONFIG = Register(0x09, reset=0x0B, bank=1)
    GYR_CONFIG_0 = Register(0x0A, reset=0x38, bank=1)
    GYR_CONFIG_1 = Register(0x0B, bank=1)

    # --- fields and codes ----------------------------------------------------------------
    # fmt: off
    mode = Field(OPR_MODE, (3, 0), Codes({
        'config': 0, 'acconly': 1, 'magonly': 2, 'gyronly': 3, 'accmag': 4, 'accgyro': 5,
        'maggyro': 6, 'amg': 7, 'imu': 8, 'compass': 9, 'm4g': 10, 'ndof_fmc_off': 11,
        'ndof': 12}))
    power_mode = Field(PWR_MODE, (1, 0), Codes({'normal': 0, 'low power': 1, 'suspend': 2}))
    external_clock = Field(SYS_TRIGGER, 7)
    reset_system = Field(SYS_TRIGGER, 5)
    chip = Field(CHIP_ID, (7, 0))
    clock_busy = Field(SYS_CLK_STATUS, 0)
    accelerometer_range = Field(ACC_CONFIG, (1, 0), Codes({2.0: 0, 4.0: 1, 8.0: 2, 16.0: 3}), 'g')
    accelerometer_bandwidth = Field(ACC_CONFIG, (4, 2), Codes({
        7.81: 0, 15.63: 1, 31.25: 2, 62.5: 3, 125.0: 4, 250.0: 5, 500.0: 6, 1000.0: 7}), 'Hz')
    accelerometer_power = Field(ACC_CONFIG, (7, 5))
    gyroscope_range = Field(GYR_CONFIG_0, (2, 0), Codes({
        2000.0: 0, 1000.0: 1, 500.0: 2, 250.0: 3, 125.0: 4}), '°/s')
    gyroscope_bandwidth = Field(GYR_CONFIG_0, (5, 3), Codes({
        523.0: 0, 230.0: 1, 116.0: 2, 47.0: 3, 23.0: 4, 12.0: 5, 64.0: 6, 32.0: 7}), 'Hz')
    gyroscope_power = Field(GYR_CONFIG_1, (2, 0))
    magnetometer_rate_hz = Field(MAG_CONFIG, (2, 0), Codes({
        2.0: 0, 6.0: 1, 8.0: 2, 10.0: 3, 15.0: 4, 20.0: 5, 25.0: 6, 30.0: 7}), 'Hz')
    magnetometer_mode = Field(MAG_CONFIG, (4, 3), Codes({
        'low power': 0, 'regular': 1, 'enhanced': 2, 'high accuracy': 3}))
    magnetometer_power = Field(MAG_CONFIG, (6, 5))
    calibrated_system = Field(CALIB_STAT, (7, 6))
    calibrated_gyroscope = Field(CALIB_STAT, (5, 4))
    calibrated_accelerometer = Field(CALIB_STAT, (3, 2))
    calibrated_magnetometer = Field(CALIB_STAT, (1, 0))
    state = Field(SYS_STATUS, (2, 0), Codes({
        'idle': 0, 'error': 1, 'initialising peripherals': 2, 'initialising': 3, 'self-test': 4,
        'fusion': 5, 'no fusion': 6}))
    error = Field(SYS_ERR, (3, 0), Codes({
        'none': 0, 'peripheral initialisation': 1, 'system initialisation': 2, 'self-test': 3,
        'register value out of range': 4, 'register address out of range': 5,
        'register write': 6, 'low power not available in this mode': 7,
        'accelerometer power mode not available': 8, 'fusion configuration': 9,
        'sensor configuration': 10}))

    identities = (
        Identity(CHIP_ID, {0xA0: 'Bosch BNO055'}),
        Identity(ACC_MAG_GYR_ID, {0xFB320F: 'accelerometer, magnetometer and gyroscope'}))

    # --- channels (DS section 3.6) -------------------------------------------------------
    acceleration = Vector(  # 14 bit of the range, whatever the LSB
        first=ACC_DATA, quantity='acceleration', unit='m/s²', dtype='<i2',
        scaled_by=accelerometer_range, si_per_lsb=dict.fromkeys((2.0, 4.0, 8.0, 16.0), 0.01),
        limits={2.0: (-1961, 1961), 4.0: (-3923, 3922), 8.0: (-7845, 7844),
                16.0: (-15691, 15689)})
    magnetic_field = Vector(
        first=MAG_DATA, quantity='magnetic_field', unit='T', dtype='<i2', si_per_lsb=1e-6 / 16)
    angular_velocity = Vector(  # with fusion
        first=GYR_DATA, quantity='angular_velocity', unit='rad/s', dtype='<i2',
        si_per_lsb=DEGREE / 16, limits=(-32000, 32000))
    # without, range/2^15 (torvalds/linux bno055.c, 2c1ed907520c; DFRobot_BNO055, issue 7)
    angular_velocity_plain = Vector(
        first=GYR_DATA, quantity='angular_velocity', unit='rad/s', dtype='<i2',
        si_per_lsb=DEGREE * 2000 / 2**15)
    orientation = Quaternion(  # of which world frame DS does not say
        first=QUA_DATA, quantity='orientation', unit='1', dtype='<i2', si_per_lsb=1 / UNIT_NORM)
    temperature = Scalar(first=TEMP, quantity='temperature', unit='°C', dtype='i1', si_per_lsb=1.0)

    # --- settings ------------------------------------------------------------------------
    settings = (
        Setting('mode', 'ndof', 'Operation mode; those with fusion are filtered and corrected by '
                'the chip, compare other sensors with amg.', tuple(MEASURED)),
        Setting('rate_hz', 100.0, "Rate at which the mode's registers change; without fusion it "
                'is not in the document, 100 Hz assumed.', (100.0, 50.0, 20.0), unit='Hz'),
        choice('accelerometer_range', accelerometer_range, 4.0, 'Full scale.'),
        choice('accelerometer_bandwidth', accelerometer_bandwidth, 62.5, 'Low-pass, -3 dB.'),
        choice('gyroscope_bandwidth', gyroscope_bandwidth, 32.0, 'Low-pass; set by fusion.'),
        choice('magnetometer_rate_hz', magnetometer_rate_hz, 20.0, 'Rate; set by fusion.'),
        choice('magnetometer_mode', magnetometer_mode, 'regular', 'Noise; set by fusion.'),
        Setting('external_crystal', False, 'A crystal of 32 kHz is fitted; use it.'),
        Setting('calibration_file', '', 'Offsets that fusion has found: restored at every start; '
                'if there is no such file it is written once all is calibrated.'),
    )
    counter_names = ('implausible', 'system_errors', 'uncalibrated',
                     'uart_errors', 'garbage_bytes')
    # fmt: on

    # --- sequences (DS sections 3.3, 4.3.57 to 4.3.61) -----------------------------------
    stop_steps = (Write({mode: 'config'}), Wait(0.025, 'DS table 3-6: 19 ms'))
    reset_steps = (  # back to the values of a reset, as dotnet/iot does (pull request 814)
        *stop_steps,
        Write({PAGE_ID: 0, power_mode: 'normal', OFFSETS: 0, SYS_TRIGGER: 0}),
        Wait(0.01, 'drivers wait so long'),
        Until(clock_busy, 0, 2.0),
    )
    system_reset_steps = Write({reset_system: 1}), Wait(0.65, 'table 0-2'), Until(chip, 0xA0, 1.0)
    crystal_steps = (Write({external_clock: 1}), Until(clock_busy, 0, 2.0))

    # --- typical values (DS section 1.2) -------------------------------------------------
    typical: ClassVar[Mapping[str, Typical]] = {
        'acceleration': Typical(
            SPECIFIED, noise_density=150e-6 * G, bandwidth=62.5, range=4 * G, resolution=0.01,
            bias=0.08 * G, bias_per_kelvin=1e-3 * G, scale_error=0.01, scale_per_kelvin=0.03e-2,
            nonlinearity=0.005, cross_axis=0.01),
        'angular_velocity': Typical(
            SPECIFIED, noise_density=0.014 * DEGREE, bandwidth=32.0, range=2000 * DEGREE,
            resolution=DEGREE / 16, bias=DEGREE, bias_per_kelvin=0.015 * DEGREE, cross_axis=0.01,
            scale_error=0.01, scale_per_kelvin=0.03e-2),
        # 0.6 µT rms (regular), taken as white at 20 Hz
        'magnetic_field': Typical(
            SPECIFIED, noise_density=0.6e-6 / 10**0.5, range=1300e-6, bias=2e-6,
            resolution=1e-6 / 16, bias_per_kelvin=0.23e-6, scale_error=0.05),
        'temperature': Typical('BST-BNO055-DS000-12 section 3.6.5.8', resolution=1.0),
    }  # fmt: skip

    # --- witnesses -----------------------------------------------------------------------
    # fmt: off
    witnesses = (
        Witness(acceleration, 'd50300000000', (9.81, 0, 0), 'DS: 100 LSB per m/s²', 2.0),
        Witness(acceleration, '0000d5030000', (0, 9.81, 0), 'DS: 100 LSB per m/s²', 4.0),
        Witness(acceleration, '00000000d503', (0, 0, 9.81), 'DS: 100 LSB per m/s²', 8.0),
        Witness(acceleration, '2bfc00000000', (-9.81, 0, 0), 'DS: 100 LSB per m/s²', 16.0),
        Witness(angular_velocity, 'a0000000f0ff', (0.174533, 0, -0.0174533), 'DS: 16 LSB per °/s'),
        Witness(angular_velocity_plain, 'a40000005cff', (0.174703, 0, -0.174703), 'Linux'),
        Witness(magnetic_field, 'd00230fd0000', (45e-6, -45e-6, 0), 'DS: 16 LSB per µT'),
        Witness(orientation, '002d0000000000d3', (0, 0, -0.703125, 0.703125), 'DS: 2^14 LSB'),
        Witness(temperature, '19', (25.0,), 'DS: 1 LSB per °C'),
    )
    # fmt: on

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        mode = str(self.values['mode'])
        self._fused = mode in FUSED_HZ
        fixed: dict[str, object] = {'rate_hz': FUSED_HZ.get(mode, PLAIN_HZ)}
        if self._fused:
            fixed |= {'accelerometer_bandwidth': 62.5, 'gyroscope_bandwidth': 32.0}
        fixed |= {'magnetometer_mode': 'regular'} if self._fused else {'calibration_file': ''}
        if FIELD_HZ.get(mode) in self.magnetometer_rate_hz.allowed:
            fixed['magnetometer_rate_hz'] = FIELD_HZ[mode]
        for name, value in fixed.items():
            if self.values[name] != value:
                only = f'{value:g} Hz' if isinstance(value, float) else value or 'none'
                raise ConfigError(f'{self.name}.{name}: mode {mode} has {only} and no other')
        kept, places = str(self.values['calibration_file']), (self.OFFSETS, self.RADII)
        self._profile = CalibrationProfile(kept, self.registers, *places)
        fields = {'A': self.calibrated_accelerometer, 'G': self.calibrated_gyroscope,
                  'M': self.calibrated_magnetometer}  # fmt: skip
        self._calibrated = sum(fields[letter].mask for letter in MEASURED[mode])
        force, field = self.acceleration, self.magnetic_field
        turn = self.angular_velocity if self._fused else self.angular_velocity_plain
        letters = ((force, 'A'), (turn, 'G'))
        self._measured = {c.quantity: c for c, letter in letters if letter in MEASURED[mode]}
        self.rates_hz = {'temperature': 1.0}
        if 'M' in MEASURED[mode]:
            as_set = float(self.values['magnetometer_rate_hz'])
            self.rates_hz['magnetic_field'] = FIELD_HZ.get(mode, as_set)
        self._compared = [*self._measured, *(['orientation'] if self._fused else [])]
        self._full = float(self.values['accelerometer_range']) * G / 0.01
        self._frame = Frame(force, field, turn, *((self.orientation,) if self._fused else ()))
        self._field, self._in_error, self._begun_ns, self._kept_ns = b'', False, 0, 0

    @classmethod
    def channels(cls) -> dict[str, Channel]:
        return {n: c for n, c in super().channels().items() if c is not cls.angular_velocity_plain}

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        wire, silent, self._uart = wires[''], (self.SYS_TRIGGER.address,), None
        if isinstance(wire, ByteStream):
            wire = self._uart = UartRegisters(wire, self.clock, self.counters, silent)
        self._pages = BankedBus(wire, self.PAGE_ID.address)
        return {'': self._pages}

    def assignments(self) -> dict[Any, Value]:
        """Return units, range and, without fusion, filters; the mode is set last."""
        chosen = super().assignments()
        del chosen[self.mode]
        if self._fused:
            chosen = {self.accelerometer_range: chosen[self.accelerometer_range]}
        else:
            chosen[self.gyroscope_range] = 2000.0
            powers = self.accelerometer_power, self.gyroscope_power, self.magnetometer_power
            chosen |= dict.fromkeys(powers, 0)
        # m/s², °/s, °C; axes as on the package
        return {self.UNIT_SEL: 0x80, self.AXIS_MAP_CONFIG: 0x24, self.AXIS_MAP_SIGN: 0, **chosen}

    def identify(self) -> str:
        part, number = super().identify(), self.registers.word(self.SW_REV_ID)
        return f'{part}, firmware {number >> 8:x}.{number & 0xFF:02x}'

    def configure(self) -> None:
        """Reset after an error only; check identity and self-test, write, read back, compare."""
        self._pages.forget()
        reset, self._in_error = self._in_error, self.reset_line is not None
        if reset and not self.pull_reset(self.system_reset_steps[1:]):
            try:
                self.registers.run((*self.stop_steps, *self.system_reset_steps))
            except NoAnswer as error:
                advice = 'some BNO055 hang after a reset: switch it off and on, or set reset_line'
                raise NoAnswer(f'{error}; {advice}') from error
        super().configure()
        self._in_error = False

    def configure_parts(self) -> None:
        passed = self.registers.word(self.ST_RESULT)
        if passed & 0x0F != 0x0F:
            self._give_up(f'self-test 0x{passed:X} of 0xF; from bit 0: acc, mag, gyro, processor')
        if self.values['external_crystal']:
            self.registers.run(self.crystal_steps)
        self._profile.restore()

    def start(self) -> None:
        self.registers.write({self.mode: self.values['mode']})
        self.clock.sleep(0.01)  # DS table 3-6: 7 ms from CONFIG
        super().start()
        if not self._housekeeping(self.clock.now_ns()):
            self._give_up(f'does not run in mode {self.values["mode"]}')
        self._field, self._begun_ns = b'', self.clock.now_ns()

    def restart(self) -> None:
        """Start again; a chip that is in another mode was without power."""
        if self.configured and self.registers.read(self.mode) != self.values['mode']:
            self.counters['brown_outs'] += 1
            self.configured = False
        super().restart()

    def _give_up(self, reason: str) -> NoReturn:
        self.counters['system_errors'] += 1
        self.configured, self._in_error = False, True
        raise NotReady(f'{self._pages.name}: {reason}; configuring again')

    def read(self) -> list[Samples]:
        """Return what is new: a sample, or none."""
        self.skipped = {}
        if not self.configured:
            self.restart()
        before = self.clock.now_ns()
        keeping = before - self._kept_ns >= HOUSEKEEPING_NS
        raw = self.registers.burst(self.ACC_DATA, 51 if keeping else 32 if self._fused else 18)
        after = self.clock.now_ns()
        before = max(before, self._uart.asked_ns if self._uart else 0)
        # Euler angles lie between the vectors and the quaternion
        row = self._frame.unpack(data := raw[:18] + (raw[24:32] if self._fused else b''))
        fused = row['orientation'][0] if self._fused else None
        if any(data) and not plausible(row['acceleration'][0], self._full, fused, UNIT_NORM):
            self.counters['implausible'] += 1
            self.updates.lose_track()  # others like it may have passed for updates
            advice = 'words that no BNO055 sends; if this is I²C, use the serial line or i2c-gpio'
            raise FrameError(f'{self._pages.name}: {advice}')
        runs = self._new(row, before, after)
        if keeping or not any(data):
            kept = self._housekeeping(after, raw[44:51])
            if not kept:
                self.restart()
                return []
            runs += kept
            # CALIB_STAT follows TEMP; offsets can be read in CONFIG only (DS section 3.11.4)
            if self._profile.wanted and len(raw) > 45 and not ~raw[45] & self._calibrated:
                self.registers.run(self.stop_steps)
                found = self._profile.read()
                self.start()
                self._profile.write(found)
        return runs

    def _new(self, row: np.ndarray, before: int, after: int) -> list[Samples]:
        words = b''.join([row[name].tobytes() for name in self._compared])
        if not any(words[-8:] if self._fused else words):
            return []  # nothing measured yet
        look = self.look(row, before, after, words)
        runs = []
        if len(look.rows):
            columns = self.decode(look.rows, *self._measured.values())
            if self._fused:
                columns['orientation'] = self.orientation.decode(look.rows['orientation'])
            runs.append(Samples(look.stamps, **columns))
        field, words = row['magnetic_field'], row['magnetic_field'].tobytes()
        # zero is not measured yet, unless it stays so
        if words != self._field and (field.any() or after - self._begun_ns > HOUSEKEEPING_NS):
            self._field = words
            if 'magnetic_field' in self.rates_hz:
                si = self.magnetic_field.decode(field)
                runs.append(Samples(np.array([after]), magnetic_field=si))
        return runs

    def _housekeeping(self, now: int, words: bytes = b'') -> list[Samples]:
        """Return the temperature; nothing if the chip does not measure any more."""
        words = words or self.registers.burst(self.TEMP, 7)  # up to SYS_ERR
        state = self.state.extract(words[5])
        if state == 'error':
            self._give_up(f'SYS_ERR {self.error.extract(words[6])}')
        if state != ('fusion' if self._fused else 'no fusion'):
            return []
        self._kept_ns = now
        if self._fused:
            self.counters['uncalibrated'] += not words[1] & self.calibrated_system.mask
        celsius = self.temperature.decode(np.frombuffer(words[:1], dtype=np.int8))
        return [Samples(np.array([now]), temperature=celsius)]
