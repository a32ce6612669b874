# SPDX-License-Identifier: Apache-2.0
"""What the verbs share: options, progress, words and tables for a terminal or a pipe."""
