#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# start_installed_executable.sh INSTALL: starts a node from a colcon install space as `ros2 run` would,
# waits until it says that it publishes, interrupts it, and wants a clean exit.
set -eu
prefix=$1/imu_bench
# colcon's setup files are not written for `set -u`, and a POSIX shell must be told where they lie
set +u
COLCON_CURRENT_PREFIX=$1
. "$1/setup.sh"
set -u
export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
export FASTRTPS_DEFAULT_PROFILES_FILE="$prefix/share/imu_bench/config/network/alone.xml"
log=$(mktemp)
trap 'rm -f "$log"' EXIT

"$prefix/lib/imu_bench/imu-bench" --version

"$prefix/lib/imu_bench/mpu9250_node" --ros-args \
    --params-file "$prefix/share/imu_bench/config/sensors/mpu9250.yaml" >"$log" 2>&1 &
node=$!
(tail --follow --pid=$node --lines=+1 "$log" &) | timeout 60 grep --quiet --max-count=1 'MPU-9250, emulated' || {
    cat "$log"
    echo 'the installed mpu9250_node did not come up' >&2
    kill $node
    exit 1
}
kill -INT $node
wait $node || {
    cat "$log"
    echo "the installed mpu9250_node exited with $?" >&2
    exit 1
}
echo 'installed mpu9250_node: started, published, stopped cleanly'
