# SPDX-License-Identifier: Apache-2.0
"""Registers behind Murata's SPI frames, where each answer comes one frame later."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from imu_bench.bus.framing import murata
from imu_bench.bus.interface import FrameBus
from imu_bench.errors import BenchError, ChecksumError, FrameError

SOFTWARE_RESET = murata.frame(0x0D, 0x20, write=True)  # DS table 13
NEUTRAL = murata.frame(0x10)
"""WHOAMI: the request that fetches the last answer of an exchange; reading it changes nothing."""


class OffFrameBus:
    """
    A RegisterBus of 16-bit words on a FrameBus, and exchanges of many frames.

    Every frame that comes back is checked: checksum, and whether it answers the request
    before it; the last request of an exchange is answered by the first frame of the next one.

    Parameters
    ----------
    counters : Counter
        Counts 'crc_errors' and 'frame_errors'.

    Examples
    --------
    >>> from imu_bench.bus.scripted import ScriptedFrames
    >>> steps = [('40000091', 'c0ffee00'), ('40000091', '4100c136')]
    >>> script = [(bytes.fromhex(out), bytes.fromhex(back)) for out, back in steps]
    >>> with ScriptedFrames(script) as wire:
    ...     OffFrameBus(wire, Counter()).read(0x10, 2).hex()
    '00c1'
    """

    def __init__(self, frames: FrameBus, counters: Counter[str]) -> None:
        self.name = frames.name
        self._frames = frames
        self._counters = counters
        self._asked: bytes | None = None

    def exchange(self, requests: Iterable[bytes]) -> Iterator[murata.Answer]:
        """
        Yield the answer to each request; each is yielded when the next request is out.

        Raises
        ------
        BusError
            If a transfer fails, or nothing drives the line.
        FrameError
            If an answer has a wrong checksum or belongs to another request.
        """
        first = True
        for request in (*requests, NEUTRAL):
            answer = self._transfer(request)
            if answer is not None and not first:
                yield answer
            first = False

    def read(self, register: int, length: int) -> bytes:
        """Return `length` bytes, two for each register from `register` on."""
        count = (length + 1) // 2
        requests = [murata.frame(register + k) for k in range(count)]
        return b''.join(answer.data.to_bytes(2, 'big') for answer in self.exchange(requests))

    def write(self, register: int, data: bytes) -> None:
        """Write one register; that it arrived is checked with the next frame."""
        self._transfer(murata.frame(register, int.from_bytes(data, 'big'), write=True))

    def close(self) -> None:
        """Release the device."""
        self._frames.close()

    def _transfer(self, request: bytes) -> murata.Answer | None:
        """Send a request; return the answer to the one before, None if there was none."""
        asked, self._asked = self._asked, None
        raw = self._frames.transfer(request)
        # what comes after a reset or a failure answers nothing that is known
        answer = None if asked is None else self._checked(raw, asked)
        self._asked = None if request == SOFTWARE_RESET else request
        return answer

    def _checked(self, raw: bytes, asked: bytes) -> murata.Answer:
        try:
            answer = murata.parse(raw)
        except ChecksumError as error:
            self._counters['crc_errors'] += 1
            raise ChecksumError(f'{self.name}: {error}; check wiring, CSB and clock') from error
        except BenchError as error:
            raise type(error)(f'{self.name}: {error}') from error
        if not answer.belongs_to(asked) or (answer.write and answer.data != _data_of(asked)):
            self._counters['frame_errors'] += 1
            raise FrameError(
                f'{self.name}: frame {raw.hex()} does not answer {asked.hex()}; check that CSB is '
                'high between frames'
            )
        return answer


def _data_of(request: bytes) -> int:
    return request[1] << 8 | request[2]
