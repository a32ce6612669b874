# SPDX-License-Identifier: Apache-2.0
"""
The FIFO packets of TDK InvenSense's IIM-42652 and its relatives, with a header each.

DS-000401 rev. 1.2 (DS), section 6.1: packet 3 holds both sensors with 16 bits, packet 4 with
20; each carries the chip's own time.
"""

from __future__ import annotations

from imu_bench.errors import FrameError
import numpy as np

PACKET_16 = np.dtype(
    [
        ('header', 'u1'),
        ('acceleration', '>i2', 3),
        ('angular_velocity', '>i2', 3),
        ('temperature', 'i1'),
        ('timestamp', '>u2'),
    ]
)
PACKET_20 = np.dtype(
    [
        ('header', 'u1'),
        ('acceleration', '>i2', 3),
        ('angular_velocity', '>i2', 3),
        ('temperature', '>i2'),
        ('timestamp', '>u2'),
        ('low', 'u1', 3),
    ]
)
PACKETS = {16: PACKET_16, 20: PACKET_20}
HEADERS = {16: 0x68, 20: 0x78}
"""Both sensors and the timestamp of the sample; bits 1 and 0 say that a rate has changed."""

EMPTY = 0x80
RATE_CHANGED = 0x03
INVALID = -32768
"""DS section 6.2: no measurement; with 20 bits in the upper 16."""

LIMIT_20 = 524256
"""DS section 6.2: largest magnitude of 20 bits."""

SHORTEST, LONGEST = 0.85, 1.2
"""
Share of a period that may lie between two packets.

DS section 12.7 has 32/30 µs per tick without an external clock, the maker's driver 1 µs:
both are within, a packet that is missing is not.
"""


def unpack(data: bytes, bits: int) -> np.ndarray:
    r"""
    Return packets up to the first one that says that the FIFO is empty.

    Parameters
    ----------
    data : bytes
        Whole packets.
    bits : {16, 20}
        Length of the words.

    Raises
    ------
    FrameError
        If a header is not that of such a packet.

    Examples
    --------
    >>> packet = bytes.fromhex('68 0000 0000 0800 00A4 FF5C 0000 00 03E8')
    >>> found = unpack(packet + b'\xff' * 16, 16)
    >>> found['acceleration'].tolist(), found['timestamp'].tolist()
    ([[0, 0, 2048]], [1000])
    """
    packets = np.frombuffer(data, PACKETS[bits])
    empty = np.flatnonzero(packets['header'] & EMPTY)
    if empty.size:
        packets = packets[: empty[0]]
    wrong = np.flatnonzero((packets['header'] & ~np.uint8(RATE_CHANGED)) != HEADERS[bits])
    if wrong.size:
        header = int(packets['header'][wrong[0]])
        raise FrameError(
            f'FIFO packet with header 0x{header:02X} instead of 0x{HEADERS[bits]:02X}'
        )
    return packets


def words_20(packets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the 20-bit words of acceleration and angular velocity, shape (n, 3) each.

    Examples
    --------
    >>> text = '78 0000 FFFF 0800 00A3 FF5C 0000 052D 03E8 0C C4 00'
    >>> [words.tolist() for words in words_20(unpack(bytes.fromhex(text), 20))]
    [[[0, -4, 32768]], [[2620, -2620, 0]]]
    """
    low = packets['low'].astype(np.int32)
    acceleration = packets['acceleration'].astype(np.int32) * 16 + (low >> 4)
    return acceleration, packets['angular_velocity'].astype(np.int32) * 16 + (low & 0x0F)


def invalid(packets: np.ndarray) -> np.ndarray:
    """Return which packets lack a measurement, shape (n,)."""
    return np.asarray(
        (packets['acceleration'] == INVALID).any(axis=1)
        | (packets['angular_velocity'] == INVALID).any(axis=1)
    )


class Continuity:
    """
    Whether packets follow one another, by the time they carry.

    Parameters
    ----------
    rate_hz : float
        Output data rate.
    tick_us : int
        Length of a tick as configured.

    Examples
    --------
    >>> follow = Continuity(1000.0, 1)
    >>> follow.take(np.array([1000, 1938, 2875])), follow.take(np.array([3812, 5687]))
    (True, False)
    """

    def __init__(self, rate_hz: float, tick_us: int) -> None:
        self._periods_per_tick = tick_us * 1e-6 * rate_hz
        self._last: int | None = None

    def restart(self) -> None:
        """Expect any time next."""
        self._last = None

    def take(self, ticks: np.ndarray) -> bool:
        """Return whether none is missing before or among the next packets."""
        if not len(ticks):
            return True
        ticks = ticks.astype(np.int64)
        first = [] if self._last is None else [self._last]
        self._last = int(ticks[-1])
        periods = np.diff(np.concatenate([first, ticks])) % 65536 * self._periods_per_tick
        return bool(((periods >= SHORTEST) & (periods <= LONGEST)).all())
