# SPDX-License-Identifier: Apache-2.0
"""When the scenario of an emulated sensor begins: told by its file, or while it runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Beginning:
    """When a scenario begins; it may be told later, from another thread."""

    at_s: float = 0.0  # Unix time, s; 0 is when the sensor is switched on
