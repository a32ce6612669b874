# SPDX-License-Identifier: Apache-2.0
"""Results of single recordings, kept so that a stopped run goes on where it was."""

from __future__ import annotations

from contextlib import suppress
import json
import os
from pathlib import Path

from imu_bench.config.json_file import read_json
from imu_bench.offline.recordings.cache import fingerprint
from imu_bench.offline.running.pipeline import Order, Outcome

_SUFFIX = '.result'


class Finished:
    """Outcomes of recordings in a folder, one file each."""

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
            document = read_json(file)
            from imu_bench.offline.running import outcome_json

            return outcome_json.outcome_from_json(document)
        except (OSError, KeyError, TypeError, AttributeError, ValueError, OverflowError):
            return None  # damaged, or of another version: then the work is done again

    def put(self, path: Path, outcome: Outcome) -> None:
        """Keep an outcome; one with failures is not kept, so that it is tried again."""
        file = self._file(path)
        if file is None or outcome.failures:
            return
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished = file.with_suffix(f'.{os.getpid()}')
        from imu_bench.offline.running import outcome_json

        document = outcome_json.outcome_to_json(outcome)
        unfinished.write_text(json.dumps(document, allow_nan=False), 'utf-8')
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
