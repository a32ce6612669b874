# SPDX-License-Identifier: Apache-2.0
"""Container formats of bags: raw messages in and out, nothing decoded."""
