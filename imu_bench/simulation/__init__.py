# SPDX-License-Identifier: Apache-2.0
"""The physical world, simulated: how the bench moves, and how a sensor errs."""
