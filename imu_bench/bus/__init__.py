# SPDX-License-Identifier: Apache-2.0
"""How bytes reach a chip: the only place that knows smbus2, periphery, pyserial, daqhats."""
