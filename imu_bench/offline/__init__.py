# SPDX-License-Identifier: Apache-2.0
"""
The front door of the offline tools: recordings in, numbers with their uncertainty out.

What is here is imported when it is first used, so that nobody waits for what is not needed.

>>> from imu_bench import offline
>>> offline.Settings(start_s=10.0).confidence
0.95
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from imu_bench.offline.analysis.results import Analysis
    from imu_bench.offline.analysis.results import read as read_results
    from imu_bench.offline.analysis.results import write as write_results
    from imu_bench.offline.analysis.settings import Settings
    from imu_bench.offline.comparing.runs import compare
    from imu_bench.offline.exports import render as export
    from imu_bench.offline.imports import import_recordings
    from imu_bench.offline.presentation.figure_files import write as write_figures
    from imu_bench.offline.presentation.pages import write_report as write_report
    from imu_bench.offline.recordings import ReadOptions
    from imu_bench.offline.running.analyzing import analyze
    from imu_bench.offline.running.plan_runs import run_plan

__all__ = [
    'Analysis',
    'ReadOptions',
    'Settings',
    'analyze',
    'compare',
    'export',
    'import_recordings',
    'read_results',
    'run_plan',
    'write_figures',
    'write_report',
    'write_results',
]

_WHERE = {
    'Analysis': ('imu_bench.offline.analysis.results', 'Analysis'),
    'ReadOptions': ('imu_bench.offline.recordings', 'ReadOptions'),
    'Settings': ('imu_bench.offline.analysis.settings', 'Settings'),
    'analyze': ('imu_bench.offline.running.analyzing', 'analyze'),
    'compare': ('imu_bench.offline.comparing.runs', 'compare'),
    'export': ('imu_bench.offline.exports', 'render'),
    'import_recordings': ('imu_bench.offline.imports', 'import_recordings'),
    'read_results': ('imu_bench.offline.analysis.results', 'read'),
    'run_plan': ('imu_bench.offline.running.plan_runs', 'run_plan'),
    'write_figures': ('imu_bench.offline.presentation.figure_files', 'write'),
    'write_report': ('imu_bench.offline.presentation.pages', 'write_report'),
    'write_results': ('imu_bench.offline.analysis.results', 'write'),
}


def __getattr__(name: str) -> Any:
    """Return what is asked for by its name here."""
    if name not in _WHERE:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    module, inside = _WHERE[name]
    return getattr(import_module(module), inside)
