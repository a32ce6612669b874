# SPDX-License-Identifier: Apache-2.0
"""The executable ``analysis_node``."""

from __future__ import annotations

from collections.abc import Sequence
import sys

from imu_bench.nodes.spinning import run


def main(args: Sequence[str] | None = None) -> int:
    """Run the analysis node until it is asked to stop; return the exit code of the process."""
    return run('imu_bench.nodes.analysis:AnalysisNode', args=args, executor='events')


if __name__ == '__main__':
    sys.exit(main())
