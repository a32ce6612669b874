# SPDX-License-Identifier: Apache-2.0
"""
Lines that are no plain rows of numbers: sentences with checksums, dates, numbers without lines.

Each becomes the row that it stands for, before anything else looks at it.
"""

from __future__ import annotations

from datetime import date
from functools import cache
from pathlib import Path
import re

from imu_bench.errors import RecordingError

SENTENCES, DATES = 'sentences', 'dates'

_SENTENCE = re.compile(rb'^\$([^*\r\n$]*)\*([0-9A-Fa-f]{2})[ \t]*(\r?)$', re.MULTILINE)
"""NMEA 0183: a name and cells between $ and *, and the exclusive or of all their bytes."""

_DATE = (
    rb'(?<![\d.])(\d{4})[-/](\d\d)[-/](\d\d)([T ,;\t])[ ]?(\d\d):(\d\d):(\d\d)'
    rb'(?:\.(\d+)|,(\d+)(?=[;\t]))?'
    rb'(?:(Z)|([+-])(\d\d):?(\d\d))?(?![\d:])'
)
_MOMENT = re.compile(rb'^([^\r\n]*?)' + _DATE, re.MULTILINE)
"""The first date and time of a line, in one column or two (ISO 8601, RFC 3339)."""

_EPOCH = date(1970, 1, 1).toordinal()
_DAMAGED = b'damaged'
_SEPARATORS = (b',', b';', b'\t')


def spelled(sample: bytes) -> str:
    """Return how the lines of a text are spelled: 'sentences', 'dates', or '' for plain rows."""
    lines = max(1, sample.count(b'\n'))
    for name, pattern in ((SENTENCES, _SENTENCE), (DATES, _MOMENT)):
        if 2 * len(pattern.findall(sample)) > lines:
            return name
    return ''


def plain(block: bytes, how: str) -> bytes:
    r"""
    Return the rows that lines stand for; dates become seconds since 1970 UTC.

    A line whose checksum is wrong becomes a row without numbers.  A date without a zone is UTC.

    Examples
    --------
    >>> plain(b'$VNRRG,8,+006.271,+000.031,-002.000*66\n', 'sentences')
    b'VNRRG,8,+006.271,+000.031,-002.000\n'
    >>> plain(b'2001-09-09T01:46:40.5,1.0\n', 'dates')
    b'1000000000.5,1.0\n'
    """
    if how == SENTENCES:
        return _SENTENCE.sub(_checked, block)
    return _MOMENT.sub(_in_seconds, block) if how == DATES else block


def checksum(sentence: bytes) -> int:
    """Return the exclusive or of all bytes."""
    total = 0
    for byte in sentence:
        total ^= byte
    return total


def _checked(match: re.Match[bytes]) -> bytes:
    cells, told, end = match.groups()
    if checksum(cells) == int(told, 16):
        return cells + end
    return b','.join([_DAMAGED] * (cells.count(b',') + 1)) + end


def _in_seconds(match: re.Match[bytes]) -> bytes:
    before, year, month, day, between, hour, minute, second, point, comma, _, *zone = (
        match.groups()
    )
    sign, off_h, off_m = zone
    part = point or comma
    try:
        days = _days(year, month, day)
    except ValueError:  # a 31st of February: what is no row is said when it is read
        return match[0]
    seconds = days * 86400 + int(hour) * 3600 + int(minute) * 60 + int(second)
    if sign:
        seconds -= int(sign + b'1') * (int(off_h) * 3600 + int(off_m) * 60)
    cell = b'%d' % seconds + (b'.' + part if part else b'')
    # a blank between date and time is one between cells only where nothing else is
    line = match.string[match.end() : match.string.find(b'\n', match.end())]
    one = between == b'T' or (between == b' ' and any(mark in line for mark in _SEPARATORS))
    return before + cell if one else before + cell + between + cell


@cache
def _days(year: bytes, month: bytes, day: bytes) -> int:
    return date(int(year), int(month), int(day)).toordinal() - _EPOCH


def column_of_date(line: bytes, delimiter: str) -> int:
    """Return the column in which the first date of a line stands."""
    match = _MOMENT.match(line)
    if match is None:
        return -1
    return len(match[1].split()) if delimiter == ' ' else match[1].count(delimiter.encode())


def reflowed(path: Path, width: int) -> bytes:
    """
    Return rows of some numbers from numbers that stand on lines of any length.

    Lines before the first number are left out.

    Raises
    ------
    RecordingError
        If something among the numbers is none, or the last row is not whole.
    """
    words = re.split(rb'[\s,;]+', path.read_bytes().strip())
    first = next((k for k, word in enumerate(words) if _NUMBER.fullmatch(word)), len(words))
    numbers = words[first:]
    wrong = next((word for word in numbers if not _NUMBER.fullmatch(word)), None)
    if wrong is not None:
        shown = wrong[:20].decode('utf-8', 'replace')
        raise RecordingError(f'{path}: --layout {width}: {shown!r} among the numbers is none')
    if len(numbers) < 2 * width or len(numbers) % width:
        raise RecordingError(
            f'{path}: --layout {width}: {len(numbers)} numbers are no rows of {width}'
        )
    rows = (b' '.join(numbers[k : k + width]) for k in range(0, len(numbers), width))
    return b'\n'.join(rows) + b'\n'


_NUMBER = re.compile(rb'[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)', re.IGNORECASE)
