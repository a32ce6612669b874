# SPDX-License-Identifier: Apache-2.0
"""What acquisition needs of others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Protocol

from imu_bench.samples import Samples


class Device(Protocol):
    """A driver on its bus."""

    counters: Counter[str]
    continuity: int
    dated: bool
    skipped: dict[int, int]
    edge: tuple[int, int] | None
    latch_ns: int | None

    @property
    def rate_hz(self) -> float: ...
    @property
    def rates_hz(self) -> Mapping[str, float]: ...
    @property
    def paced(self) -> bool: ...
    @property
    def poll_period_s(self) -> float: ...
    def identify(self) -> str: ...
    def configure(self) -> None: ...
    def start(self) -> None: ...
    def stop(self) -> None: ...
    def close(self) -> None: ...
    def read(self) -> list[Samples]: ...


class Tape(Protocol):
    """What records the wire of a device, or plays it."""

    @property
    def said(self) -> str:
        """What it does, for people."""
        ...

    @property
    def problem(self) -> str:
        """What went wrong with it; empty while all is well."""
        ...

    def begin(self) -> None:
        """
        Sampling begins.

        Raises
        ------
        RecordingError
            If there is nothing to play.
        """
        ...

    def finish(self) -> None:
        """Sampling ends."""
        ...


class NoTape:
    """Records and plays nothing."""

    said = problem = ''

    def begin(self) -> None:
        """Do nothing."""

    def finish(self) -> None:
        """Do nothing."""
