# SPDX-License-Identifier: Apache-2.0
"""Registers behind the serial line of a BNO055."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

from imu_bench.bus.framing import bosch_uart
from imu_bench.bus.interface import ByteStream, Clock
from imu_bench.errors import BusError, FrameError, NoAnswer

PAUSE_S = 0.002
"""Between an answer and the next command; what drivers found to be needed, not in the sheet."""

TIMEOUT_S = 0.05
TRIES = 4


class UartRegisters:
    """
    A RegisterBus on a serial line.

    Commands are sent in one piece, with a pause between them.  An overrun, which happens now
    and then on a busy chip, and an answer that does not fit are asked for again.

    Parameters
    ----------
    counters : Counter
        Counts 'uart_errors' before they are retried, and 'garbage_bytes'.
    silent : collection of int
        Registers after whose write the chip may say nothing, because it resets.

    Examples
    --------
    >>> from imu_bench.bus.clock import SystemClock
    >>> from imu_bench.bus.scripted import ScriptedStream
    >>> with ScriptedStream([(bytes.fromhex('aa010001'), bytes.fromhex('bb01a0'))]) as line:
    ...     UartRegisters(line, SystemClock(), Counter()).read(0x00, 1).hex()
    'a0'
    """

    def __init__(
        self,
        line: ByteStream,
        clock: Clock,
        counters: Counter[str],
        silent: Collection[int] = (),
    ) -> None:
        self.name = line.name
        self._silent = silent
        self._line = line
        self._clock = clock
        self._counters = counters
        self._decoder = bosch_uart.Decoder()
        # when the last command was begun, after the pause and whatever failed before it
        self.asked_ns = self._heard_ns = 0

    def read(self, register: int, length: int) -> bytes:
        """
        Return `length` bytes from `register` on, in one transaction.

        Raises
        ------
        NoAnswer
            If the chip says nothing.
        BusError
            If it refuses.
        FrameError
            If it answers something else.
        """
        answer = self._ask(bosch_uart.encode_read(register, length), length)
        return answer.data or b''

    def write(self, register: int, data: bytes) -> None:
        """Write bytes from `register` on, in one transaction; raises as `read`."""
        command = bosch_uart.encode_write(register, data)
        if register in self._silent:
            self._answer(command)
        else:
            self._ask(command, 0)

    def close(self) -> None:
        """Release the device."""
        self._line.close()

    def _ask(self, command: bytes, length: int) -> bosch_uart.Answer:
        where = f'{self.name}: register 0x{command[2]:02X}'
        problem: BusError | FrameError = NoAnswer(
            f'{where}: nothing answers; check power, PS1 and the baud rate'
        )
        for _ in range(TRIES):
            answer = self._answer(command)
            if answer is not None:
                size = 0 if answer.data is None else len(answer.data)
                if answer.code != bosch_uart.SUCCESS:
                    problem = BusError(f'{where}: the chip answers {answer.text}')
                elif size == length:
                    return answer
                else:
                    problem = FrameError(f'{where}: the answer belongs to another command')
                if answer.code not in (*bosch_uart.TRY_AGAIN, bosch_uart.SUCCESS):
                    break
            self._counters['uart_errors'] += 1
        raise problem

    def _answer(self, command: bytes) -> bosch_uart.Answer | None:
        """Send a command; return the first answer, None if none comes in time."""
        self._clock.sleep_until(self._heard_ns + round(PAUSE_S * 1e9))
        self._counters['garbage_bytes'] += len(self._line.read(0.0))
        garbage = self._decoder.garbage
        self.asked_ns = self._clock.now_ns()
        self._line.write(command)
        deadline = self._clock.now_ns() + round(TIMEOUT_S * 1e9)
        answers: list[bosch_uart.Answer] = []
        while not answers and (left := deadline - self._clock.now_ns()) > 0:
            data = self._line.read(left * 1e-9)
            if not data:
                break
            answers = self._decoder.feed(data)
        self._decoder.drop()
        self._counters['garbage_bytes'] += self._decoder.garbage - garbage
        self._heard_ns = self._clock.now_ns()
        return answers[0] if answers else None
