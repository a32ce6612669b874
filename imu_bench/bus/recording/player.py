# SPDX-License-Identifier: Apache-2.0
"""A clock and the wires of a sensor out of a file, in the place of both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from imu_bench.bus.interface import Clock
from imu_bench.bus.recording.events import Event, Kind, spoken, unpacked_error
from imu_bench.bus.recording.file import Reading
from imu_bench.bus.recording.wires import KINDS
from imu_bench.errors import RecordingError, RecordingOver
from imu_bench.version import __version__

BEHIND_NS = 500_000_000
"""Who is further behind the recorded time than that does not race to catch up."""

PAUSE_NS = 2_000_000_000
"""A longer pause, such as between configuring and activating, is cut to this."""


class Player:
    """
    Gives what was recorded, in the same order.

    It is the Clock for driver and acquisition: its times are those of the recording.  Where the
    clock was read, it waits until as much time has passed as then.

    Parameters
    ----------
    path : str or Path
        The wire recording.
    pace : Clock
        Waits; a simulated one plays as fast as possible.

    Raises
    ------
    RecordingError
        If there is no such file, or it is no wire recording.
    """

    problem = ''  # nothing can go wrong that does not end the acquisition

    def __init__(self, path: str | Path, pace: Clock) -> None:
        self._path = path
        self._pace = pace
        self._reading = Reading(path)
        self._events = self._reading.events()
        self.head = self._reading.head
        self._parts = [wire.part for wire in self.head.wires]
        self._next: Event | None = None
        self._number = 0
        self._over: RecordingError | None = None
        self._first_ns = self._time_ns = 0
        self._shift_ns: int | None = None
        try:
            self.wires: Mapping[str, Any] = {
                wire.part: KINDS[wire.kind](wire, partial(self._exchange, number))
                for number, wire in enumerate(self.head.wires)
            }
        except KeyError as error:
            raise self._stop(f'a wire of the unknown kind {error}') from error

    @property
    def said(self) -> str:
        """What it does, for people."""
        return f'playing {self._path}, {self._elapsed_s:.3f} s'

    def now_ns(self) -> int:
        """Return the time that was read then, no sooner than then."""
        event = self._take(0, Kind.TIME, b'')
        self._time_ns = event.time_ns
        self._first_ns = self._first_ns or event.time_ns
        self._keep_pace(event.time_ns)
        return event.time_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """
        Return at once: the next reading of the clock waits.

        Raises
        ------
        RecordingOver
            If there is nothing more to wait for.
        """
        self._look()

    def sleep(self, seconds: float) -> None:
        """
        Return at once: the next reading of the clock waits.

        Raises
        ------
        RecordingOver
            If there is nothing more to wait for.
        """
        self._look()

    def begin(self) -> None:
        """
        Check that there is something to play.

        Raises
        ------
        RecordingError
            If it is over, stopped or cannot be played.
        """
        self._look()

    def finish(self) -> None:
        """Play no further; a recording is played from its beginning or not at all."""
        if self._over is None:
            self._end(
                RecordingOver(
                    f'{self._path}: stopped after {self._elapsed_s:.3f} s; to play it from its '
                    'beginning, clean up and configure'
                )
            )

    @property
    def _elapsed_s(self) -> float:
        return (self._time_ns - self._first_ns) * 1e-9

    def _keep_pace(self, time_ns: int) -> None:
        now_ns = self._pace.now_ns()
        ahead_ns = 0 if self._shift_ns is None else time_ns + self._shift_ns - now_ns
        if self._shift_ns is None or not -BEHIND_NS < ahead_ns < PAUSE_NS:
            ahead_ns = min(max(ahead_ns, 0), PAUSE_NS)
            self._shift_ns = now_ns + ahead_ns - time_ns
        if ahead_ns > 0:
            self._pace.sleep_until(time_ns + self._shift_ns)

    def _exchange(self, part: int, kind: int, request: bytes, live: Callable[[], bytes]) -> bytes:
        event = self._take(part, kind, request)
        if event.failed:
            try:
                error = unpacked_error(event.answer)
            except RecordingError as problem:
                raise self._stop(str(problem)) from problem
            raise error
        return event.answer

    def _take(self, part: int, kind: int, request: bytes) -> Event:
        event = self._look()
        if (event.kind, event.part, event.request) != (kind, part, request):
            asked = spoken(kind, self._part(part), request)
            recorded = spoken(event.kind, self._part(event.part), event.request)
            raise self._stop(f'asked: {asked}; recorded: {recorded}')
        self._next = None
        self._number += 1
        return event

    def _look(self) -> Event:
        """Return the next event without taking it."""
        if self._over is not None:
            raise type(self._over)(str(self._over))
        if self._next is None:
            try:
                self._next = next(self._events, None)
            except RecordingError as error:
                self._end(error)
                raise
        if self._next is None:
            unread = self._reading.unread
            cut = '' if self._reading.whole else f'; cut off there ({unread} bytes unread)'
            raise self._end(
                RecordingOver(
                    f'{self._path}: over after {self._elapsed_s:.3f} s, {self._number} events{cut}'
                )
            )
        return self._next

    def _part(self, number: int) -> str:
        return self._parts[number] if number < len(self._parts) else f'die {number}'

    def _stop(self, reason: str) -> RecordingError:
        """Return the error with which playing ends, with where."""
        advice = (
            f'it was recorded with imu_bench {self.head.version}, this is {__version__}: play it '
            'with that version'
            if self.head.version != __version__
            else 'driver or acquisition have changed since, play it with the code that recorded it'
        )
        place = f'event {self._number + 1} at {self._elapsed_s:.6f} s'
        return self._end(RecordingError(f'{self._path}: {place}: {reason}; {advice}'))

    def _end(self, error: RecordingError) -> RecordingError:
        """Play no further; whoever asks hears why."""
        self._over = error
        self._reading.close()
        return error


class Played:
    """A driver on a recording: nothing has to be stopped, and nothing is released."""

    def __init__(self, driver: Any) -> None:
        self._driver = driver

    def __getattr__(self, name: str) -> Any:
        """Return whatever the driver has."""
        return getattr(self._driver, name)

    def stop(self) -> None:
        """Do nothing: a recording ends before the stream is stopped."""

    def close(self) -> None:
        """Do nothing."""
