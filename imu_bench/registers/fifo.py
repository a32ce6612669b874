# SPDX-License-Identifier: Apache-2.0
"""A FIFO of whole samples behind one register, as a document describes it."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.registers.fields import Declaration, Field, Register, Value
from imu_bench.registers.frames import Frame


@dataclass(frozen=True, eq=False, kw_only=True)
class Fifo(Declaration):
    """
    A FIFO that keeps the newest samples; with it a chip needs no emulator of its own.

    Examples
    --------
    >>> from imu_bench.registers import Codes, Vector
    >>> out, control = Register(0x08, access='ro', size=6), Register(0x2D)
    >>> force = Vector(first=out, quantity='acceleration', unit='m/s²', dtype='>i2',
    ...                si_per_lsb=0.01)
    >>> Fifo(port=Register(0x11), frame=Frame(force), depth=32, count=Register(0x05),
    ...      overrun=Field(Register(0x04), 2), rate=Field(control, (7, 4), Codes({100.0: 0})),
    ...      runs=(Field(control, 0), 1)).capacity
    32
    """

    port: Register  # reading it does not increment: it gives the next byte
    frame: Frame  # one sample
    depth: int  # samples
    count: Register  # how much is in it
    overrun: Field  # set when the oldest sample was overwritten
    rate: Field  # output data rate; its values are in Hz
    runs: tuple[Field, Value]  # samples are taken while the field has the value
    units: int = 1  # what the count counts by one sample: 1, or its entries, words or bytes
    low_pass: float = 0.5  # -3 dB frequency over the rate; a half or more filters nothing
    # bits that are set in every frame, such as a tag; as long as the frame, or none
    marks: bytes = b''
    # puts the watermark on the data-ready pin; the watermark, in `units`; lets the pin rise
    pin: tuple[Field, Register, Field] | None = None
    empty: bytes = b'\0'  # what an empty one gives, over and over

    @property
    def capacity(self) -> int:
        """Return the count of a full one."""
        return self.depth * self.units
