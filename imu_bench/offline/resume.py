# SPDX-License-Identifier: Apache-2.0
"""Results of single recordings, kept so that a stopped run goes on where it was."""

from __future__ import annotations

from contextlib import suppress
import dataclasses
import os
from pathlib import Path
import pickle
from typing import Any

from imu_bench.errors import RecordingError
from imu_bench.offline.pipeline import Order, Outcome
from imu_bench.offline.recordings.cache import fingerprint

_SUFFIX = '.result'
_ARRAYS = {
    ('numpy._core.multiarray', '_reconstruct'),
    ('numpy._core.multiarray', 'scalar'),
    ('numpy._core.numeric', '_frombuffer'),
    ('numpy.core.multiarray', '_reconstruct'),
    ('numpy.core.multiarray', 'scalar'),
    ('numpy.core.numeric', '_frombuffer'),
    ('numpy', 'ndarray'),
    ('numpy', 'dtype'),
}


class Finished:
    """
    Outcomes of recordings in a folder, one file each.

    Parameters
    ----------
    folder : Path or None
        Nothing is kept without one.
    order : Order
        What was asked; an outcome of another order is not found.
    """

    def __init__(self, folder: Path | None, order: Order) -> None:
        self._folder = folder
        self._order = order
        self._mine: list[Path] = []

    def get(self, path: Path) -> Outcome | None:
        """Return the outcome of a recording that has not changed since, None if there is none."""
        file = self._file(path)
        if file is None:
            return None
        try:
            with file.open('rb') as stored:
                found = _Outcomes(stored).load()
        except Exception:  # a damaged pickle raises whatever it likes: then work is done again
            return None
        return found if isinstance(found, Outcome) else None

    def put(self, path: Path, outcome: Outcome) -> None:
        """
        Keep an outcome; one with failures is not kept, so that it is tried again.

        Raises
        ------
        OSError
            If the folder cannot be written.
        """
        file = self._file(path)
        if file is None or outcome.failures:
            return
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished = file.with_suffix(f'.{os.getpid()}')
        unfinished.write_bytes(pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL))
        unfinished.replace(file)

    def forget(self) -> None:
        """Remove what this run has kept or found."""
        for file in self._mine:
            file.unlink(missing_ok=True)
        if self._folder is not None:
            with suppress(OSError):  # others have left something there
                self._folder.rmdir()

    def _file(self, path: Path) -> Path | None:
        if self._folder is None:
            return None
        try:
            key = fingerprint(path, self._order.options, self._order.settings)
        except OSError:
            return None
        file = self._folder / f'{path.stem}-{key[:16]}{_SUFFIX}'
        self._mine.append(file)
        return file


class _Outcomes(pickle.Unpickler):
    """Builds results and arrays and nothing else: a file in a folder may be anybody's."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _ARRAYS:
            return super().find_class(module, name)
        if module.startswith('imu_bench.'):
            found = super().find_class(module, name)
            if isinstance(found, type) and (
                dataclasses.is_dataclass(found) or hasattr(found, '_fields')
            ):
                return found
        raise RecordingError(f'{module}.{name} does not belong into a result')
