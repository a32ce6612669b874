# SPDX-License-Identifier: Apache-2.0
"""The executables ``sensor_node`` and ``<sensor>_node``: the name picks the driver."""

from __future__ import annotations

from collections.abc import Sequence
import sys

from imu_bench.nodes.spinning import run


def main(args: Sequence[str] | None = None) -> int:
    """Run one sensor until it is asked to stop; return the exit code of the process."""
    return run('imu_bench.nodes.sensor:SensorNode', args=args)


if __name__ == '__main__':
    sys.exit(main())
