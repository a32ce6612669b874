# SPDX-License-Identifier: Apache-2.0
"""
Murata SCL3300-D01: three-axis inclinometer, acceleration and angles.

Document: Murata SCL3300-D01 data sheet, Doc 4921 rev. 2 (DS).  The chip has no FIFO, no
counter and no data-ready: it is polled, and a sample is measured when it is read.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, ClassVar

from imu_bench.bus.banked import BankedBus
from imu_bench.bus.framing import murata
from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.bus.off_frame import OffFrameBus
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, Driver, Identity, Setting, Typical, Witness
from imu_bench.errors import BusError, FrameError, NotReady
from imu_bench.registers import Codes, Field, Register, Scalar, Value, Vector, Wait, Write
from imu_bench.samples import Samples
from imu_bench.units import STANDARD_GRAVITY
import numpy as np

G = STANDARD_GRAVITY  # DS calls the 9.819 m/s² of the factory one g: 0.126 % of scale
INTERNAL_HZ = 2000.0  # DS table 2: a new value every 0.5 ms
SETTLING_S = {1: 0.025, 2: 0.015, 3: 0.1, 4: 0.1}  # DS table 11
SELF_TEST_LIMIT = {1: 1800, 2: 900, 3: 3600, 4: 3600}  # DS section 6.2, example limits
SELF_TEST_PATIENCE_S = 1.0  # application's choice: DS section 6.2


class Scl3300(Driver):
    """Murata SCL3300-D01, polled, through SPI frames with checksum."""

    # --- document and identity -----------------------------------------------------------
    name = 'scl3300'
    title = 'Murata SCL3300-D01'
    document = 'Doc 4921 rev. 2'
    bus_kinds = ('frame',)
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # DS table 8: 0.1 to 8 MHz, 2 to 4 MHz for the lowest noise
        '': Wiring(spi_mode=0, spi_max_hz=8_000_000, spi_hz=2_000_000),
    }

    # --- register map (DS table 15) ------------------------------------------------------
    ACC = Register(0x01, access='ro', size=6, addresses=3, reset=None)
    STO = Register(0x04, access='ro', size=2, addresses=1, reset=None)
    TEMPERATURE = Register(0x05, access='ro', size=2, addresses=1, reset=None)
    STATUS = Register(0x06, access='ro', size=2, addresses=1, reset=0x10, clear_on_read=True)
    ERR_FLAG1 = Register(0x07, access='ro', size=2, addresses=1, bank=0)
    ERR_FLAG2 = Register(0x08, access='ro', size=2, addresses=1, reset=0x10, bank=0)
    ANG = Register(0x09, access='ro', size=6, addresses=3, bank=0)
    ANG_CTRL = Register(0x0C, access='wo', size=2, addresses=1, bank=0)
    MODE = Register(0x0D, size=2, addresses=1, bank=0)
    WHOAMI = Register(0x10, access='ro', size=2, addresses=1, reset=0xC1, bank=0)
    SERIAL1 = Register(0x19, access='ro', size=2, addresses=1, reset=None, bank=1)
    SERIAL2 = Register(0x1A, access='ro', size=2, addresses=1, reset=None, bank=1)
    SELBANK = Register(0x1F, size=2, addresses=1)

    # --- fields and codes ----------------------------------------------------------------
    # the whole word: only the frames of DS table 13 may be sent
    mode = Field(MODE, (15, 0), Codes({1: 0, 2: 1, 3: 2, 4: 3}))
    angle_outputs = Field(ANG_CTRL, (15, 0), Codes({'off': 0, 'on': 0x1F}))
    digital_error_1 = Field(STATUS, 9)
    digital_error_2 = Field(STATUS, 8)
    clock_error = Field(STATUS, 7)
    saturation = Field(STATUS, 6)
    temperature_saturation = Field(STATUS, 5)
    supply_error = Field(STATUS, 4)
    memory_error = Field(STATUS, 3)
    power_down = Field(STATUS, 2)
    mode_changed = Field(STATUS, 1)
    pin_error = Field(STATUS, 0)

    identities = (
        Identity(
            WHOAMI, {0xC1: 'Murata SCL3300-D01'}, {0x51: 'SCA3300, other scales and no angles'}
        ),
    )

    # --- channels (DS sections 2.5, 2.6, 2.11) -------------------------------------------
    acceleration = Vector(
        first=ACC, quantity='acceleration', unit='m/s²', dtype='>i2', scaled_by=mode,
        si_per_lsb={1: G / 6000, 2: G / 3000, 3: G / 12000, 4: G / 12000},
    )  # fmt: skip
    temperature = Scalar(
        first=TEMPERATURE, quantity='temperature', unit='°C', dtype='>i2',
        si_per_lsb=1 / 18.9, offset=-273.0,
    )  # fmt: skip
    # signed: DS prints the -90° of 0xC000 as 270°
    inclination = Vector(
        first=ANG, quantity='inclination', unit='rad', dtype='>i2', si_per_lsb=math.pi / 2**15
    )

    # --- settings ------------------------------------------------------------------------
    settings = (
        choice('mode', mode, 4, 'Full scale and low-pass: 1 is 1.2 g and 40 Hz, 2 is 2.4 g and '
               '70 Hz, 3 and 4 are inclination with 10 Hz, 4 with less noise.'),
        Setting('rate_hz', 200.0, 'How often the host reads; the chip has 2000 Hz.',
                bounds=(1.0, INTERNAL_HZ), unit='Hz'),
    )  # fmt: skip
    counter_names = (
        'crc_errors', 'frame_errors', 'chip_errors', 'self_test_exceeded', 'temperature_saturated',
    )  # fmt: skip

    # --- sequences (DS table 11) ---------------------------------------------------------
    reset_steps = (Write({MODE: 0x20}), Wait(0.026, 'DS: 1 ms; the driver of Linux waits 26 ms'))
    # DS section 5.1.5: acceleration first, STATUS last
    sweep = tuple(
        murata.frame(register.address + k)
        for register in (ACC, STO, TEMPERATURE, ANG, STATUS)
        for k in range(register.size // 2)
    )
    status_sweep = (murata.frame(STATUS.address),) * 3

    # --- typical values (DS table 2) -----------------------------------------------------
    typical: ClassVar[Mapping[str, Typical]] = {
        # mode 4; the sheet gives 32 µg/√Hz for mode 3 and nothing for 1 and 2.  Range: a
        # sensor on a plate stands at 1 g, the word ends at 2.73 g
        'acceleration': Typical(
            'Doc 4921 rev. 2 table 2, mode 4', bandwidth=10.0,
            noise_density=(20e-6 * G, 15e-6 * G, 20e-6 * G),
            resolution=G / 12000, bias=0.02 * G, bias_per_kelvin=0.01 * G / 100,
            scale_error=0.007, scale_per_kelvin=0.003 / 100, nonlinearity=0.004,
            cross_axis=0.002),
        'inclination': Typical('Doc 4921 rev. 2 table 2', resolution=math.pi / 2**15),
        'temperature': Typical('Doc 4921 rev. 2 table 7', resolution=1 / 18.9, bias=10.0),
    }  # fmt: skip

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        Witness(acceleration, '00dc00000000', (0.359577, 0, 0), 'DS: 220 of 6000 LSB/g', 1),
        Witness(acceleration, '0000f4480000', (0, -4.903325, 0), '-3000 of 6000 LSB/g', 1),
        Witness(acceleration, '000000001770', (0, 0, 19.6133), '6000 of 3000 LSB/g', 2),
        Witness(acceleration, '000000001770', (0, 0, 4.903325), '6000 of 12000 LSB/g', 3),
        Witness(acceleration, '177000000000', (4.903325, 0, 0), '6000 of 12000 LSB/g', 4),
        Witness(temperature, '161e', (26.577,), 'DS section 2.6: 5662/18.9 - 273'),
        Witness(temperature, '1600', (24.989,), 'DS section 2.6: 5632 is 25 °C'),
        Witness(inclination, '0f88c0000000', (0.381195, -1.570796, 0),
                'DS section 2.11: 21.84°, 270°'),
    )  # fmt: skip

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        self._self_test_since_ns: int | None = None

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        """Return the registers behind the frames, with their banks."""
        self._frames = OffFrameBus(wires[''], self.counters)
        self._banks = BankedBus(self._frames, self.SELBANK.address)
        return {'': self._banks}

    @property
    def paced(self) -> bool:
        """Return that the host sets the pace."""
        return True

    @property
    def poll_period_s(self) -> float:
        """Return the period of the samples."""
        return 1.0 / self.rate_hz

    def identify(self) -> str:
        """Return part and serial number (DS section 6.8)."""
        part = super().identify()
        number = self.registers.word(self.SERIAL2) << 16 | self.registers.word(self.SERIAL1)
        self.registers.word(self.WHOAMI)  # the stream needs bank 0
        return f'{part}, serial number {number}B33'

    def assignments(self) -> dict[Any, Value]:
        """Return the mode, and that angles are wanted."""
        return {**super().assignments(), self.angle_outputs: 'on'}

    def configure(self) -> None:
        """Reset, check the identity, set the mode, read it back; wait until flags are clear."""
        self._banks.forget()
        super().configure()

    def configure_parts(self) -> None:
        """Let the filters settle and read STATUS until the flags of the start are gone."""
        self.clock.sleep(SETTLING_S[int(self.values['mode'])])
        *_, last = self._frames.exchange(self.status_sweep)
        if last.status != murata.NORMAL:
            raise NotReady(f'{self._frames.name}: start-up failed: {self._flags(last.data)}')

    def start(self) -> None:
        """Begin to read; the chip has measured since it was configured."""
        super().start()
        self._self_test_since_ns = None

    def read(self) -> list[Samples]:
        """Return one sample, stamped half-way through its three axes."""
        if not self.configured:
            self.restart()
        try:
            answers = self._frames.exchange(self.sweep)
            first = next(answers)
            stamp = self.clock.now_ns()  # Y has just been asked for
            swept = [first, *answers]
        except BusError:
            self.counters['bus_errors'] += 1
            raise
        return self._sample(stamp, swept) if self._sound(swept) else []

    def _sound(self, swept: list[murata.Answer]) -> bool:
        """Return whether a sweep can be trusted; put things right if not (DS section 6.3)."""
        status = swept[-1].data
        # the last answer tells of a flag that STATUS did not have yet
        returned = {answer.status for answer in swept[:-1]}
        if murata.STARTING in returned or status & self._lost_settings:
            self.counters['brown_outs'] += 1
            self.configured = False
            self.restart()
            return False
        if status & self._defects:
            self._give_up(self._flags(status))
        if returned != {murata.NORMAL} and not status:
            self.counters['frame_errors'] += 1
            raise FrameError(f'{self._frames.name}: a request arrived broken; check the wiring')
        return self._self_test(swept[3].data)

    def _self_test(self, word: int) -> bool:
        """Watch the self-test output (DS section 6.2): one reading beyond the limit is none."""
        limit = SELF_TEST_LIMIT[int(self.values['mode'])]
        if abs((word ^ 0x8000) - 0x8000) <= limit:
            self._self_test_since_ns = None
            return True
        self.counters['self_test_exceeded'] += 1
        now = self.clock.now_ns()
        since = self._self_test_since_ns = self._self_test_since_ns or now
        if now - since > SELF_TEST_PATIENCE_S * 1e9:
            self._give_up(f'the self-test output stays beyond ±{limit}: shaken, or defective')
        return True

    def _give_up(self, reason: str) -> None:
        """Let the next reading begin with a reset."""
        self.counters['chip_errors'] += 1
        self.configured = False
        self.continuity += 1
        raise NotReady(f'{self._frames.name}: {reason}; resetting')

    def _flags(self, status: int) -> str:
        """Return what STATUS and the error flags say, in words."""
        said = [f.name for f in self.fields_of(self.STATUS) if status & f.mask]
        errors = [self.registers.word(register) for register in (self.ERR_FLAG1, self.ERR_FLAG2)]
        return (
            f'STATUS 0x{status:04x} ({", ".join(said).replace("_", " ") or "nothing"}), '
            f'ERR_FLAG1 0x{errors[0]:04x}, ERR_FLAG2 0x{errors[1]:04x}'
        )

    def _sample(self, stamp: int, swept: list[murata.Answer]) -> list[Samples]:
        status = swept[-1].data
        words = np.array([answer.data for answer in swept], dtype='>u2').view('>i2')
        raw = words[np.newaxis, 0:3]
        clipped = bool(status & self.saturation.mask) or not self.acceleration.within(raw)
        self.counters['saturated'] += clipped
        hot = bool(status & self.temperature_saturation.mask)
        self.counters['temperature_saturated'] += hot
        angles = self.inclination.decode(words[np.newaxis, 5:8])
        return [
            Samples(
                np.array([stamp]),
                self.acceleration.decode(raw, self.values['mode']),
                temperature=None if hot else self.temperature.decode(words[4:5]),
                # DS section 6.3: a saturated signal makes the angles invalid
                inclination=np.full((1, 3), np.nan) if clipped else angles,
            )
        ]

    _lost_settings = supply_error.mask | power_down.mask | mode_changed.mask
    _defects = (
        digital_error_1.mask | digital_error_2.mask | clock_error.mask | memory_error.mask
        | pin_error.mask
    )  # fmt: skip
