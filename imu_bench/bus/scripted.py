# SPDX-License-Identifier: Apache-2.0
"""
Wires that play a script: what is expected, and what the chip answers.

For tests with bytes from a document.  A transfer that differs from the script is an error,
and so is a script that was not played to its end.
"""

from __future__ import annotations

from collections.abc import Iterable

from imu_bench.errors import BusError, FrameError

Answer = bytes | BusError


class _Script:
    """The steps still to come."""

    name = 'script'

    def __init__(self, steps: Iterable[tuple[object, Answer]]) -> None:
        self._steps = list(steps)
        self.closed = False

    def _play(self, done: object) -> bytes:
        if not self._steps:
            raise FrameError(f'the script is over, but this came: {done!r}')
        expected, answer = self._steps.pop(0)
        if done != expected:
            raise FrameError(f'the script expects {expected!r}, but this came: {done!r}')
        if isinstance(answer, BusError):
            raise answer
        return answer

    def finish(self) -> None:
        """
        Check that everything was played.

        Raises
        ------
        FrameError
            With the next step that was not.
        """
        if self._steps:
            raise FrameError(
                f'{len(self._steps)} step(s) of the script were not played; next: '
                f'{self._steps[0][0]!r}'
            )

    def close(self) -> None:
        """Release the device."""
        self.closed = True

    def __enter__(self) -> _Script:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.finish()


class ScriptedRegisters(_Script):
    """
    A RegisterBus that plays a script.

    Steps are ``(('read', register, length), answer)`` and ``(('write', register, data), b'')``;
    an answer that is a BusError is raised.

    Examples
    --------
    >>> with ScriptedRegisters([(('read', 0x75, 1), bytes([0x71]))]) as bus:
    ...     bus.read(0x75, 1).hex()
    '71'
    """

    def read(self, register: int, length: int) -> bytes:
        """Return the scripted answer."""
        return self._play(('read', register, length))

    def write(self, register: int, data: bytes) -> None:
        """Check the bytes against the script."""
        self._play(('write', register, data))


class ScriptedFrames(_Script):
    """A FrameBus from steps ``(frame, answer)``."""

    def transfer(self, frame: bytes) -> bytes:
        """Return the scripted answer to a frame."""
        return self._play(frame)


class ScriptedStream(_Script):
    """
    A ByteStream from steps ``(bytes written, bytes that arrive because of them)``.

    Examples
    --------
    >>> line = ScriptedStream([(b'AT', b'OK')])
    >>> line.write(b'AT')
    >>> line.read(1.0), line.read(1.0)
    (b'OK', b'')
    """

    baud = 115200

    def __init__(self, steps: Iterable[tuple[object, Answer]], arriving: bytes = b'') -> None:
        super().__init__(steps)
        self._arrived = arriving

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived."""
        arrived, self._arrived = self._arrived, b''
        return arrived

    def write(self, data: bytes) -> None:
        """Check the bytes against the script; the answer can then be read."""
        self._arrived += self._play(data)
