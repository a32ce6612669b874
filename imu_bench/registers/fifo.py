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

    Parameters
    ----------
    port : Register
        Reading it does not increment: it gives the next byte.
    frame : Frame
        One sample.
    depth : int
        Samples.
    count : Register
        How much is in it.
    units : int
        What the count counts by one sample: 1, or its entries, words or bytes.
    overrun : Field
        Set when the oldest sample was overwritten.
    rate : Field
        Output data rate; its values are in Hz.
    runs : (Field, value)
        Samples are taken while the field has the value.
    low_pass : float
        -3 dB frequency over the rate; a half or more filters nothing.
    marks : bytes
        Bits that are set in every frame, such as a tag; as long as the frame, or none.
    empty : bytes
        What an empty one gives, over and over.

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

    port: Register
    frame: Frame
    depth: int
    count: Register
    overrun: Field
    rate: Field
    runs: tuple[Field, Value]
    units: int = 1
    low_pass: float = 0.5
    marks: bytes = b''
    empty: bytes = b'\0'

    @property
    def capacity(self) -> int:
        """Return the count of a full one."""
        return self.depth * self.units
