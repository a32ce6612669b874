# SPDX-License-Identifier: Apache-2.0
"""The report: one HTML file that needs no network, for the screen, the phone and the printer."""

from imu_bench.offline.report.page import write

__all__ = ['write']
