# SPDX-License-Identifier: Apache-2.0
"""One module per claim of the README: ``./run benchmark NAME`` prints it, measured now."""
