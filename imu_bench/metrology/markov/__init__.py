# SPDX-License-Identifier: Apache-2.0
"""First-order Gauss-Markov processes: found in data, simulated, and tracked by a Kalman filter."""
