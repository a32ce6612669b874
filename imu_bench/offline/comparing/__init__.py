# SPDX-License-Identifier: Apache-2.0
"""Results against one another: sensors, runs, and typical values of datasheets."""
