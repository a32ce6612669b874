# SPDX-License-Identifier: Apache-2.0
"""Parts of `metrology.rolling`: what a sliding window takes in, keeps and adds up."""
