# SPDX-License-Identifier: Apache-2.0
"""How a text file is laid out: delimiter, header, lines before the table."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
import re

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import spelling

SAMPLE = 1 << 18
"""Bytes at the beginning of a file in which its layout must show."""

_MAX_LINES = 400
_LEAST_ROWS = 2
_LEAST_SHARE = 0.5
_DELIMITERS = (',', ';', '\t', ' ')
_COMMENT = ('#', '%', '//')
_UTF8_MARK = b'\xef\xbb\xbf'
_UTF16_MARKS = (b'\xff\xfe', b'\xfe\xff')
_DECIMAL_COMMA = re.compile(r'^[+-]?\d*,\d+(?:[eE][+-]?\d+)?$')
_RATE_LINE = re.compile(
    r'^\W*(?:fs|f_s|odr|rate|(?:sample|sampling)[ _]?(?:rate|frequency)|frequency)\W+'
    r'(\d+(?:\.\d+)?)',
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Layout:
    """Layout of a table in a text file."""

    delimiter: str  # ',', ';', tab, or a blank for any run of blanks
    width: int  # number of columns
    header: tuple[str, ...]  # names of the columns as written; empty without a header
    start: int  # byte at which the first row begins
    numeric: tuple[bool, ...]  # which columns hold numbers
    filled: tuple[float, ...] = ()  # share of the rows in which each column is not empty
    decimal_comma: bool = False  # whether numbers are written 9,81
    # sample rate that a line before the table mentions, in Hz; '' if none does
    stated_rate: str = ''
    spelled: str = ''  # how its lines are spelled, as `spelling.spelled` names it
    moment: int = -1  # column that holds dates, -1 if none does


def detect(path: Path) -> Layout:
    """Return the layout of a text file."""
    with path.open('rb') as file:
        sample = file.read(SAMPLE)
    layout = detect_in(sample)
    if layout is None:
        raise RecordingError(f'{path}: not a recording: {_instead(sample)}')
    return layout


def _instead(sample: bytes) -> str:
    """Return what a text without a table is."""
    if sample.startswith(_UTF16_MARKS):
        return 'UTF-16 text: save it as UTF-8'
    words = sample.decode('utf-8', 'replace').replace(',', ' ').split()
    if len(words) > 1 and all(map(is_number, words[:-1])):
        return 'numbers without rows: say how many make a sample, as in --layout 6'
    return 'neither a bag nor a table of numbers with a delimiter'


def detect_in(sample: bytes) -> Layout | None:
    """Return the layout of the text that begins with these bytes, None if there is no table."""
    if b'\0' in sample:
        return None
    whole = sample.endswith(b'\n') or len(sample) < SAMPLE
    how = spelling.spelled(sample)
    written = sample.removeprefix(_UTF8_MARK)
    # as many lines as are written, and no plain row is changed
    lines, rows = written.split(b'\n'), spelling.plain(written, how).split(b'\n')
    if not whole and len(lines) > 1:
        lines.pop()
        rows.pop()
    text = [line.decode('utf-8', 'replace').rstrip('\r') for line in rows[:_MAX_LINES]]
    tables = [table for delimiter in _DELIMITERS if (table := _table(text, delimiter)) is not None]
    if not tables:
        return None
    # the most rows, then the most columns
    first, _, width, delimiter, comma = max(tables, key=lambda table: (table[1], table[2]))
    start = len(sample) - len(sample.removeprefix(_UTF8_MARK))
    start += sum(len(line) + 1 for line in lines[:first])
    numeric, filled = _contents(text[first:], delimiter, width, comma)
    return Layout(
        delimiter=delimiter,
        width=width,
        header=_header(text[:first], delimiter, width),
        start=start,
        numeric=numeric,
        filled=filled,
        decimal_comma=comma,
        stated_rate=_stated_rate(text[:first]),
        spelled=how,
        moment=spelling.column_of_date(lines[first], delimiter) if how == spelling.DATES else -1,
    )


def split(line: str, delimiter: str) -> list[str]:
    """Return the fields of a line, stripped of blanks and quotes."""
    fields = line.split() if delimiter == ' ' else line.split(delimiter)
    return [field.strip().strip('"') for field in fields]


def is_number(field: str, decimal_comma: bool = False) -> bool:
    """Return whether a field is written as a number, NaN and infinity included."""
    if decimal_comma and _DECIMAL_COMMA.match(field):
        return True
    try:
        float(field)
    except ValueError:
        return False
    return '_' not in field


def _table(text: list[str], delimiter: str) -> tuple[int, int, int, str, bool] | None:
    """Return first line, number of rows, width, delimiter and decimal comma of a table."""
    comma = delimiter != ',' and any(
        _DECIMAL_COMMA.match(field)
        for line in text
        if len(fields := split(line, delimiter)) > 1
        for field in fields
    )
    widths: dict[int, int] = {}
    for index, line in enumerate(text):
        fields = split(line, delimiter)
        filled = [field for field in fields if field]
        numbers = sum(is_number(field, comma) for field in filled)
        # a few columns of text may stand beside the numbers
        if 2 * numbers > len(filled) and not line.startswith(_COMMENT):
            widths[index] = len(fields)
    if not widths:
        return None
    width, rows = Counter(widths.values()).most_common(1)[0]
    first = min(index for index, found in widths.items() if found == width)
    after = sum(1 for line in text[first:] if line.strip())
    if rows < _LEAST_ROWS or rows < _LEAST_SHARE * after:
        return None
    return first, rows, width, delimiter, comma


def _header(before: list[str], delimiter: str, width: int) -> tuple[str, ...]:
    for line in reversed(before):
        names = split(line.lstrip('#%/ '), delimiter)
        if not any(names):
            continue
        if any(is_number(name) for name in names if name):
            return ()
        if len(names) == width - 1:
            names.append('')  # rows end with a delimiter, the header does not
        return tuple(names) if len(names) == width else ()
    return ()


def _contents(
    rows: list[str], delimiter: str, width: int, comma: bool
) -> tuple[tuple[bool, ...], tuple[float, ...]]:
    """Return by column whether it holds numbers, and the share of rows that fill it."""
    table = [fields for row in rows if len(fields := split(row, delimiter)) == width]
    numeric, filled = [], []
    for column in zip(*table, strict=True):
        cells = [cell for cell in column if cell]
        numbers = sum(is_number(cell, comma) for cell in cells)
        numeric.append(2 * numbers >= len(cells))
        filled.append(len(cells) / len(table))
    return tuple(numeric), tuple(filled)


def _stated_rate(before: list[str]) -> str:
    for line in before:
        if match := _RATE_LINE.match(line):
            return match[1]
    return ''
