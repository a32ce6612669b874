# SPDX-License-Identifier: Apache-2.0
"""
Recordings of any kind into well-formed ones: bags of ROS 2, CSV, columns.

>>> from pathlib import Path
>>> form_of(Path('night.csv'), None), form_of(Path('night'), None)
('csv', 'mcap')
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from imu_bench.bags import metadata
from imu_bench.bags.writer import STORAGES
from imu_bench.errors import RecordingError
from imu_bench.offline.imports.outputs import BagOutput, ColumnOutput, Entry, Output, TableOutput
from imu_bench.offline.imports.taking import taken
from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.running.mapped import MappedLimit
from imu_bench.offline.running.pipeline import no_progress, Phase
from imu_bench.offline.running.workers import MAPPED_BYTES
from imu_bench.offline.whole_files import whole, whole_folder
from imu_bench.version import __version__

FORMS = (*STORAGES, 'csv', 'npy')
_FILES = ('.mcap', '.db3', '.bag', '.npy', '.npz', '.mat')


class Imported(NamedTuple):
    """What was written, and what the user must know."""

    entries: list[Entry]
    notes: list[str]


def form_of(output: Path, wanted: str | None) -> str:
    """
    Return the format of an output: the one wanted, CSV if its name says so, else mcap.

    Raises
    ------
    RecordingError
        If the name is that of a file, and the format is a folder.
    """
    suffix = output.suffix.lower()
    form = wanted or ('csv' if suffix == '.csv' else 'mcap')
    if suffix in _FILES or (suffix == '.csv' and form != 'csv'):
        what = 'columns are' if form == 'npy' else 'tables are' if form == 'csv' else 'a bag is'
        raise RecordingError(
            f'{output}: {what} a folder: name it without {output.suffix}, as in '
            f'-o {output.with_suffix("")} --to {form}'
        )
    return form


def import_recordings(
    paths: Sequence[Path],
    options: ReadOptions,
    output: Path,
    form: str,
    phase: Phase = no_progress,
) -> Imported:
    """
    Write recordings of any format into one output.

    Parameters
    ----------
    output : Path
        Must not exist.
    form : str
        One of `FORMS`.
    phase : callable, optional
        Shows progress.

    Raises
    ------
    RecordingError
        If an input cannot be read, or the output exists or cannot be written; then there is
        none.
    """
    if output.exists():
        raise RecordingError(f'{output}: exists already; name another output with -o')
    custom = _custom(paths) if form in STORAGES else {}
    entries: list[Entry] = []
    notes: list[str] = []
    with MappedLimit(MAPPED_BYTES), _opened(output, form, custom) as writer:
        for path in paths:
            with taken(path, options, phase) as found:
                total = sum(len(recording) for recording in (*found.imus, *found.beside))
                entries += writer.write(found, _Counted(phase(f'writing {output.name}'), total))
                notes += found.notes
    return Imported(entries, notes)


class _Counted:
    """Adds up samples for a progress bar."""

    def __init__(self, show: Callable[[int, int], None], total: int) -> None:
        self._show = show
        self._total = total
        self._done = 0

    def __call__(self, more: int) -> None:
        self._done += more
        self._show(self._done, self._total)


@contextmanager
def _opened(output: Path, form: str, custom: dict[str, str]) -> Iterator[Output]:
    """Give an output to write, which is removed unless the block ends well."""
    place = whole if output.suffix.lower() == '.csv' else whole_folder
    with place(output) as draft:
        writer: Output
        if form == 'csv':
            writer = TableOutput(draft, output)
        elif form == 'npy':
            writer = ColumnOutput(draft, output)
        else:
            writer = BagOutput(draft, form, custom)
        try:
            yield writer
        finally:
            writer.close()


def _custom(paths: Sequence[Path]) -> dict[str, str]:
    """Return the custom data of the bags among the inputs, such as that they were simulated."""
    found: dict[str, str] = {}
    for path in reversed(paths):
        file = path / metadata.FILE_NAME
        if file.is_file():
            with suppress(RecordingError, OSError):  # told when the bag is read
                found |= metadata.read(file).custom
    names = ', '.join(path.name for path in paths)
    return {**found, 'imported_by': f'imu_bench {__version__}', 'imported_from': names}
