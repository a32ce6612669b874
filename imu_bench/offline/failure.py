# SPDX-License-Identifier: Apache-2.0
"""An input without a result."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, eq=False)
class Failure:
    """An input that could not be analysed, and why."""

    source: str
    error: str
