# SPDX-License-Identifier: Apache-2.0
"""
Is a recording good enough to measure noise on?  Findings first, numbers later.

>>> from imu_bench.offline import health
>>> health.worst(())
'info'
"""

from imu_bench.offline.health.check import check, Health, ranked
from imu_bench.offline.health.finding import Finding, SEVERITIES, worst

__all__ = ['SEVERITIES', 'Finding', 'Health', 'check', 'ranked', 'worst']
