# SPDX-License-Identifier: Apache-2.0
"""
Samples that a microcontroller sends of its own accord, one in a line of text or a binary frame.

A line has values with commas between them and ends with a line feed.  A checked one has ``*`` and
two hexadecimal digits before it, the exclusive or of all characters before the star, as NMEA 0183
does it.  A line that begins with ``#`` is for people.

A frame is A5 5A, the values, low byte first, and their CRC-16/XMODEM, high byte first, which
`_crc_xmodem_update` of avr-libc (util/crc16.h) makes.

Which samples are missing, the counter of the microcontroller tells, its clock, or both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from binascii import crc_hqx
from functools import reduce
from operator import xor
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

SYNC = b'\xa5\x5a'

LONGEST = 512
"""Bytes of a line: thirty values with sixteen characters each."""


def checksum(line: bytes) -> int:
    """
    Return the exclusive or of all bytes.

    Examples
    --------
    The sentence of a GPS receiver that everybody prints:

    >>> f'{checksum(b"GPGLL,5300.97914,N,00259.98174,E,125926,A"):02X}'
    '28'
    """
    return reduce(xor, line, 0)


class Decoder(ABC):
    """
    What is in a stream, piece by piece.

    Attributes
    ----------
    size : int
        Bytes of the newest sample, 0 at first.
    checksum_errors, garbage : int
        Samples with a wrong checksum, and bytes that are in none.
    others : int
        Values in the newest line that is whole and has another number of them; 0 for none.
    example : bytes
        The newest bytes that could not be used.
    """

    def __init__(self) -> None:
        self._buffer = b''
        self.size = self.checksum_errors = self.garbage = self.others = 0
        self.example = b''

    @abstractmethod
    def feed(self, data: bytes) -> npt.NDArray[np.float64]:
        """Return the values of samples that are complete now, shape (n, values)."""

    def _reject(self, data: bytes) -> None:
        self.garbage += len(data)
        self.example = data[:40]


class TextDecoder(Decoder):
    r"""
    Lines of text.

    Parameters
    ----------
    values : int
        In each line.
    checked : bool
        Whether lines have a checksum.

    Examples
    --------
    What comes before the first line feed may be the end of a line:

    >>> TextDecoder(2, checked=False).feed(b'5,6\n1,-2.5\r\n3,').tolist()
    [[1.0, -2.5]]
    """

    def __init__(self, values: int, *, checked: bool) -> None:
        super().__init__()
        self._values, self._checked = values, checked
        self._begun = False

    def feed(self, data: bytes) -> npt.NDArray[np.float64]:
        """Return the values of lines that are complete now, shape (n, values)."""
        *lines, self._buffer = (self._buffer + data).split(b'\n')
        if len(self._buffer) > LONGEST:
            self._reject(self._buffer)
            self._buffer = b''
        if lines and not self._begun:
            self._begun = True
            lines = lines[1:]
        found = [row for line in lines if (row := self._values_of(line))]
        return np.array(found).reshape(len(found), self._values)

    def _values_of(self, line: bytes) -> list[float]:
        content = line.rstrip(b'\r')
        if not content or content[:1] == b'#':
            return []
        if self._checked:
            content, star, digits = content.rpartition(b'*')
            try:
                right = bool(star) and len(digits) == 2 and int(digits, 16) == checksum(content)
            except ValueError:
                right = False
            if not right:
                self.checksum_errors += 1
                self.example = line[:40]
                return []
        try:
            values = [float(value) for value in content.split(b',')]
        except ValueError:
            self._reject(line)
            return []
        if len(values) != self._values or not np.isfinite(values).all():
            self.others = len(values) if len(values) != self._values else 0
            self._reject(line)
            return []
        self.size = len(line) + 1
        return values


class BinaryDecoder(Decoder):
    """
    Binary frames.

    Parameters
    ----------
    layout : sequence of str
        The types of the values as numpy writes them, such as '<u2'.

    Examples
    --------
    >>> found = BinaryDecoder(['<u2', '<i2']).feed(bytes.fromhex('00 a55a 0100 feff 588a'))
    >>> found.tolist()
    [[1.0, -2.0]]
    """

    def __init__(self, layout: list[str]) -> None:
        super().__init__()
        self._layout = np.dtype([(str(k), dtype) for k, dtype in enumerate(layout)])
        self._whole = len(SYNC) + self._layout.itemsize + 2

    def feed(self, data: bytes) -> npt.NDArray[np.float64]:
        """Return the values of frames that are complete now, shape (n, values)."""
        buffer, start, found = self._buffer + data, 0, []
        while True:
            place = buffer.find(SYNC, start)
            if place < 0:
                place = len(buffer) - buffer.endswith(SYNC[:1])
            if place > start:
                self._reject(buffer[start:place])
                start = place
            frame = buffer[start : start + self._whole]
            if len(frame) < self._whole:
                break
            content = frame[len(SYNC) :]
            if crc_hqx(content, 0):  # of the content with its own remainder it is none
                self.checksum_errors += 1
                self._reject(frame[:1])
                start += 1
                continue
            found.append(content[:-2])
            self.size = self._whole
            start += self._whole
        self._buffer = buffer[start:]
        words = np.frombuffer(b''.join(found), self._layout)
        return np.column_stack([words[name].astype(float) for name in self._layout.names or ()])


COUNTS = 1 << 16
"""Where a counter of 16 bits begins anew; one of 32 bits does, too."""

TICKS = 1 << 32
"""Where micros() and millis() of an Arduino begin anew."""

APART = 0.5
"""Periods by which a sample may be late."""

CLOCK = 0.02
"""Assumed relative error of its clock over a gap: a ceramic resonator is good to 0.5 %."""

_Numbers = npt.NDArray[np.int64]


class Counted(NamedTuple):
    """
    What the numbers of some samples say.

    Attributes
    ----------
    missing : ndarray of int64, shape (n,)
        Samples that are missing before each; of those up to a jump.
    ages_ns : ndarray of int64, shape (n,)
        How much earlier than the last of them each was taken.
    jumped : bool
        The microcontroller began anew behind these.
    """

    missing: _Numbers
    ages_ns: _Numbers
    jumped: bool


class SampleCounter:
    """
    Follows the numbers from sample to sample.

    Parameters
    ----------
    rate_hz : float
        Nominal sample rate in Hz.

    Examples
    --------
    >>> counter = SampleCounter(100.0)
    >>> found = counter.take(3, np.array([65534, 65535, 2]), np.array([100, 10100, 40100]), None)
    >>> found.missing.tolist(), found.ages_ns.tolist()
    ([0, 0, 2], [40000000, 30000000, 0])
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_us = 1e6 / rate_hz
        self.begin()

    def begin(self) -> None:
        """Take the next sample as the first one."""
        self._last: tuple[int, int] | None = None

    def take(
        self, n: int, count: _Numbers | None, us: _Numbers | None, ms: _Numbers | None
    ) -> Counted:
        """
        Return what is missing; without any numbers that is nothing.

        Parameters
        ----------
        n : int
            Samples, one at least.
        count, us, ms : ndarray of int64, shape (n,), or None
            Number of each sample, and its time in µs or ms.
        """
        ticks, tick_us = (us, 1.0) if us is not None else (ms, 1e3)
        period = self._period_us / tick_us
        zeros = np.zeros(n, dtype=np.int64)
        counts, times = (zeros if given is None else given for given in (count, ticks))
        if self._last is None:
            self._last = int(counts[0]) - 1, int(times[0]) - round(period)
        steps = np.diff(counts, prepend=self._last[0]) % COUNTS
        passed = np.diff(times, prepend=self._last[1]) % TICKS
        self._last = int(counts[-1]), int(times[-1])
        elapsed = passed / period
        if count is None:
            steps = np.maximum(np.rint(elapsed) if ticks is not None else 1, zeros + 1).astype(int)
        off = (steps == 0) | (steps > COUNTS // 2)
        if ticks is not None:
            off |= passed > TICKS // 2
            # a loop that was late has left out what it does not count
            late = elapsed - steps > APART + CLOCK * steps
            steps = np.where(late, np.rint(elapsed), steps).astype(np.int64)
        jumps = np.flatnonzero(off)
        good = int(jumps[0]) if jumps.size else n
        in_us = passed if us is not None else steps * self._period_us
        at = np.cumsum(in_us[:good])
        ages = np.rint(1e3 * (at[-1:] - at)).astype(np.int64)
        return Counted(steps[:good] - 1, ages, bool(jumps.size))
