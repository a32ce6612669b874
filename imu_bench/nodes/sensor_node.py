# SPDX-License-Identifier: Apache-2.0
"""The executables ``sensor_node`` and ``<sensor>_node``: the name picks the driver."""

from __future__ import annotations

from collections.abc import Sequence
import signal
import sys

from imu_bench.nodes.spinning import run, SIGNALS


def main(args: Sequence[str] | None = None) -> int:
    """Run one sensor until it is asked to stop; return the exit code of the process."""
    # before numpy has threads: one that does not block a signal would die of it, and all with it
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    from imu_bench.acquisition.priority import raise_priority

    # the thread that reads waits for Python's lock: whoever holds it must not wait for a core,
    # nor for a thread of the middleware that waits for one
    raise_priority(heirs=True)
    return run('imu_bench.nodes.sensor:SensorNode', args=args)


if __name__ == '__main__':
    sys.exit(main())
