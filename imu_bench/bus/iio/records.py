# SPDX-License-Identifier: Apache-2.0
"""
Records of a buffer as the kernel describes them: Linux, Documentation/iio/iio_devbuf.rst.

A scan has the elements that are enabled in the order of their index, each aligned to its own
size, and the scan to its largest (drivers/iio/industrialio-buffer.c, iio_compute_scan_bytes).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import re

from imu_bench.errors import ConfigError
import numpy as np
import numpy.typing as npt

_TYPE = re.compile(r'(be|le):([suf])(\d+)/(\d+)(?:X(\d+))?(?:>>(\d+))?')
_FLOATS = {16: '2', 32: '4', 64: '8'}


@dataclass(frozen=True)
class Element:
    """How one channel stands in a record."""

    big: bool  # the first byte is the highest
    kind: str  # 's' for signed, 'u' for unsigned, 'f' for IEEE 754
    bits: int  # valid ones, after the shift
    storage: int  # bits that a value takes
    repeat: int = 1
    shift: int = 0

    @classmethod
    def parse(cls, text: str) -> Element:
        """
        Return what a file such as ``in_accel_x_type`` says.

        Raises
        ------
        ConfigError
            If it says what is not known.

        Examples
        --------
        >>> Element.parse('be:s12/16>>4')
        Element(big=True, kind='s', bits=12, storage=16, repeat=1, shift=4)
        """
        found = _TYPE.fullmatch(text.strip())
        if found is not None:
            order, kind, *numbers = found.groups(default='')
            bits, storage = int(numbers[0]), int(numbers[1])
            shift = int(numbers[3] or 0)
            fits = bits > 0 and bits + shift <= storage <= 64 and storage % 8 == 0
            if fits and (kind != 'f' or (storage in _FLOATS and bits == storage)):
                return cls(order == 'be', kind, bits, storage, int(numbers[2] or 1) or 1, shift)
        raise ConfigError(f'{text.strip()!r} is no type of a record that is known')

    @property
    def size(self) -> int:
        """Bytes, of all its repetitions."""
        return self.storage // 8 * self.repeat

    def decode(self, data: npt.NDArray[np.uint8]) -> npt.NDArray[np.generic]:
        """
        Return its values, shape (n, repeat), int64, uint64 or float64.

        Parameters
        ----------
        data : ndarray of uint8, shape (n, size)
            A record in each row.

        Examples
        --------
        >>> Element.parse('be:s12/16>>4').decode(np.array([[0xFF, 0xE7]], np.uint8)).tolist()
        [[-2]]
        """
        size = self.storage // 8
        bytes_ = data.reshape(len(data), self.repeat, size)
        if self.kind == 'f':
            floats = np.ascontiguousarray(bytes_).view(f'{">" if self.big else "<"}f{size}')
            return floats[..., 0].astype(np.float64)
        word = np.zeros(bytes_.shape[:2], np.uint64)
        for k in range(size) if self.big else reversed(range(size)):
            word = word << np.uint64(8) | bytes_[..., k].astype(np.uint64)
        # to the top, so that the sign comes down with it
        word = word << np.uint64(64 - self.bits - self.shift)
        if self.kind == 'u':
            return word >> np.uint64(64 - self.bits)
        return word.view(np.int64) >> np.int64(64 - self.bits)


class Layout:
    """Where each channel stands in a scan."""

    def __init__(self, elements: Mapping[str, Element]) -> None:
        self._places: dict[str, tuple[int, Element]] = {}
        end = 0
        for name, element in elements.items():
            start = -(-end // element.size) * element.size
            self._places[name] = start, element
            end = start + element.size
        largest = max((element.size for element in elements.values()), default=1)
        self.size = -(-end // largest) * largest  # bytes of a scan

    def decode(self, data: bytes) -> dict[str, npt.NDArray[np.generic]]:
        """Return every channel of whole scans, shape (n, repeat) each."""
        rows = np.frombuffer(data, np.uint8).reshape(-1, self.size)
        return {
            name: element.decode(rows[:, start : start + element.size])
            for name, (start, element) in self._places.items()
        }
