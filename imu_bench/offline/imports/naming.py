# SPDX-License-Identifier: Apache-2.0
"""Names of topics and files for recordings that come from anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import re

from imu_bench.offline.recordings import Recording
from imu_bench.offline.recordings.sifting import OUTER

_SEPARATOR = re.compile(r'[^A-Za-z0-9_]+')
_DIGIT = re.compile(r'^(?=\d)')
_OWN = ('imu', 'data_raw')
_NAMELESS = 'imu'

_LONGEST = 120
"""Letters of a label: file systems have room for 255, also for what comes before and after."""


def token(words: str) -> str:
    """
    Return words as one part of a topic name.

    Source: ROS 2 design, "Topic and Service name mapping to DDS", rules of names: letters,
    digits and underscores, no digit first, no two underscores in a row.
    """
    plain = re.sub('__+', '_', _SEPARATOR.sub('_', words)).strip('_')
    return _DIGIT.sub(f'{_NAMELESS}_', plain) or _NAMELESS


def topic(name: str) -> str:
    """Return the name of a topic as ROS 2 accepts it; one that it accepts stays as it is."""
    if re.fullmatch(r'(?:/(?!\d)\w+)+', name, re.ASCII) and '__' not in name:
        return name
    parts = [token(part) for part in name.split('/') if part]
    return '/' + '/'.join(parts or [_NAMELESS])


def is_from_bag(recording: Recording) -> bool:
    """Return whether a recording was a topic of a bag."""
    return recording.stamp_source in ('header', OUTER, 'receive')


def label(recording: Recording) -> str:
    """Return a name for files: that of the file, or that of the topic without what all have."""
    if not is_from_bag(recording):
        return token(recording.topic)[:_LONGEST]
    parts = recording.topic.strip('/').split('/')
    if tuple(parts[-2:]) == _OWN and len(parts) > len(_OWN):
        parts = parts[: -len(_OWN)]
    return token('_'.join(parts))[:_LONGEST]


class Names:
    """Hands out each name once."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def claim(self, wanted: str, source: Path, below: Sequence[str] = ()) -> str:
        """Return a name; where it is taken, that of the source or its folder comes before it."""
        name = wanted
        if self._taken & _all(name, below):
            own, folder = token(source.stem), token(source.resolve().parent.name)
            said = own in wanted.strip('/').split('/')
            before = folder if said else own
            name = f'/{before}{wanted}' if wanted.startswith('/') else f'{before}_{wanted}'
        first, number = name, 1
        while self._taken & _all(name, below):
            number += 1
            name = f'{first}_{number}'
        self._taken |= _all(name, below)
        return name


def _all(name: str, below: Sequence[str]) -> set[str]:
    return {name, *(f'{name}/{last}' for last in below)}
