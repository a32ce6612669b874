# SPDX-License-Identifier: Apache-2.0
"""The executables ``sensor_node`` and ``<sensor>_node``: the name picks the driver."""

from __future__ import annotations

from collections.abc import Sequence
import signal
import sys

from imu_bench.nodes.spinning import run, SIGNALS

SWITCH_S = 0.5e-3
"""
How long a thread keeps Python's lock while another waits for it.

The default of 5 ms is the sample period of an inclinometer, and a reading asks for the lock after
each of its ten frames.
"""


def main(args: Sequence[str] | None = None) -> int:
    """Run one sensor until it is asked to stop; return the exit code of the process."""
    # before numpy has threads: one that does not block a signal would die of it, and all with it
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    from imu_bench.acquisition.priority import raise_priority

    def go_first() -> None:
        """
        Raise the priority of all threads from here on.

        The thread that reads waits for Python's lock: whoever holds it must not wait for a
        core, nor for a thread of the middleware that waits for one; and hand it over soon.
        """
        raise_priority(heirs=True)
        sys.setswitchinterval(SWITCH_S)

    return run('imu_bench.nodes.sensor:SensorNode', args=args, imported=go_first)


if __name__ == '__main__':
    sys.exit(main())
