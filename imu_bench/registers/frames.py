# SPDX-License-Identifier: Apache-2.0
"""Words that travel together."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

from imu_bench.registers import words as wire_words
from imu_bench.registers.channels import Channel
from imu_bench.registers.fields import Declaration, Register
import numpy as np
import numpy.typing as npt


class Frame(Declaration):
    """
    Words that travel together, first byte first: a FIFO slot, a burst of registers.

    Parameters
    ----------
    *parts : Channel or Register
        A channel appears under its quantity, a register under its name.

    Examples
    --------
    >>> from imu_bench.registers import Vector
    >>> status = Register(0x02, access='ro')
    >>> status.__set_name__(object, 'STATUS')
    >>> out = Register(0x03, access='ro', size=6, reset=None)
    >>> field = Vector(first=out, quantity='magnetic_field', unit='T', dtype='<i2',
    ...                si_per_lsb=1.4e-8)
    >>> burst = Frame(status, field)
    >>> words = burst.unpack(bytes([1, 2, 0, 3, 0, 4, 0]))
    >>> burst.size, words['STATUS'].tolist(), words['magnetic_field'].tolist()
    (7, [1], [[2, 3, 4]])
    """

    def __init__(self, *parts: Channel | Register) -> None:
        self.parts = parts

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """Return the frame as a numpy structure."""
        return self._structure(wire=False)

    @cached_property
    def _wire(self) -> np.dtype[Any]:
        """Return the same as it travels; words of three bytes as their bytes."""
        return self._structure(wire=True)

    def _structure(self, *, wire: bool) -> np.dtype[Any]:
        fields = []
        for part in self.parts:
            if isinstance(part, Channel):
                shape = (part.components,) if part.components > 1 else ()
                if wire and wire_words.is_three(part.dtype):
                    fields.append((part.quantity, 'u1', (*shape, 3)))
                else:
                    fields.append((part.quantity, wire_words.held(part.dtype).str, shape))
            else:
                fields.append(
                    (part.name, f'{">" if part.order == "big" else "<"}u{part.size}', ())
                )
        return np.dtype(fields)

    @cached_property
    def _as_held(self) -> bool:
        return self._wire == self.dtype

    @cached_property
    def size(self) -> int:
        """Return bytes per frame."""
        return self._wire.itemsize

    def unpack(self, data: bytes) -> npt.NDArray[Any]:
        """Return the words of whole frames as a structured array, shape (n,)."""
        raw = np.frombuffer(data, dtype=self._wire)
        if self._as_held:
            return raw
        out = np.empty(len(raw), self.dtype)
        for part, name in self._named():
            out[name] = wire_words.widen(raw[name], part) if part else raw[name]
        return out

    def pack(self, words: Mapping[str, Any], frames: int) -> bytes:
        """Return the bytes of `frames` frames; parts that are not given are zero."""
        out = np.zeros(frames, dtype=self._wire)
        for part, name in self._named():
            if name in words:
                out[name] = wire_words.narrow(words[name], part) if part else words[name]
        return out.tobytes()

    def _named(self) -> list[tuple[str, str]]:
        """Return the name of each part, behind its dtype if its words have three bytes."""
        return [
            (part.dtype if wire_words.is_three(part.dtype) else '', part.quantity)
            if isinstance(part, Channel)
            else ('', part.name)
            for part in self.parts
        ]
