# SPDX-License-Identifier: Apache-2.0
"""
The SCL3300 seen from its SPI frames: Murata SCL3300-D01 data sheet, Doc 4921 rev. 2.

Its answers come one frame late: the data are those of the request before, the return status is
that of the moment in which they go out.
"""

from __future__ import annotations

from typing import NamedTuple

from imu_bench.bus.framing.murata import crc8, ERROR, frame, NORMAL, STARTING
from imu_bench.drivers.scl3300 import INTERNAL_HZ, Scl3300
from imu_bench.emulators.ahead import Ahead, Source
from imu_bench.emulators.frames import EmulatedFrameBus
from imu_bench.emulators.low_pass import LowPass
from imu_bench.emulators.socket import Socket
from imu_bench.samples import Samples
from imu_bench.units import STANDARD_GRAVITY
import numpy as np

S = Scl3300
START_UP_NS = 1_000_000  # DS table 11
IDLE_NS = 1_000_000_000  # nobody asked for so long: the samples in between are skipped
BANDWIDTH_HZ = {1: 40.0, 2: 70.0, 3: 10.0, 4: 10.0}  # DS table 12
# DS gives no limit for modes 3 and 4 but their use up to 10°: what the word can hold is assumed
FULL_SCALE = {1: 1.2, 2: 2.4, 3: 32767 / 12000, 4: 32767 / 12000}
_PRESENT_IN_BANK_1 = frozenset({*range(0x01, 0x07), 0x19, 0x1A, 0x1F})
_MEASURED = frozenset(
    register.address + k
    for register in (S.ACC, S.TEMPERATURE, S.ANG)
    for k in range(register.size // 2)
)
SCA3300 = 0x51  # WHOAMI of the sister part
TEMPERATURES = -50.0, 150.0  # DS table 7: °C
_STATUS, _WHOAMI = S.STATUS.address, S.WHOAMI.address
_POWER_UP_FLAGS = S.supply_error.mask


class _Made(NamedTuple):
    """What the chip makes of samples, row by row: words by address; too much; too hot or cold."""

    rows: list[dict[int, int]]
    saturated: np.ndarray
    hot: list[bool]


class Scl3300Chip:
    """The registers behind the frames."""

    foreign = False

    def __init__(
        self,
        source: Source,
        start_ns: int,
        *,
        serial: int = 1021704154,
        self_test: int = 0,
    ) -> None:
        self._source = Ahead(source, self.converted, lambda: (self._filter,))
        self._serial = serial
        self.self_test = self_test  # word of the self-test output
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values: mode 1, angles off, bank 0."""
        self._now_ns = at_ns
        self._ready_ns = at_ns + START_UP_NS
        self._words = dict.fromkeys(range(0x20), 0)
        self._bank = 0
        self._angles_on = False
        self._asleep = False
        self.status = _POWER_UP_FLAGS
        self.error_flags = [0, 1 << 4]  # DPWR
        self._rejected = False
        # what comes before the first request is not defined
        self._reply = (0xFF, 0xFFFF)
        self._change_mode(0)
        self._source.restart(self._ready_ns, INTERNAL_HZ)

    # --- frames --------------------------------------------------------------------------
    def transfer(self, sent: bytes, at_ns: int) -> bytes:
        """Take a frame; return the answer to the one before it (DS section 5.1.3)."""
        self._advance(at_ns)
        operation, data = self._reply
        answer = frame(
            operation >> 2 & 0x1F, data, write=bool(operation >> 7), status=self._return_status()
        )
        self._rejected = len(sent) != 4 or crc8(sent[:3]) != sent[3]
        self._reply = (sent[0] & 0xFC, 0)
        if not self._rejected:
            self._obey(sent, at_ns)
        if operation == _STATUS << 2 and self._now_ns >= self._ready_ns:
            # reading clears what was shown, after the next word has been latched
            self.status &= ~data
        return answer[: len(sent)]

    def _return_status(self) -> int:
        if self._now_ns < self._ready_ns:
            return STARTING
        return ERROR if self.status or self._rejected else NORMAL

    def _obey(self, sent: bytes, at_ns: int) -> None:
        address, data = sent[0] >> 2 & 0x1F, sent[1] << 8 | sent[2]
        if self._now_ns < self._ready_ns:
            return
        if sent[0] >> 7:
            self._reply = (sent[0], data)
            self._write(address, data, at_ns)
        else:
            self._reply = (sent[0], self._read(address))

    # --- registers -----------------------------------------------------------------------
    def _read(self, address: int) -> int:
        if self._bank == 1 and address not in _PRESENT_IN_BANK_1:
            return 0
        if self._bank == 0 and address in (0x19, 0x1A):
            return 0
        if address == _STATUS:
            return self.status
        if address in _MEASURED:
            return self._words[address]
        fixed = {
            S.STO.address: self.self_test & 0xFFFF,
            S.ERR_FLAG1.address: self.error_flags[0],
            S.ERR_FLAG2.address: self.error_flags[1],
            S.SERIAL1.address: self._serial & 0xFFFF,
            S.SERIAL2.address: self._serial >> 16,
            S.SELBANK.address: self._bank,
            _WHOAMI: SCA3300 if self.foreign else S.WHOAMI.reset or 0,
        }
        return fixed.get(address, self._words[address])

    def _write(self, address: int, data: int, at_ns: int) -> None:
        self._source.rewind()
        if address == S.SELBANK.address:
            self._bank = data & 1
        elif self._bank == 0 and address == S.ANG_CTRL.address:
            self._angles_on = data == 0x1F
        elif self._bank == 0 and address == S.MODE.address:
            if data == 0x20:
                self.power_up(at_ns)
            elif data == 0x04:
                self._asleep = True
                self.status |= S.power_down.mask
            elif data < 4:
                self._asleep = False
                self._words[S.MODE.address] = data
                self.status |= S.mode_changed.mask
                self._change_mode(data)

    def _change_mode(self, code: int) -> None:
        self._mode = code + 1
        self._filter = LowPass(BANDWIDTH_HZ[self._mode], INTERNAL_HZ)

    # --- sampling ------------------------------------------------------------------------
    def _advance(self, to_ns: int) -> None:
        """Take every sample that is due and keep the newest."""
        if to_ns - self._now_ns > IDLE_NS:
            self._source.restart(to_ns - IDLE_NS // 10)
        self._now_ns = to_ns
        for _, made, first, last in self._source.until(to_ns):
            if not self._asleep:
                self._take(made, first, last)

    def converted(self, samples: Samples) -> _Made:
        """Return the words of each sample, and which of them are beyond the limits."""
        n = len(samples)
        words: dict[int, list[int]] = {}
        saturated, hot = np.zeros(n, np.bool_), [False] * n
        if samples.acceleration is not None:
            force = self._filter.filter(samples.acceleration)
            _spread(words, S.ACC.address, S.acceleration.encode(force, self._mode))
            full_scale = FULL_SCALE[self._mode] * STANDARD_GRAVITY * (1 + 1e-9)
            saturated = (np.abs(force) > full_scale).any(axis=1)
            angles = samples.inclination if samples.inclination is not None else tilt(force)
            angles = angles if self._angles_on else np.zeros((n, 3))
            _spread(words, S.ANG.address, S.inclination.encode(angles))
        if samples.temperature is not None:
            celsius = samples.temperature
            _spread(words, S.TEMPERATURE.address, S.temperature.encode(celsius)[:, np.newaxis])
            hot = ((celsius < TEMPERATURES[0]) | (celsius > TEMPERATURES[1])).tolist()
        rows = [dict(zip(words, row, strict=True)) for row in zip(*words.values(), strict=True)]
        return _Made(rows or [{}] * n, saturated, hot)

    def _take(self, made: _Made, first: int, last: int) -> None:
        """Keep the newest sample, and whether one went beyond."""
        self._words.update(made.rows[last - 1])
        if made.saturated[first:last].any():
            self.status |= S.saturation.mask
        if made.hot[last - 1]:
            self.status |= S.temperature_saturation.mask


def _spread(words: dict[int, list[int]], first: int, encoded: np.ndarray) -> None:
    """Put the columns of words, shape (n, k), to the registers from an address on."""
    for k, column in enumerate(np.asarray(encoded).T):
        words[first + k] = (column.astype(np.int64) & 0xFFFF).tolist()


def tilt(force: np.ndarray) -> np.ndarray:
    """Return the angle of each axis above the horizontal, rad (DS section 2.11)."""
    squares = force**2
    others = np.sqrt(squares.sum(axis=1, keepdims=True) - squares)
    return np.asarray(np.arctan2(force, others))


def create(at: Socket, **options: int) -> dict[str, EmulatedFrameBus]:
    """Return the bus of an SCL3300."""
    chip = Scl3300Chip(at.source, at.clock.now_ns(), **options)
    return {'': EmulatedFrameBus(at.name, at.line, chip)}
