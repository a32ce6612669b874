# SPDX-License-Identifier: Apache-2.0
"""Parts of the six-position plan: positions and turns, the calibration, its YAML and tables."""
