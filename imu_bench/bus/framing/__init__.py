# SPDX-License-Identifier: Apache-2.0
"""Pure codecs between bytes on a wire and frames, one file per wire protocol; no I/O."""
