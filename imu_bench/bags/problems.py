# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a file: each thing once, and not more lines than anybody reads."""

from __future__ import annotations

INCOMPLETE, COUNTS, STAMPS, NOT_A_NUMBER = 'incomplete', 'counts', 'stamps', 'not_a_number'
"""Codes: parts not read; announced is not stored; stamps replaced; values left out."""

PUBLISHERS = 'several_publishers'
"""Code: the topic of one sensor has messages of several."""

RECORDERS = 'several_recorders'
"""Code: another recorder of ours took the same."""

FLOODED = 'flooded'
"""Code: more was said on /diagnostics than was recorded."""

FOREIGN = 'foreign_topic'
"""Code: of none of the sensors of the bench that was recorded."""

SIMULATED = 'simulated'
"""Code: nothing measured the samples."""

REMARK = 'reading'
"""Code of what is no damage."""

_KEPT = 3


class Problem(str):
    """
    One line on what happened while a recording was read, and what kind of thing it is.

    Examples
    --------
    >>> Problem('a.mcap: cut off', INCOMPLETE).code, code_of('some words')
    ('incomplete', 'reading')
    """

    code: str  # one of the codes above
    topic: str  # if it is about one

    def __new__(cls, text: str, code: str = REMARK, topic: str = '') -> Problem:
        """Return the text with its code."""
        made = super().__new__(cls, text)
        made.code, made.topic = code, topic
        return made


def code_of(words: str) -> str:
    """Return the code of a problem; words alone are a remark."""
    return words.code if isinstance(words, Problem) else REMARK


class Problems:
    """The problems of one file, in the order found."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._kinds: dict[str, list[str]] = {}
        self._more: dict[str, int] = {}
        self._known: set[str] = set()

    def add(self, problem: str, kind: str = '') -> None:
        """Add a problem unless it is known; of one kind the first few are kept, then counted."""
        if problem in self._known:
            return
        self._known.add(problem)
        lines = self._kinds.setdefault(kind or problem, [])
        if len(lines) < _KEPT:
            lines.append(problem)
        else:
            self._more[kind] = self._more.get(kind, 0) + 1

    @property
    def lines(self) -> list[str]:
        """One line per problem."""
        found = []
        for kind, lines in self._kinds.items():
            found += lines
            if kind in self._more:
                found.append(f'{self._more[kind]} more {kind}')
        return [Problem(f'{self._name}: {line}', INCOMPLETE) for line in found]
