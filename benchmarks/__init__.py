# SPDX-License-Identifier: Apache-2.0
"""One module per claim of the README: ``./run benchmark NAME`` prints it, measured now."""

import os

# one core means one core for the linear algebra library as well; read when numpy is imported
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from imu_bench.nodes import network

# nodes of a benchmark hear nobody else, and nobody hears them; 1 to 101 are safe on Linux
network.apply(network.variables(network.ALONE, {}))
os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))
