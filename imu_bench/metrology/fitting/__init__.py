# SPDX-License-Identifier: Apache-2.0
"""Parts of `metrology.coefficients`: which terms describe a curve, how well, and how surely."""
