# SPDX-License-Identifier: Apache-2.0
"""Parts of the thermal plan: what is kept of a heated sensor, and how it is presented."""
