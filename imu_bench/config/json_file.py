# SPDX-License-Identifier: Apache-2.0
"""Reading JSON of bounded size, depth and numbers."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

_LARGEST = 1 << 27
"""Bytes; the result of an hour of one sensor has 160 000."""

_MOST = 4_000_000
"""Entries; such a result has 6000, and each takes some 100 bytes when it is read."""

_DIGITS = 40
"""Of a whole number: a damaged file may have claimed any count of 64 bits, not more."""


def read_json(path: Path) -> Any:
    """
    Return the document in a JSON file.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not JSON, too large, nested too deeply, or a number in it is out of range.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> path = Path(mkdtemp()) / 'a.json'
    >>> _ = path.write_text('{"value": [1, 2.5, null]}')
    >>> read_json(path)
    {'value': [1, 2.5, None]}
    """
    with path.open('rb') as file:
        text = file.read(_LARGEST + 1)
    if len(text) > _LARGEST:
        raise ValueError(f'larger than {_LARGEST >> 20} MiB')
    if text.count(b',') + text.count(b'[') + text.count(b'{') > _MOST:
        raise ValueError(f'more than {_MOST} entries')
    try:
        return json.loads(
            text, parse_int=_integer, parse_float=_float, parse_constant=_no_constant
        )
    except RecursionError as problem:
        raise ValueError('nested too deeply') from problem


def _integer(text: str) -> int:
    if len(text) > _DIGITS:
        raise ValueError(f'a number of {len(text)} digits in it is out of range')
    return int(text)


def _float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError('a number in it is out of range')
    return value


def _no_constant(name: str) -> float:
    raise ValueError(f'{name} in it is no number of JSON')
