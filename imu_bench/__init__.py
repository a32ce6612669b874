# SPDX-License-Identifier: Apache-2.0
"""Multi-IMU test bench: sensor drivers, emulators, noise metrology and offline analysis."""

__version__ = '0.1.0'
