# SPDX-License-Identifier: Apache-2.0
"""Refuses outputs that cannot be written before hours of work, not after."""

from __future__ import annotations

from pathlib import Path

from imu_bench.errors import RecordingError


def check_output(path: Path | None) -> None:
    """
    Check that a file can be written.

    Raises
    ------
    RecordingError
        If the path is a folder, or is in a folder that does not exist.
    """
    if path is None:
        return
    if path.is_dir():
        raise RecordingError(f'{path} is a folder: name a file to write')
    if not path.parent.is_dir():
        raise RecordingError(f'{path}: the folder {path.parent} does not exist')


def check_folder(path: Path) -> None:
    """
    Check that a folder can be written to, or made.

    Raises
    ------
    RecordingError
        If the path is a file, or is in a folder that does not exist.
    """
    if path.exists() and not path.is_dir():
        raise RecordingError(f'{path} is a file: name a folder for the figures')
    if not path.parent.is_dir():
        raise RecordingError(f'{path}: the folder {path.parent} does not exist')
