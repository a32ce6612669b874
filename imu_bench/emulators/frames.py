# SPDX-License-Identifier: Apache-2.0
"""A chip that exchanges frames, on a wire that takes its time."""

from __future__ import annotations

from typing import Protocol

from imu_bench.emulators.line import Line


class FrameChip(Protocol):
    """What a chip on frames does."""

    foreign: bool
    """Whether it answers as another part."""

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values."""
        ...

    def transfer(self, frame: bytes, at_ns: int) -> bytes:
        """Take a frame that begins at a time; return what goes out meanwhile."""
        ...


class EmulatedFrameBus:
    """A FrameBus on which an emulated chip lives."""

    acknowledges = False

    def __init__(self, name: str, line: Line, chip: FrameChip) -> None:
        self.name = name  # for error texts and diagnostics; says that it is emulated
        self.line = line
        self.chip = chip

    def transfer(self, frame: bytes) -> bytes:
        """Send a frame; return what the chip sent meanwhile."""
        return self.line.read(len(frame), lambda at_ns, _: self.chip.transfer(frame, at_ns))

    def close(self) -> None:
        """Do nothing: the chip stays where it is."""
