# SPDX-License-Identifier: Apache-2.0
"""How results are shown: pages, figures, tables and words; each is described once."""

from __future__ import annotations

from importlib import util
import logging

from imu_bench.errors import ConfigError


def require_matplotlib(option: str = '--figures') -> None:
    """Check that figures can be written as files; matplotlib is an optional dependency."""
    if util.find_spec('matplotlib') is None:
        raise ConfigError(
            f'{option} needs matplotlib, which is not installed: '
            "pip install matplotlib (or the extra 'figures' of imu_bench)"
        )
    # that it keeps its fonts elsewhere, where the home cannot be written to, changes no figure
    logging.getLogger('matplotlib').setLevel(logging.ERROR)
