# SPDX-License-Identifier: Apache-2.0
"""What the health check says: one finding is one sentence of fact, effect and advice each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

SEVERITIES = ('info', 'warning', 'severe')
"""In rising order: worth knowing; some results are affected; results are not to be trusted."""


@dataclass(frozen=True)
class Finding:
    """
    One thing that was found in a recording.

    Attributes
    ----------
    severity : str
        One of `SEVERITIES`.
    code : str
        Short fixed name for scripts, for example 'gaps'.
    text : str
        What was found, with numbers and where.
    effect : str
        What it does to the results.
    action : str
        What to do about it.
    """

    severity: str
    code: str
    text: str
    effect: str
    action: str

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object of schema imu_bench.analysis/1."""
        return {
            'severity': self.severity,
            'code': self.code,
            'text': self.text,
            'effect': self.effect,
            'action': self.action,
        }


def worst(findings: tuple[Finding, ...]) -> str:
    """
    Return the highest severity among findings; 'info' when there are none.

    Examples
    --------
    >>> worst(())
    'info'
    """
    return max((f.severity for f in findings), key=SEVERITIES.index, default='info')
