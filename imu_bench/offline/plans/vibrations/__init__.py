# SPDX-License-Identifier: Apache-2.0
"""Parts of the plan `vibration`: what is kept of each axis, and what it says."""
