# SPDX-License-Identifier: Apache-2.0
"""What test plans measure: tilt, heat, vibration, rides, turns and positions."""
