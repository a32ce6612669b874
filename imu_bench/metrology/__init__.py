# SPDX-License-Identifier: Apache-2.0
"""Noise metrology: arrays in, estimates out.  No file, clock, ROS or global RNG."""
