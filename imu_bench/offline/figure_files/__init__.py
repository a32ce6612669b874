# SPDX-License-Identifier: Apache-2.0
"""
Figures as files for a thesis or a paper: SVG, PDF and PNG of every sensor and of all together.

Matplotlib is an optional dependency: nothing here is imported before somebody asks for figures.
"""

from __future__ import annotations

from importlib import util
import logging

from imu_bench.errors import ConfigError

__all__ = ['require']


def require() -> None:
    """
    Check that figures can be drawn at all.

    Raises
    ------
    ConfigError
        If matplotlib is not installed.
    """
    if util.find_spec('matplotlib') is None:
        raise ConfigError(
            '--figures needs matplotlib, which is not installed: '
            "pip install matplotlib (or the extra 'figures' of imu_bench)"
        )
    # that it keeps its fonts elsewhere, where the home cannot be written to, changes no figure
    logging.getLogger('matplotlib').setLevel(logging.ERROR)
