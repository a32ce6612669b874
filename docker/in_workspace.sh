#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command in the workspace of the image, with imu-bench and the nodes on PATH.
set -e
source /ws/install/setup.bash
export PATH="/ws/install/imu_bench/lib/imu_bench:$PATH"
exec "$@"
