# SPDX-License-Identifier: Apache-2.0
"""The executable ``analysis_node``."""

from __future__ import annotations

from collections.abc import Sequence
import os
import sys

from imu_bench.nodes.spinning import run, SHOWS


def main(args: Sequence[str] | None = None) -> int:
    """Run the analysis node until it is asked to stop; return the exit code of the process."""
    # windows fill slowly: with huge pages each of their columns takes 2 MB from the start
    os.environ.setdefault('NUMPY_MADVISE_HUGEPAGE', '0')
    return run('imu_bench.nodes.analysis:AnalysisNode', args=args, nice=SHOWS)


if __name__ == '__main__':
    sys.exit(main())
