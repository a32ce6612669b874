# SPDX-License-Identifier: Apache-2.0
"""Files that are there completely or not at all: a full disk leaves no half of a result."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """
    Give the name of a draft to write, which becomes the file when the block has ended well.

    If it ends otherwise the draft is removed, and what was at the path before is still there.
    A device or a pipe is written to directly.

    Parameters
    ----------
    path : path
        The file; a link stays one, what it points at is written.

    Yields
    ------
    Path
        Where to write; its suffix is that of the file.

    Raises
    ------
    OSError
        If the file cannot be written; it names the file, not the draft.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole(Path(folder) / 'a.json') as draft:
    ...         _ = draft.write_text('{}')
    ...     os.listdir(folder)
    ['a.json']
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        yield path
        return
    target = path.resolve()
    draft = target.with_name(f'.unfinished-{target.name}')
    try:
        yield draft
        draft.replace(target)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


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
