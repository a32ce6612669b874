# SPDX-License-Identifier: Apache-2.0
"""The executables ``sensor_node`` and ``<sensor>_node``: the name picks the driver."""

from __future__ import annotations

from collections.abc import Sequence
import sys
from typing import Any

from imu_bench.nodes.spinning import block_signals, RECORDS, run


def main(args: Sequence[str] | None = None) -> int:
    """Run one sensor until it is asked to stop; return the exit code of the process."""
    # before numpy has threads: one that does not block a signal would die of it, and all with it
    block_signals()
    from imu_bench.live.reading import ReadingProcess

    reader = ReadingProcess()  # starts while ROS 2 is imported

    def one() -> Any:
        from imu_bench.nodes.sensor import SensorNode

        return SensorNode(reader=reader)

    try:
        return run(one, args=args, nice=RECORDS)
    finally:
        reader.close()


if __name__ == '__main__':
    sys.exit(main())
