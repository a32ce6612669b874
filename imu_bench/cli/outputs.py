# SPDX-License-Identifier: Apache-2.0
"""Refuses outputs that cannot be written before hours of work, not after."""

from __future__ import annotations

from collections.abc import Iterable
import os
from pathlib import Path

from imu_bench.errors import RecordingError


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[str | Path] = ()) -> None:
    """
    Check that files can be written, each one another, and none of them over an input.

    Parameters
    ----------
    outputs : iterable of Path or None
        Files to be written; None for one that is not wanted.
    inputs : iterable of str or Path
        Files and folders that are read.

    Raises
    ------
    RecordingError
        If a path is a folder, is in a folder that does not exist or may not be written to, or
        is named twice.
    """
    taken = {Path(path).resolve(): 'an input' for path in inputs}
    for path in outputs:
        if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
            continue  # a device or a pipe takes anything
        if path.is_dir():
            raise RecordingError(f'{path} is a folder: name a file to write')
        _check_parent(path)
        role = taken.setdefault(path.resolve(), '')
        if role:
            raise RecordingError(f'{path} is {role}, too: name another file to write')
        taken[path.resolve()] = 'another output'


def check_folder(path: Path) -> None:
    """
    Check that a folder can be written to, or made.

    Raises
    ------
    RecordingError
        If the path is a file, or is in a folder that does not exist or may not be written to.
    """
    if path.exists() and not path.is_dir():
        raise RecordingError(f'{path} is a file: name a folder for the figures')
    _check_parent(path / 'figure' if path.is_dir() else path)


def _check_parent(path: Path) -> None:
    if not path.parent.is_dir():
        raise RecordingError(f'{path}: the folder {path.parent} does not exist')
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise RecordingError(f'{path}: no permission to write in the folder {path.parent}')
