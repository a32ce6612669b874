# SPDX-License-Identifier: Apache-2.0
"""
Multi-IMU test bench: sensor drivers, emulators, noise metrology and offline analysis.

What is here is imported when it is first used: ``import imu_bench`` itself takes no time.
"""

from __future__ import annotations

from importlib import import_module

from imu_bench.version import __version__ as __version__

TYPE_CHECKING = False  # as typing has it, which takes longer to import than all of this
if TYPE_CHECKING:
    from typing import Any

    from imu_bench.api import analyze as analyze
    from imu_bench.api import compare as compare
    from imu_bench.api import export as export
    from imu_bench.api import load as load
    from imu_bench.api import oadev as oadev
    from imu_bench.api import read as read
    from imu_bench.api import Result as Result
    from imu_bench.api import simulate as simulate
    from imu_bench.metrology.allan import deviation as deviation
    from imu_bench.metrology.coefficients import fit as fit
    from imu_bench.metrology.estimate import Estimate as Estimate
    from imu_bench.metrology.spectra.welch import psd as psd
    from imu_bench.samples import Samples as Samples

_WHERE = {
    **dict.fromkeys(
        ('Result', 'analyze', 'compare', 'export', 'load', 'oadev', 'read', 'simulate'),
        'imu_bench.api',
    ),
    'Estimate': 'imu_bench.metrology.estimate',
    'Samples': 'imu_bench.samples',
    'deviation': 'imu_bench.metrology.allan',
    'fit': 'imu_bench.metrology.coefficients',
    'psd': 'imu_bench.metrology.spectra.welch',
}

__all__ = ['__version__', *_WHERE]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(_WHERE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_WHERE})
