# SPDX-License-Identifier: Apache-2.0
"""
A microcontroller that samples a sensor by itself and sends each sample over a serial line.

Document: docs/serial_bridge.md of this project, with a sketch.  What the microcontroller sends is
what its sketch says; nothing is asked of it and nothing set.  A counter tells lost samples, its
clock how far they were apart; without either a gap cannot be told from a slow loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from imu_bench.bus.framing.bridge import BinaryDecoder, Decoder, SampleCounter, TextDecoder
from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import Driver, Setting, Typical, Witness
from imu_bench.errors import (
    BusError,
    ChecksumError,
    ConfigError,
    FrameError,
    IdentityError,
    NoAnswer,
)
from imu_bench.registers import Channel, Register, Scalar, Vector
from imu_bench.samples import Samples
from imu_bench.units import DEGREE
import numpy as np

BUFFER_BYTES = 4096  # of a serial line in Linux: N_TTY_BUF_SIZE
SILENCE_PERIODS, SILENCE_S = 3.0, 0.1  # a USB adapter alone may hold bytes back for 16 ms
# opening the port resets an Arduino, and the bootloader of the Uno waits for a second or two
FIRST_LINE_S = 3.0
SHORTEST, USUAL = 2, 10  # characters of a value in a line, with its comma
COLUMNS = {
    'acceleration': ('ax', 'ay', 'az'), 'angular_velocity': ('gx', 'gy', 'gz'),
    'magnetic_field': ('mx', 'my', 'mz'), 'temperature': ('t',),
}  # fmt: skip
MAIN = 'acceleration', 'angular_velocity'
WORDS = {'n': '<u2', 'us': '<u4', 'ms': '<u4'}  # in a binary frame; the others by `format`
FORMATS = {'text': '', 'int16': '<i2', 'float32': '<f4'}


class SerialBridge(Driver):
    """A microcontroller on a serial line or USB: a sample a line."""

    # --- document and identity -----------------------------------------------------------
    name = 'serial_bridge'
    title = 'Microcontroller with a sensor'
    document = 'docs/serial_bridge.md'
    bus_kinds = ('serial',)
    wiring: ClassVar[Mapping[str, Wiring]] = {'': Wiring(serial_baud=115_200)}
    start_up_s = 2.0  # see FIRST_LINE_S

    # --- register map: names of ours for what lines carry --------------------------------
    ACCELERATION = Register(0x01, access='ro', size=12, addresses=1, reset=None)
    ANGULAR_VELOCITY = Register(0x02, access='ro', size=12, addresses=1, reset=None)
    MAGNETIC_FIELD = Register(0x03, access='ro', size=12, addresses=1, reset=None)
    TEMPERATURE = Register(0x04, access='ro', size=4, addresses=1, reset=None)

    # --- channels: SI, times the unit that is set ----------------------------------------
    acceleration = Vector(
        first=ACCELERATION, quantity='acceleration', unit='m/s²', dtype='<f4', si_per_lsb=1.0
    )
    angular_velocity = Vector(
        first=ANGULAR_VELOCITY, quantity='angular_velocity', unit='rad/s', dtype='<f4',
        si_per_lsb=1.0,
    )  # fmt: skip
    magnetic_field = Vector(
        first=MAGNETIC_FIELD, quantity='magnetic_field', unit='T', dtype='<f4', si_per_lsb=1.0
    )
    temperature = Scalar(
        first=TEMPERATURE, quantity='temperature', unit='°C', dtype='<f4', si_per_lsb=1.0
    )

    # --- settings ------------------------------------------------------------------------
    # fmt: off
    settings = (
        Setting('rate_hz', 50.0, 'Samples per second that the sketch takes.',
                bounds=(1.0, 8000.0), unit='Hz'),
        Setting('format', 'text', 'Lines of text, or binary frames with such values.',
                tuple(FORMATS)),
        Setting('columns', 'n,us,ax,ay,az,gx,gy,gz,mx,my,mz,t', 'What a line has, in its order: '
                'n counts samples, us or ms is the time of the microcontroller, ax … mz are the '
                'axes, t the temperature, - is left out.'),
        Setting('checked', True, 'Lines of text end with * and a checksum; binary frames always '
                'have one.'),
        Setting('acceleration_unit', 1.0, 'What a one of ax, ay, az is: 9.80665 for g.',
                bounds=(1e-9, 1e3), unit='m/s²'),
        Setting('angular_velocity_unit', 1.0, 'What a one of gx, gy, gz is: 0.0174532925 for °/s.',
                bounds=(1e-9, 1e3), unit='rad/s'),
        Setting('magnetic_field_unit', 1.0, 'What a one of mx, my, mz is: 1.0e-6 for µT.',
                bounds=(1e-12, 1.0), unit='T'),
        Setting('temperature_unit', 1.0, 'What a one of t is.', bounds=(1e-6, 1e3), unit='K'),
        Setting('baud', 115_200, 'Speed of the line; 0 is USB without one, as of a Teensy.',
                (0, 9600, 57_600, 115_200, 230_400, 250_000, 460_800, 500_000, 921_600, 1_000_000,
                 2_000_000)),
    )
    # fmt: on
    described = tuple(setting.name for setting in settings)
    counter_names = ('checksum_errors', 'garbage_bytes', 'lost_lines')

    # --- typical values ------------------------------------------------------------------
    typical: ClassVar[Mapping[str, Typical]] = {
        name: Typical('that of the sensor behind it')
        for name in ('acceleration', 'angular_velocity', 'magnetic_field', 'temperature')
    }

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        Witness(acceleration, '0000803f000000c05a641d41', (1.0, -2.0, 9.8370), 'IEEE 754'),
        Witness(
            angular_velocity, '0000803f00000000000080bf', (DEGREE, 0, -DEGREE), 'IEEE 754, °/s',
            trim=DEGREE,
        ),
        Witness(magnetic_field, '0000a04100000000000020c2', (20e-6, 0, -40e-6), 'µT', trim=1e-6),
        Witness(temperature, '0000cc41', (25.5,), 'IEEE 754'),
    )  # fmt: skip

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        self._line: Any = self._wires['']
        self._columns = str(self.values['columns']).replace(' ', '').split(',')
        self._places = self._found()
        for quantity in COLUMNS:
            self.trims[quantity] = float(self.values[f'{quantity}_unit'])
        self.rates_hz = {name: self.rate_hz for name in self._places if name not in MAIN}
        self._words = FORMATS[str(self.values['format'])]
        layout = [WORDS.get(column, self._words) for column in self._columns]
        frame = 4 + sum(np.dtype(word).itemsize for word in layout) if self._words else 0
        least, usual = (frame or size * len(layout) + 4 for size in (SHORTEST, USUAL))
        baud = int(self.values['baud'])
        if 0 < baud < 10 * least * self.rate_hz:
            raise ConfigError(
                f'{self.name}.baud: {self.rate_hz:g} Hz of {len(layout)} columns need '
                f'{10 * least * self.rate_hz:.0f} baud and the line has {baud}; choose a higher '
                'baud, a lower rate_hz, fewer columns, or format: int16'
            )
        self._poll_s = min(BUFFER_BYTES / 4 / (usual * self.rate_hz), 0.25)
        self._layout = layout
        self._decoder = self._fresh()
        self._count = SampleCounter(self.rate_hz)
        self._heard_ns = 0

    def _found(self) -> dict[str, list[int]]:
        """Return where each quantity stands in a line."""
        where = f'{self.name}.columns: '
        named = [column for column in self._columns if column != '-']
        wrong = set(named) - {*WORDS, *(column for group in COLUMNS.values() for column in group)}
        if wrong or len(set(named)) < len(named):
            raise ConfigError(
                f'{where}{", ".join(sorted(wrong)) or "a column twice"}; allowed: n, us, ms, '
                'ax to az, gx to gz, mx to mz, t, and - for what is left out, each once'
            )
        found = {}
        for quantity, group in COLUMNS.items():
            there = set(group) & set(named)
            if there and there != set(group):
                raise ConfigError(f'{where}{", ".join(group)} go together')
            if there:
                found[quantity] = [self._columns.index(column) for column in group]
        if not found.keys() & {*MAIN}:
            raise ConfigError(f'{where}neither ax, ay, az nor gx, gy, gz is there')
        return found

    def _fresh(self) -> Decoder:
        """Return a decoder that has seen nothing yet."""
        if self._words:
            return BinaryDecoder(self._layout)
        return TextDecoder(len(self._columns), checked=bool(self.values['checked']))

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        """Return that there are none."""
        return {}

    @property
    def poll_period_s(self) -> float:
        """Return a quarter of what the computer holds of a serial line."""
        return self._poll_s

    def identify(self) -> str:
        """
        Return what a line has, when one has come.

        Raises
        ------
        NoAnswer
            If nothing comes.
        IdentityError
            If lines have another number of values.
        FrameError
            If what comes are no such lines.
        """
        self._decoder = self._fresh()
        until = self.clock.now_ns() + round(FIRST_LINE_S * 1e9)
        while self.clock.now_ns() < until:
            now = self.clock.now_ns()
            if len(self._receive(0.1)):
                return f'{self.title}: {",".join(self._columns)}'
            if self._decoder.others:
                break
            self.clock.sleep_until(min(now + 10_000_000, until))
        raise self._nothing(f'no data for {FIRST_LINE_S:g} s; check plug, power, and the sketch')

    def configure(self) -> None:
        """Wait for the first line; there is nothing to set."""
        self.configured = False
        if (baud := int(self.values['baud'])) and self._line.baud != baud:
            self._line.baud = baud
        self.identify()
        self.configured = True

    def start(self) -> None:
        """Take the next line as the first one."""
        super().start()
        self._count.begin()
        self._heard_ns = self.clock.now_ns()

    def _receive(self, timeout_s: float = 0.0) -> np.ndarray:
        """Return the values of the lines that have come; counts the rest."""
        decoder = self._decoder
        wrong, garbage = decoder.checksum_errors, decoder.garbage
        try:
            data = self._line.read(timeout_s)
        except BusError:
            self.counters['bus_errors'] += 1
            raise
        rows = decoder.feed(data)
        self.counters['checksum_errors'] += decoder.checksum_errors - wrong
        self.counters['bus_errors'] += decoder.checksum_errors - wrong
        self.counters['garbage_bytes'] += decoder.garbage - garbage
        return rows

    def _nothing(self, silence: str) -> BusError | FrameError | IdentityError:
        """Return what is wrong where no line can be used."""
        name, decoder = self._line.name, self._decoder
        if decoder.others:
            return IdentityError(
                f'{name}: lines of {decoder.others} values, expected {len(self._columns)} for '
                f'columns: {",".join(self._columns)}; check them against the sketch'
            )
        if decoder.checksum_errors:
            return ChecksumError(
                f'{name}: wrong checksums, as of {decoder.example!r}; check line and plug, or set '
                'checked: false if the sketch sends none'
            )
        if decoder.example:
            advice = 'check baud, format and columns'
            return FrameError(f'{name}: no lines, but {decoder.example!r}; {advice}')
        self.counters['bus_errors'] += 1
        return NoAnswer(f'{name}: {silence}')

    def read(self) -> list[Samples]:
        """Return everything new; lines that are missing are counted."""
        self.skipped = {}
        if not self.configured:
            self.restart()
        rows, now = self._receive(), self.clock.now_ns()
        if not len(rows):
            patience_s = max(SILENCE_PERIODS / self.rate_hz, SILENCE_S)
            if now - self._heard_ns > patience_s * 1e9:
                error = self._nothing(f'no data for {patience_s:g} s; check plug, power')
                self.configured = False
                raise error
            return []
        self._heard_ns, self._decoder.example, self._decoder.others = now, b'', 0
        self._decoder.checksum_errors = 0
        baud = int(self.values['baud'])
        now -= round(self._decoder.size * 10e9 / baud) if baud else 0
        numbers = (self._column(rows, column) for column in WORDS)
        counted = self._count.take(len(rows), *numbers)
        if counted.jumped:
            self.counters['brown_outs'] += 1
            self.continuity += 1
            self._count.begin()
        good = len(counted.missing)
        self.counters['lost_lines'] += int(counted.missing.sum())
        return self._runs(rows[:good], now - counted.ages_ns, counted.missing)

    def _column(self, rows: np.ndarray, name: str) -> np.ndarray | None:
        if name not in self._columns:
            return None
        return rows[:, self._columns.index(name)].astype(np.int64)

    def _runs(self, rows: np.ndarray, stamps: np.ndarray, missing: np.ndarray) -> list[Samples]:
        """Return runs without gaps, then what comes beside them."""
        si: dict[str, Any] = {}
        for name, places in self._places.items():
            channel: Channel = getattr(self, name)
            words = rows[:, places[0]] if name == 'temperature' else rows[:, places]
            if self._words == '<i2' and name in MAIN:
                self.counters['saturated'] += int((np.abs(words) >= 2**15 - 1).any(axis=1).sum())
            si[name] = channel.decode(words, trim=self.trims.get(name, 1.0))
        main = {name: si[name] for name in MAIN if name in si}
        runs: list[Samples] = []
        edges = np.flatnonzero(missing[1:]) + 1
        for first, last in zip([0, *edges], [*edges, len(rows)], strict=True):
            if first < last:
                if missing[first]:
                    self.skipped[len(runs)] = int(missing[first])
                part = slice(first, last)
                runs.append(Samples(stamps[part], **{k: v[part] for k, v in main.items()}))
        return runs + [Samples(stamps, **{name: si[name]}) for name in self.rates_hz if len(rows)]
