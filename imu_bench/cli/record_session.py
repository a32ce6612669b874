# SPDX-License-Identifier: Apache-2.0
"""A recording from the first process to the closed bag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import math
from pathlib import Path
import shutil
import sys
import time
from typing import NamedTuple, TYPE_CHECKING

from imu_bench.bags import metadata
from imu_bench.cli.interruption import Interruption
from imu_bench.cli.live import ended, show, stop
from imu_bench.cli.record_place import Place
from imu_bench.cli.record_rows import Row, SensorRow, TopicRow
from imu_bench.cli.record_showing import RecordShowing
from imu_bench.cli.record_topics import await_topics, LOOK_S
from imu_bench.config import BenchConfig
from imu_bench.errors import NotReady, RecordingError
from imu_bench.nodes import bench_nodes
from imu_bench.nodes.bench_nodes import RECORDER
from imu_bench.nodes.processes import BenchProcesses
from imu_bench.nodes.topic_names import DIAGNOSTICS, SUFFIXES

if TYPE_CHECKING:
    from imu_bench.nodes.bench_monitor import BenchMonitor, RecorderView

UP_WITHIN_S = 60.0
"""How long sensors may take to come up; a busy two-core machine needs some 20 s."""

TOPIC_WITHIN_S = 10.0
"""How long the first message of a topic may take."""


class Ended(NamedTuple):
    """
    A recording that is over.

    Attributes
    ----------
    rows : tuple of Row
    at_s : float
        When it ended, on the clock of `time.monotonic`.
    ran_s : float
    failure : str
        Why it ended before its time; empty if it did not, or somebody wished it.
    asked : str
        The signal that ended it; empty if none did.
    recorder : RecorderView
    """

    rows: tuple[Row, ...]
    at_s: float
    ran_s: float
    failure: str
    asked: str
    recorder: RecorderView


class Session:
    """
    Starts nodes and recorder, shows them, and stops them in order, whatever ends it.

    Logs are beside the bag until everything is up, then in its folder.  What is not up in time
    leaves its logs, and no bag; who stops it before finds nothing.

    Parameters
    ----------
    place : Place
    storage : str
    bench : BenchConfig or None
        None records what others publish.
    wanted : sequence of str
        Topics that others publish; every Imu topic if none.
    """

    def __init__(
        self, place: Place, storage: str, bench: BenchConfig | None, wanted: Sequence[str]
    ) -> None:
        self._place, self._storage, self._bench = place, storage, bench
        self._wanted = wanted
        self._names = [sensor.name for sensor in bench.sensors] if bench else []
        self._logs = place.bag.with_name(f'{place.bag.name}.log')
        self._logs.mkdir(parents=True, exist_ok=True)
        self._processes = BenchProcesses(self._logs, bench_nodes.environment(self._logs, {}))
        self._begun = self._ours = False
        self._worth_a_look = True

    def run(self) -> Ended:
        """
        Record.

        Raises
        ------
        NotReady
            If something does not come up; nothing is kept then.
        KeyboardInterrupt
            If a signal comes before everything is up; nothing is kept then.
        """
        # imported here: this module can be imported without ROS 2
        from imu_bench.nodes.bench_monitor import BenchMonitor

        with Interruption() as asked:
            try:
                bag = str(self._place.bag.resolve())
                with BenchMonitor(self._names, bag) as monitor:
                    return self._record(monitor, asked)
            except KeyboardInterrupt:
                self._worth_a_look = False
                raise
            finally:
                # the recorder last: it writes down what the others say as they go
                stop(self._processes, self._names)
                stop(self._processes, [RECORDER])
                if not self._begun:
                    self._leave_nothing()

    def _record(self, monitor: BenchMonitor, asked: Interruption) -> Ended:
        def ask() -> None:
            if asked.asked:
                raise KeyboardInterrupt

        rows = self._start(monitor, ask)
        showing = RecordShowing(
            rows, self._processes, monitor.recorder, self._place, asked, self._settled
        )
        show(showing, UP_WITHIN_S if self._bench else TOPIC_WITHIN_S)
        ask_s = time.monotonic()
        if showing.begun_s is None:
            raise KeyboardInterrupt
        # while the monitor listens: they say as they go what they lost and stored at last
        stop(self._processes, self._names)
        stop(self._processes, [RECORDER])
        return Ended(
            showing.rows, ask_s, showing.ran_s, showing.failure, asked.asked, monitor.recorder
        )

    def _start(self, monitor: BenchMonitor, ask: Callable[[], None]) -> list[Row]:
        """Start what is to be started; return what is shown."""
        if self._bench is None:
            main, recorded = await_topics(monitor.topics, self._wanted, ask)
            print(f'topics: {", ".join(main)}', file=sys.stderr)
            self._start_recorder(monitor, recorded, ask)
            return [TopicRow(monitor.recorder, name) for name in main]
        spaces = [sensor.namespace for sensor in self._bench.sensors]
        own = [f'{space}/{suffix}' for space in spaces for suffix in SUFFIXES]
        self._start_recorder(monitor, [*own, DIAGNOSTICS], ask)
        refuse_two_of_one(monitor.topics(), own)
        bench_nodes.start_sensors(self._processes, self._bench, self._logs, {})
        return [
            SensorRow(
                monitor.sensors[sensor.name],
                monitor.recorder,
                f'{sensor.namespace}/imu/data_raw',
                plays=sensor.backend == 'recorded',
            )
            for sensor in self._bench.sensors
        ]

    def _start_recorder(
        self, monitor: BenchMonitor, topics: Sequence[str], ask: Callable[[], None]
    ) -> None:
        bench_nodes.start_recorder(self._processes, self._place.bag, self._storage, topics)
        began = time.monotonic()
        # whoever asks to stop waits, too: until it is heard nobody knows whether the bag is ours
        while monitor.recorder.heard_s == -math.inf:
            for name, code in self._processes.ended().items():
                raise NotReady(ended(self._processes, name, code))
            if time.monotonic() - began > UP_WITHIN_S:
                raise NotReady(
                    f'the recorder is not up after {UP_WITHIN_S:g} s: '
                    f'{self._processes.log(RECORDER)}'
                )
            time.sleep(LOOK_S)  # the pace of looking; the monitor listens in its own thread
        self._ours = True
        ask()

    def _settled(self) -> None:
        self._processes.move_logs(self._place.bag / 'log')
        self._begun = True

    def _leave_nothing(self) -> None:
        """Remove a bag that has nothing worth keeping; logs that say why stay."""
        if self._ours:
            shutil.rmtree(self._place.bag, ignore_errors=True)
        for log in self._logs.iterdir():
            if not (self._worth_a_look and log.stat().st_size):
                log.unlink()
        with suppress(OSError):  # it is not empty
            self._logs.rmdir()


def refuse_two_of_one(published: Iterable[str], own: Iterable[str]) -> None:
    """
    Check that nobody publishes the topics of a bench before its nodes do.

    Raises
    ------
    NotReady
        If somebody does: the bag would have two sensors under one name.
    """
    taken = sorted(set(own) & set(published))
    if taken:
        raise NotReady(
            f'{taken[0]}: somebody publishes this already; stop that node, or leave the '
            'bench out to record what is published'
        )


def stored(bag: Path) -> dict[str, int] | None:
    """Return the messages of a bag by topic; None if it was not finished."""
    try:
        return metadata.read(bag / metadata.FILE_NAME).counts
    except (OSError, RecordingError):
        return None
