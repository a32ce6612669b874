# SPDX-License-Identifier: Apache-2.0
"""Columns on disk: one .npy file per quantity, written piece by piece."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import BinaryIO

from imu_bench.samples import Samples
import numpy as np

_HEADER_BYTES = 128


class ColumnWriter:
    """
    Writes the columns of one sensor.

    The files are plain .npy: ``stamps.npy`` (n,) in ns, ``acceleration.npy`` (n, 3) and so on;
    quantities at a rate of their own have stamps of their own, ``magnetic_field_stamps.npy``.

    Parameters
    ----------
    folder : Path
        Must not exist.
    beside : sequence of str
        Quantities that have stamps of their own.

    Raises
    ------
    OSError
        From any method, if the disk is full or fails.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> folder = Path(mkdtemp()) / 'chip'
    >>> writer = ColumnWriter(folder)
    >>> writer.write([Samples(stamps=[0, 10], temperature=[20.0, 21.0])])
    >>> writer.close()
    >>> np.load(folder / 'temperature.npy').tolist()
    [20.0, 21.0]
    """

    def __init__(self, folder: Path, beside: Sequence[str] = ()) -> None:
        folder.mkdir()
        self.count = 0  # samples of the main source
        self._folder = folder
        self._prefixes = ['', *(f'{quantity}_' for quantity in beside)]
        self._files: dict[str, tuple[BinaryIO, int, np.ndarray]] = {}

    def write(self, runs: Sequence[Samples]) -> None:
        """Append one run of each source."""
        self.count += len(runs[0])
        for prefix, run in zip(self._prefixes, runs, strict=True):
            self._write(prefix, run)

    def write_beside(self, quantity: str, run: Samples) -> None:
        """Append one run of a quantity with stamps of its own."""
        self._write(f'{quantity}_', run)

    def close(self) -> None:
        """Complete the headers and close the files."""
        for file, rows, empty in self._files.values():
            with file:
                file.seek(0)
                file.write(_header(empty, rows))
        self._files.clear()

    def abandon(self) -> None:
        """Close the files as they are."""
        for file, _, _ in self._files.values():
            with suppress(OSError):
                file.close()
        self._files.clear()

    def _write(self, prefix: str, run: Samples) -> None:
        for field in fields(run):
            values = getattr(run, field.name)
            if values is not None:
                name = f'{prefix}stamps' if field.name == 'stamps' else field.name
                self._append(name, values)

    def _append(self, name: str, values: np.ndarray) -> None:
        if name not in self._files:
            file: BinaryIO = (self._folder / f'{name}.npy').open('xb')
            file.write(_header(values[:0], 0))
            self._files[name] = (file, 0, values[:0])
        file, rows, empty = self._files[name]
        file.write(np.ascontiguousarray(values).data)
        self._files[name] = (file, rows + len(values), empty)


def _header(empty: np.ndarray, rows: int) -> bytes:
    """Return the header of a .npy file of version 1.0, always of the same length."""
    # Source: NEP 1, "A simple file format for NumPy arrays".
    shape = (rows, *empty.shape[1:])
    text = f"{{'descr': {empty.dtype.str!r}, 'fortran_order': False, 'shape': {shape!r}, }}"
    room = _HEADER_BYTES - 11
    content = f'{text:<{room}}\n'.encode('latin1')
    return b'\x93NUMPY\x01\x00' + len(content).to_bytes(2, 'little') + content
