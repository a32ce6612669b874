# SPDX-License-Identifier: Apache-2.0
"""Parts of the inclination plan: what a sensor shows at each step, and how it is presented."""
