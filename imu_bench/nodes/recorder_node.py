# SPDX-License-Identifier: Apache-2.0
"""The executable ``recorder_node``."""

from __future__ import annotations

from collections.abc import Sequence
import sys

from imu_bench.nodes.spinning import RECORDS, run


def main(args: Sequence[str] | None = None) -> int:
    """Record until asked to stop; return the exit code of the process."""
    return run('imu_bench.nodes.recorder:RecorderNode', args=args, nice=RECORDS)


if __name__ == '__main__':
    sys.exit(main())
