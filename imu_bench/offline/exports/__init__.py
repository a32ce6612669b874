# SPDX-License-Identifier: Apache-2.0
"""
Noise numbers in the form, unit and convention of the programs that want them.

Every number is written with its unit, whether it is continuous or discrete, and one- or
two-sided, where that makes a difference; every file says from which recording it came.
"""

from imu_bench.offline.exports.choice import choose, FORMATS, render

__all__ = ['FORMATS', 'choose', 'render']
