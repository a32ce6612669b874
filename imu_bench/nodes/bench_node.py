# SPDX-License-Identifier: Apache-2.0
"""
The executable ``bench_node``: the nodes of all sensors of a bench in one process.

Six processes would take six times the memory, and six middlewares that talk to one another.
The sensors themselves are read in further processes (`imu_bench.live.reading`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import os
import sys
import time
from typing import Any, TYPE_CHECKING

from imu_bench.errors import ConfigError
from imu_bench.nodes.spinning import block_signals, RECORDS, run

if TYPE_CHECKING:
    from imu_bench.live.reading import ReadingProcess

RECORDED = '--recorded'
USAGE = (
    f'bench_node [{RECORDED}] NAME=FILE[,FILE…] … --ros-args …: sensors by name, with their '
    'parameter files; with the option they start when a recorder listens'
)

NAMESPACE = '__ns:='

HEARD_S, LOOK_S = 5.0, 0.02
"""So long sensors wait for the recorder, which looks for new topics four times a second."""


def main(args: Sequence[str] | None = None) -> int:
    """Run the sensors of a bench until asked to stop; return the exit code of the process."""
    command = list(sys.argv if args is None else args)
    end = command.index('--ros-args') if '--ros-args' in command else len(command)
    program, *wanted = command[:end]
    recorded = RECORDED in wanted
    wanted = [word for word in wanted if word != RECORDED]
    # before numpy has threads: one that does not block a signal would die of it, and all with it
    block_signals()
    from imu_bench.live.reading import ReadingProcess

    readers = [ReadingProcess()]  # it starts while ROS 2 is imported
    try:
        return run(
            lambda: _Bench(wanted, readers, recorded=recorded, space=_namespace(command[end:])),
            args=[program, *command[end:]],
            nice=RECORDS,
        )
    finally:
        for reader in readers:
            reader.close()


def _namespace(arguments: Sequence[str]) -> str:
    """Return the namespace that arguments of ROS give all nodes, '' for none."""
    given = [word.removeprefix(NAMESPACE) for word in arguments if word.startswith(NAMESPACE)]
    return '/' + given[-1].strip('/') if given else ''


class _Bench:
    """The nodes of a bench, taken up and down together."""

    def __init__(
        self,
        wanted: Sequence[str],
        readers: list[ReadingProcess],
        *,
        recorded: bool,
        space: str = '',
    ) -> None:
        from rclpy.task import Future

        self.nodes: list[Any] = []
        self._space = space
        make_future: Any = Future  # without type hints in rclpy of Jazzy
        self.ended = make_future()
        if not wanted:
            raise ConfigError(f'no sensor is named: {USAGE}')
        try:
            self._bring_up(wanted, readers, recorded=recorded)
        except Exception:
            self.close()
            raise

    def _bring_up(
        self, wanted: Sequence[str], readers: list[ReadingProcess], *, recorded: bool
    ) -> None:
        """Open all sensors, and only then start them: opening one holds up those that run."""
        from imu_bench import wires
        from imu_bench.nodes.sensor import PASSING, SensorNode

        for each in wanted:
            name, _, files = each.partition('=')
            arguments = ['--ros-args', '-r', f'{NAMESPACE}{self._space}/bench/{name}']
            for file in filter(None, files.split(',')):
                arguments += ['--params-file', file]
            node = SensorNode(name, waits=True, cli_args=arguments)
            self.nodes.append(node)
            node.ended.add_done_callback(self._played)
        up = []
        sensors = [node.config for node in self.nodes]
        count = min(len(sensors), len(os.sched_getaffinity(0)))
        # in place: who made the first one closes them all
        readers[:] = readers[0].several(count, sensors)
        places = wires.spread(sensors, count)
        for node, place in zip(self.nodes, places, strict=True):
            node.reader = readers[place]
            if node.config.autostart:
                with suppress(*PASSING):
                    node.configure()
                    up.append(node)
        if recorded:
            _wait_for_recorder(up)
        for node in up:
            node.activate()

    def _played(self, _: Any) -> None:
        """End when all recordings have been played, or one could not be."""
        results = [node.ended.result() for node in self.nodes if node.ended.done()]
        failed = next((result for result in results if result is not None), None)
        if (failed or len(results) == len(self.nodes)) and not self.ended.done():
            self.ended.set_result(failed)

    def close(self) -> None:
        """Stop all sensors at once; then wait until each has delivered everything."""
        for node in self.nodes:
            node.halt()
        for node in self.nodes:
            node.close()


def _wait_for_recorder(nodes: Sequence[Any]) -> None:
    """Wait until the recorder takes what all nodes will publish: it stores nothing older."""
    end = time.monotonic() + HEARD_S
    while not all(node.heard for node in nodes) and time.monotonic() < end:
        time.sleep(LOOK_S)


if __name__ == '__main__':
    sys.exit(main())
