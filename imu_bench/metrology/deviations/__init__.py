# SPDX-License-Identifier: Apache-2.0
"""Parts of `metrology.allan`: the family and its sums, what a curve consists of, its intervals."""
