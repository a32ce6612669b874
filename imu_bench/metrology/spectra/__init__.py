# SPDX-License-Identifier: Apache-2.0
"""Signals over frequency: densities, tones, SNR, filters, one sensor against another."""
