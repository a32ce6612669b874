# SPDX-License-Identifier: Apache-2.0
"""A microcontroller seen from its serial line: docs/serial_bridge.md."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterable, Mapping
from typing import Any

from imu_bench.bus.framing.bridge import checksum, SYNC
from imu_bench.drivers.serial_bridge import COLUMNS, FORMATS, SerialBridge, WORDS
from imu_bench.emulators.ahead import Ahead, Source
from imu_bench.emulators.register_map import or_zero
from imu_bench.emulators.socket import Socket
from imu_bench.emulators.stream import EmulatedStream, StreamDevice
from imu_bench.samples import Samples
import numpy as np

BOOT_NS = 500_000_000
"""Until the sketch runs: assumed, a Nucleo takes less and an Arduino Uno more."""

IDLE_NS = 10_000_000_000
"""Nobody asked for so long: the samples in between are skipped."""


class _Number:
    """How many samples were taken."""

    state = 0


class Microcontroller(StreamDevice):
    """
    What the sketch of the document does, with the columns that are set.

    Parameters
    ----------
    source : Source
        What its sensor measures.
    start_ns : int
        Power-up.
    values : mapping
        Settings of the driver, which say what the sketch does.
    """

    def __init__(self, source: Source, start_ns: int, values: Mapping[str, Any]) -> None:
        self._values = values
        self.baud = int(values['baud'])
        self._columns = str(values['columns']).replace(' ', '').split(',')
        self._word = FORMATS[values['format']]
        self._source = Ahead(source, self.converted, lambda: (self._number,))
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin anew: the counter and the clock are at zero."""
        self._number = _Number()
        self._begun_ns = self._now_ns = at_ns + BOOT_NS
        self._source.restart(self._begun_ns, float(self._values['rate_hz']))

    def receive(self, data: bytes, at_ns: int) -> None:
        """Hear nothing: the sketch does not listen."""

    def advance(self, to_ns: int) -> Iterable[tuple[int, bytes]]:
        """Return the lines of the samples that are due."""
        if to_ns <= self._now_ns:
            return []
        if to_ns - self._now_ns > IDLE_NS:
            kept_ns = to_ns - IDLE_NS // 10
            self._source.rewind()
            rate_hz = float(self._values['rate_hz'])
            self._number.state += round((kept_ns - self._now_ns) * 1e-9 * rate_hz)
            self._source.restart(kept_ns)
        self._now_ns = to_ns
        return [
            (int(due.samples.stamps[k]), self._other(due.rows[k]) if self.foreign else due.rows[k])
            for due in self._source.until(to_ns)
            for k in range(due.first, due.last)
        ]

    def _other(self, line: bytes) -> bytes:
        """Return what another sketch would send: two values in a line."""
        return self._text('1,2').encode() if not self._word else line[:-1] + b'\x00'

    def converted(self, samples: Samples) -> list[bytes]:
        """Return the line or frame of each sample."""
        n = len(samples)
        numbers = self._number.state + np.arange(n)
        self._number.state += n
        micros = (samples.stamps - self._begun_ns) // 1000
        found: dict[str, np.ndarray] = {
            'n': numbers % (1 << 16),
            'us': micros % (1 << 32),
            'ms': micros // 1000 % (1 << 32),
            '-': np.zeros(n),
        }
        for quantity, columns in COLUMNS.items():
            si = or_zero(getattr(samples, quantity), (n, 3) if len(columns) == 3 else (n,))
            unit = float(self._values[f'{quantity}_unit'])
            words = getattr(SerialBridge, quantity).encode(si, trim=unit)
            found |= dict(zip(columns, np.atleast_2d(words.T), strict=True))
        if not self._word:
            return self._lines([found[column] for column in self._columns])
        layout = [(str(k), WORDS.get(c, self._word)) for k, c in enumerate(self._columns)]
        frames = np.zeros(n, dtype=layout)
        for k, column in enumerate(self._columns):
            words = found[column]
            if self._word == '<i2' and column not in WORDS:
                words = np.clip(np.rint(words), -(1 << 15), (1 << 15) - 1)
            frames[str(k)] = words
        return [
            SYNC + content + crc_hqx(content, 0).to_bytes(2, 'big')
            for content in (frame.tobytes() for frame in frames)
        ]

    def _lines(self, columns: list[np.ndarray]) -> list[bytes]:
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return [self._text(','.join(map(_spelled, row))).encode() for row in rows]

    def _text(self, line: str) -> str:
        star = f'*{checksum(line.encode()):02X}' if self._values['checked'] else ''
        return f'{line}{star}\r\n'


def _spelled(value: int | float) -> str:
    return str(value) if isinstance(value, int) else f'{value:.9g}'


def create(at: Socket, **options: Any) -> dict[str, EmulatedStream]:
    """Return the line of a microcontroller whose sketch does what the settings say."""
    values = at.driver.check_settings(options)
    device = Microcontroller(at.source, at.clock.now_ns(), values)
    return {'': EmulatedStream(at.name, at.clock, device, at.driver.wiring[''].serial_baud)}
