# SPDX-License-Identifier: Apache-2.0
"""
Xsens MTi-300: accelerometer, gyroscope, magnetometer and orientation, on a serial line.

Documents: MT Low-Level Communication Protocol, MT0101P 2020.A (LLCP), and MTi User Manual
MT0605P 2020.A (UM).  Every frame carries a packet counter and the time at which it was sampled
on the device's clock, so that a lost frame is known as such.  Stamps are late by what the device
itself takes, which the documents do not give, and on USB by the delivery of its frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from imu_bench.bus.framing import xbus
from imu_bench.bus.framing.xbus import Column, EVERY_FRAME, FrameCounter, Message, Mid, Output
from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.bus.xbus_port import MotionTracker, XbusPort
from imu_bench.drivers.driver import Driver, Setting, Typical, Witness
from imu_bench.errors import (
    ChecksumError,
    ConfigError,
    FrameError,
    IdentityError,
    NoAnswer,
    NotReady,
)
from imu_bench.registers import Channel, Codes, Field, Quaternion, Register, Scalar, Vector
from imu_bench.samples import Samples
from imu_bench.units import DEGREE, GAUSS, STANDARD_GRAVITY
import numpy as np

G = STANDARD_GRAVITY
BASE_HZ = 400  # UM: of acceleration, rate of turn and orientation
MAGNETIC_UNIT = 49e-6  # T; UM 2023, the field at the maker's, where UM 2020 prints about 40 µT
BUFFER_BYTES = 4096  # of a serial line in Linux: N_TTY_BUF_SIZE
SILENCE_PERIODS, SILENCE_S = 3.0, 0.1  # a USB adapter alone may hold bytes back for 16 ms
# LLCP: SetFilterProfile
PROFILES = {'general': 39, 'high_mag_dep': 40, 'dynamic': 41, 'low_mag_dep': 42, 'vru_general': 43}
WHOLE_RATES = tuple(float(BASE_HZ // n) for n in range(1, BASE_HZ + 1) if BASE_HZ % n == 0)


class Mti300(Driver):
    """Xsens MTi-300, a stream of Xbus frames, through USB or a serial line."""

    # --- document and identity -----------------------------------------------------------
    name = 'mti300'
    title = 'Xsens MTi-300'
    document = 'MT0101P 2020.A, MT0605P 2020.A'
    bus_kinds = ('serial',)
    wiring: ClassVar[Mapping[str, Wiring]] = {'': Wiring(serial_baud=115_200)}  # LLCP: default
    PRODUCT = 'MTI-300'

    # --- register map: outputs by their data identifier (LLCP section 5) -----------------
    TEMPERATURE = Register(0x0810, access='ro', size=4, addresses=1, reset=None)
    PACKET_COUNTER = Register(0x1020, access='ro', size=2, addresses=1, reset=None)
    SAMPLE_TIME_FINE = Register(0x1060, access='ro', size=4, addresses=1, reset=None)
    QUATERNION = Register(0x2010, access='ro', size=16, addresses=1, reset=None)
    ACCELERATION = Register(0x4020, access='ro', size=12, addresses=1, reset=None)
    RATE_OF_TURN = Register(0x8020, access='ro', size=12, addresses=1, reset=None)
    MAGNETIC_FIELD = Register(0xC020, access='ro', size=12, addresses=1, reset=None)
    STATUS_WORD = Register(0xE020, access='ro', size=4, addresses=1, reset=None)

    # --- fields and codes (LLCP, StatusWord) ---------------------------------------------
    self_test_passed = Field(STATUS_WORD, 0)
    filter_valid = Field(STATUS_WORD, 1)
    no_rotation = Field(STATUS_WORD, (4, 3), Codes({'no': 0, 'rotates': 2, 'running': 3}))
    clock_synchronised = Field(STATUS_WORD, 6)
    clipped_acceleration = Field(STATUS_WORD, (10, 8))
    clipped_rate_of_turn = Field(STATUS_WORD, (13, 11))
    clipped_magnetic_field = Field(STATUS_WORD, (16, 14))
    clipped = Field(STATUS_WORD, 19)

    # --- channels: 32-bit floats in SI; x forward, y left, z up (UM) ---------------------
    acceleration = Vector(
        first=ACCELERATION, quantity='acceleration', unit='m/s²', dtype='>f4', si_per_lsb=1.0
    )
    angular_velocity = Vector(
        first=RATE_OF_TURN, quantity='angular_velocity', unit='rad/s', dtype='>f4', si_per_lsb=1.0
    )
    magnetic_field = Vector(
        first=MAGNETIC_FIELD, quantity='magnetic_field', unit='T', dtype='>f4',
        si_per_lsb=MAGNETIC_UNIT,
    )  # fmt: skip
    temperature = Scalar(
        first=TEMPERATURE, quantity='temperature', unit='°C', dtype='>f4', si_per_lsb=1.0
    )
    # LLCP: from the sensor's frame to east, north, up, as REP-103 has it
    orientation = Quaternion(
        first=QUATERNION, quantity='orientation', unit='1', dtype='>f4', si_per_lsb=1.0
    )

    # --- settings ------------------------------------------------------------------------
    # fmt: off
    settings = (
        Setting('rate_hz', 400.0, 'Rate of acceleration, angular velocity and orientation.',
                WHOLE_RATES, unit='Hz'),
        Setting('magnetometer_rate_hz', 100.0, 'Rate of the magnetometer, a whole part of '
                'rate_hz; 0 is off.', (0.0, *(rate for rate in WHOLE_RATES if rate <= 100.0)),
                unit='Hz'),
        Setting('orientation', True, 'Publish the orientation too, as imu/data.'),
        Setting('filter_profile', 'general', 'Of the orientation filter.', tuple(PROFILES)),
        Setting('magnetic_unit', 49.0, 'Field that the sensor calls 1: its document gives no '
                'tesla, 49 µT or about 40 µT by edition.', bounds=(1.0, 100.0), unit='µT'),
        Setting('baud', 0, 'Speed of a serial line, to which the device is brought; 0 is USB, '
                'which has none.', (0, 115_200, 230_400, 460_800, 921_600)),
    )
    # fmt: on
    described = ('baud',)  # it was brought to that speed when it was first used
    counter_names = (
        'checksum_errors',
        'garbage_bytes',
        'device_errors',
        'lost_frames',
        'time_jumps',
        'self_test_failures',
        'filter_invalid',
    )  # fmt: skip

    # --- typical values (UM, sensor specifications) --------------------------------------
    typical: ClassVar[Mapping[str, Typical]] = {
        # the in-run bias stability is the floor of the Allan deviation, 0.664 B
        'acceleration': Typical(
            'MT0605P 2020.A', noise_density=60e-6 * G, bandwidth=375.0, range=200.0, bias=0.05,
            bias_instability=15e-6 * G / 0.664, nonlinearity=0.001),
        'angular_velocity': Typical(
            'MT0605P 2020.A', noise_density=0.01 * DEGREE, bandwidth=415.0, range=450 * DEGREE,
            bias=0.2 * DEGREE, bias_instability=10 * DEGREE / 3600 / 0.664, nonlinearity=1e-4),
        # 0.5 mG rms, taken as white at 100 Hz
        'magnetic_field': Typical(
            'MT0605P 2020.A', noise_density=0.5e-3 * GAUSS / 50**0.5, range=8 * GAUSS,
            nonlinearity=0.002),
        'temperature': Typical('not given'),
    }  # fmt: skip

    # --- witnesses -----------------------------------------------------------------------
    # fmt: off
    witnesses = (
        Witness(acceleration, 'bedc9afa3f549f37411cbb70', (-0.430870, 0.830554, 9.795761),
                'LLCP, example MTData2'),
        Witness(angular_velocity, 'bbaa5c803b8c5501bb813300',
                (-0.005199015, 0.004282594, -0.003942847), 'LLCP, example MTData2'),
        Witness(magnetic_field, '3ecccccd00000000bf666666', (19.6e-6, 0, -44.1e-6),
                '0.4 and -0.9 of 49 µT'),
        Witness(temperature, '41cc0000', (25.5,), 'IEEE 754'),
        Witness(orientation, '3f000000bf0000003f0000003f000000', (-0.5, 0.5, 0.5, 0.5),
                'IEEE 754; LLCP: w first'),
    )
    # fmt: on

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        baud = int(self.values['baud'])
        wire: Any = self._wires['']
        self._port = XbusPort(wire, clock, self.counters)
        self._tracker = MotionTracker(self._port, baud)
        self._frames = FrameCounter(self.rate_hz)
        self.trims['magnetic_field'] = float(self.values['magnetic_unit']) * 1e-6 / MAGNETIC_UNIT
        self._main: tuple[Channel, ...] = (self.acceleration, self.angular_velocity)
        if self.values['orientation']:
            self._main += (self.orientation,)
        slow = float(self.values['magnetometer_rate_hz'])
        self.rates_hz = {'temperature': 1.0} | ({'magnetic_field': slow} if slow else {})
        carried = self._carried()
        self._outputs = tuple(Output(register.address, rate) for register, rate in carried)
        # preamble, bus, message, length and checksum, then identifier and size before each output
        size = 5 + sum(3 + r.size for r, rate in carried if rate in (EVERY_FRAME, self.rate_hz))
        beside = sum((3 + r.size) * rate for r, rate in carried if rate < self.rate_hz)
        self._bytes_per_s = self.rate_hz * size + beside
        if 0 < baud < 10 * self._bytes_per_s:
            raise ConfigError(
                f'{self.name}.baud: {self.rate_hz:g} Hz need {10 * self._bytes_per_s:.0f} baud '
                f'and the line has {baud}; choose a higher baud, a lower rate_hz, or less output'
            )
        # a frame is here when its last byte is; USB takes no time
        self._on_line_ns = round(size * 10e9 / baud) if baud else 0
        self._heard_ns = 0

    def _carried(self) -> list[tuple[Register, int]]:
        """Return what the frames carry, and how often in Hz."""
        rate, slow = int(self.rate_hz), int(self.values['magnetometer_rate_hz'])
        if slow and rate % slow:
            raise ConfigError(
                f'{self.name}.magnetometer_rate_hz: {slow} Hz is no whole part of {rate} Hz; '
                'choose one that is, or 0'
            )
        carried = [
            (self.PACKET_COUNTER, EVERY_FRAME),
            (self.SAMPLE_TIME_FINE, EVERY_FRAME),
            (self.QUATERNION, rate if self.values['orientation'] else 0),
            (self.ACCELERATION, rate),
            (self.RATE_OF_TURN, rate),
            (self.MAGNETIC_FIELD, slow),
            (self.TEMPERATURE, 1),
            (self.STATUS_WORD, EVERY_FRAME),
        ]
        return [(register, rate) for register, rate in carried if rate]

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        """Return that there are none."""
        return {}

    @property
    def poll_period_s(self) -> float:
        """Return a quarter of what the computer holds of a serial line."""
        return min(BUFFER_BYTES / 4 / self._bytes_per_s, 0.25)

    # --- the conversation (LLCP section 4) -----------------------------------------------
    def identify(self) -> str:
        """
        Return product code, device id and firmware; the device does not measure any more.

        Raises
        ------
        NoAnswer
            If nothing answers at any speed.
        IdentityError
            If it is another motion tracker.
        """
        self._tracker.go_to_config()
        product, number, firmware = self._tracker.identity()
        if not product.upper().startswith(self.PRODUCT):
            raise IdentityError(
                f'{self._port.name}: product code {product!r}, expected {self.PRODUCT} for '
                f'{self.title}; check which device is at this port'
            )
        return f'{product}, device {number}, firmware {firmware}'

    def configure(self) -> None:
        """
        Check the identity, set filter and outputs, compare with what the device acknowledges.

        Raises
        ------
        BusError
            If nothing answers, or the device does something else than it was asked.
        IdentityError
            If another device answers.
        """
        self.configured = False
        self.identify()
        self._tracker.set_filter_profile(PROFILES[str(self.values['filter_profile'])])
        self._tracker.set_outputs(self._outputs)
        self.configured = True

    def start(self) -> None:
        """Let the device measure."""
        super().start()
        self._tracker.measure()
        self._frames.begin()
        self._heard_ns = self.clock.now_ns()

    def restart(self) -> None:
        """Configure and start again: a device that was without power measures by itself."""
        self.configure()
        self.start()

    def stop(self) -> None:
        """Stop measuring."""
        self._tracker.go_to_config()

    def read(self) -> list[Samples]:
        """Return everything new; frames that are missing are counted."""
        self.skipped = {}
        if not self.configured:
            self.restart()
        wrong, garbage = self.counters['checksum_errors'], self.counters['garbage_bytes']
        messages = self._port.receive()
        now = self.clock.now_ns()
        payloads = [message.data for message in messages if message.mid == Mid.DATA]
        if payloads:
            self._heard_ns = now
        for message in messages:
            self._attend(message)
        if not payloads:
            if self.counters['checksum_errors'] > wrong:
                raise ChecksumError(f'{self._port.name}: wrong checksums; check line and plug')
            if self.counters['garbage_bytes'] > garbage:
                raise FrameError(f'{self._port.name}: bytes that are no frames; check baud, plug')
            self._check_silence(now)
            return []
        return self._runs(payloads, now - self._on_line_ns)

    def _attend(self, message: Message) -> None:
        """React to what is no data."""
        if message.mid == Mid.WAKE_UP:
            self._port.woke_up()
            self.configured = False
            raise NotReady(f'{self._port.name}: the device was without power; configuring again')
        if message.mid == Mid.ERROR:
            raise self._port.error_of(message)

    def _check_silence(self, now: int) -> None:
        patience_s = max(SILENCE_PERIODS / self.rate_hz, SILENCE_S)
        if now - self._heard_ns > patience_s * 1e9:
            self.counters['bus_errors'] += 1
            raise NoAnswer(f'{self._port.name}: no data for {patience_s:g} s; check plug, power')

    # --- frames --------------------------------------------------------------------------
    def _runs(self, payloads: list[bytes], now: int) -> list[Samples]:
        found, n = xbus.columns(payloads), len(payloads)
        counter, ticks, status = (
            self._column(found, register, n).words(f'>u{register.size}')[:, 0].astype(np.int64)
            for register in (self.PACKET_COUNTER, self.SAMPLE_TIME_FINE, self.STATUS_WORD)
        )
        counted = self._frames.take(counter, ticks)
        good = len(counted.missing)
        if counted.jumped:
            self.counters['time_jumps'] += 1
            self.configured = False
        self.counters['lost_frames'] += int(counted.missing.sum())
        self._count_flags(status[:good])
        columns: dict[str, Any] = {'stamps': now - counted.ages_ns}
        for channel in self._main:
            words = self._column(found, channel.first, n).words(channel.dtype)
            columns[channel.quantity] = channel.decode(words[:good])
        main = Samples(**columns)
        return self._split(main, status[:good], counted.missing) + self._beside(found, main.stamps)

    def _column(self, found: Mapping[int, Column], register: Register, n: int) -> Column:
        """Return an output that every frame has."""
        column = found.get(register.address)
        if column is None or len(column.places) != n or column.data.shape[1] != register.size:
            self.configured = False
            raise FrameError(
                f'{self._port.name}: frames without {register.name}, or of another size; somebody '
                'else has configured the device, configuring again'
            )
        return column

    def _count_flags(self, status: np.ndarray) -> None:
        for name, found in (
            ('saturated', status & self._clips != 0),
            ('self_test_failures', status & self.self_test_passed.mask == 0),
            ('filter_invalid', status & self.filter_valid.mask == 0),
        ):
            self.counters[name] += int(found.sum())

    def _split(self, main: Samples, status: np.ndarray, missing: np.ndarray) -> list[Samples]:
        """Return runs without gaps, and without orientation where the filter says so."""
        valid = status & self.filter_valid.mask != 0
        edges = np.flatnonzero((missing[1:] > 0) | (valid[1:] != valid[:-1])) + 1
        runs: list[Samples] = []
        for first, last in zip([0, *edges], [*edges, len(main)], strict=True):
            if first == last:
                continue
            if missing[first]:
                self.skipped[len(runs)] = int(missing[first])
            run = main[first:last]
            if not valid[first]:
                run = Samples(run.stamps, run.acceleration, run.angular_velocity)
            runs.append(run)
        return runs

    def _beside(self, found: Mapping[int, Column], stamps: np.ndarray) -> list[Samples]:
        """Return what comes more slowly."""
        runs = []
        for channel in (self.magnetic_field, self.temperature):
            column = found.get(channel.first.address)
            if column is None:
                continue
            kept = column.places < len(stamps)
            words = column.words(channel.dtype)[kept]
            if channel is self.temperature:
                words = words[:, 0]
            si = channel.decode(words, trim=self.trims.get(channel.quantity, 1.0))
            columns: dict[str, Any] = {channel.quantity: si}
            runs.append(Samples(stamps[column.places[kept]], **columns))
        return runs

    _clips = (
        clipped_acceleration.mask | clipped_rate_of_turn.mask | clipped_magnetic_field.mask
        | clipped.mask
    )  # fmt: skip
