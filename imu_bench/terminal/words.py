# SPDX-License-Identifier: Apache-2.0
"""Text for a terminal or a pipe: nothing in it steers a terminal or fails to be written."""

from __future__ import annotations

import codecs
import sys

from imu_bench.counting import clean, SPACES

DONE, FAULT, USAGE, INTERRUPTED = 0, 1, 2, 130
"""Exit codes: done; the input or the machine is at fault; wrong usage; stopped with Ctrl-C."""

_LONGEST = 2000
"""Characters of an error line; a file at fault can put any number of its own into it."""

_FORGIVING = 'imu_bench.spaces'


def forgiving() -> str:
    """
    Return the name of an error handler for text that an encoding does not know.

    A narrow space becomes a space, everything else a question mark.

    Examples
    --------
    >>> '3\u202f600 µg'.encode('ascii', forgiving())
    b'3 600 ?g'
    """
    codecs.register_error(_FORGIVING, _nearest)
    return _FORGIVING


def _nearest(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    part = error.object[error.start : error.end]
    return ''.join(' ' if c in SPACES else '?' for c in part), error.end


def complain(message: str) -> None:
    """
    Print one error line on stderr.

    Characters that would steer a terminal are made visible; what nobody would read is left out.
    """
    words = clean(' '.join(message.split()))
    shown = words if len(words) <= _LONGEST else f'{words[:_LONGEST]}... (and more of it)'
    print(f'imu-bench: error: {shown}', file=sys.stderr)
