# SPDX-License-Identifier: Apache-2.0
"""Parts of the plan `sine-on-random`: which run a recording is, what is kept of it."""
