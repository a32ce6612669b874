# SPDX-License-Identifier: Apache-2.0
"""Time stamps: the true rate, jitter, gaps, and the place of each sample on a regular grid."""
