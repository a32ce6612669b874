# SPDX-License-Identifier: Apache-2.0
"""Files and folders that are there completely or not at all: a full disk leaves no half."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
import json
import os
from pathlib import Path
import re
import shutil
from typing import Any

from imu_bench.errors import RecordingError

UNFINISHED = '.unfinished-'
"""What names begin with while they are written; a process that is killed leaves such behind."""


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """
    Give the name of a draft to write, which becomes the file when the block has ended well.

    If it ends otherwise the draft is removed, and what was at the path before is still there.
    A device or a pipe is written to directly.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        yield path
        return
    target = path.resolve()
    draft = target.with_name(f'{UNFINISHED}{target.name}')
    try:
        yield draft
        draft.replace(target)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """
    Give the name of a folder to make, which moves to its place when the block has ended well.

    If it ends otherwise it is removed.  It has its last name from the beginning, since the files
    of a bag are named after it, and is made in a folder ``.unfinished-<name>`` beside that place;
    what a killed process has left there is removed.

    Parameters
    ----------
    path : path
        The folder; must not exist.

    Yields
    ------
    Path
        Where to make it.

    Raises
    ------
    RecordingError
        If it cannot be written; it names the folder, not the draft.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_folder(Path(folder) / 'bag') as draft:
    ...         draft.mkdir()
    ...     os.listdir(folder)
    ['bag']
    """
    path = Path(path)
    home = path.parent / f'{UNFINISHED}{path.name}'
    draft = home / path.name
    shutil.rmtree(home, ignore_errors=True)
    missing = [folder for folder in home.parents if not folder.exists()]
    try:
        home.mkdir(parents=True)
        yield draft
        draft.rename(path)
    except OSError as error:
        raise RecordingError(f'{path}: cannot be written: {error.strerror}') from error
    except RecordingError as error:
        if str(draft) not in str(error):
            raise  # about what is read, not about what is written
        # its second half says what is kept
        reason = str(error).replace(str(draft), str(path), 1).partition(';')[0]
        raise RecordingError(f'{reason}; what was written is removed') from error
    finally:
        shutil.rmtree(home, ignore_errors=True)
        with suppress(OSError):  # one that holds the folder stays
            for folder in missing:
                folder.rmdir()


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """
    Write a text file in UTF-8, completely or not at all.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    with whole(path) as draft:
        draft.write_text(text, encoding='utf-8')


def write_json(path: str | os.PathLike[str], document: Mapping[str, Any]) -> None:
    """Write a JSON document as all of ours are written, completely or not at all."""
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1)
    write_text(path, text + '\n')


def file_names(labels: Iterable[str]) -> list[str]:
    """
    Return names of files for sensors, each once, from characters that every system takes.

    Examples
    --------
    >>> file_names(['imu/left', 'imu:left', '../x'])
    ['imu_left', 'imu_left_2', 'x']
    """
    names: list[str] = []
    for label in labels:
        base = re.sub(r'[^A-Za-z0-9.-]+', '_', label).strip('._') or 'sensor'
        name, number = base, 2
        while name in names:
            name, number = f'{base}_{number}', number + 1
        names.append(name)
    return names
