# SPDX-License-Identifier: Apache-2.0
"""A recording from the first process to the closed bag, of a bench or of topics of others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
import math
from pathlib import Path
import shutil
import time
from typing import Any, NamedTuple, TYPE_CHECKING

from imu_bench.bags.topic_info import meant
from imu_bench.config import BenchConfig
from imu_bench.errors import NotReady
from imu_bench.nodes import bench_nodes, network, processes
from imu_bench.nodes.bench_nodes import ANALYSIS, RECORDER
from imu_bench.nodes.processes import BenchProcesses
from imu_bench.nodes.topic_names import DIAGNOSTICS, IMU_TYPE, SUFFIXES
from imu_bench.recording.fault_news import FaultNews
from imu_bench.recording.interruption import Interruption
from imu_bench.recording.judgement import Judgement
from imu_bench.recording.rows import Row, SensorRow, TopicRow
from imu_bench.recording.showing import ended, say, show, Showing

if TYPE_CHECKING:
    from imu_bench.nodes.bench_monitor import BenchMonitor
    from imu_bench.recording.trial import LiveTest


UP_WITHIN_S = 180.0
"""
How long sensors may take to come up: six need 10 s on two idle cores, and two of them 50 s beside
fifteen busy programs.  One that cannot come up says so at once, by its end.
"""

TOPIC_WITHIN_S = 10.0
"""How long the first message of a topic may take."""

LEAD_S = 1.5
"""So long before a scenario begins every sensor is told when; they compute some time ahead."""


@dataclass(frozen=True)
class Plan:
    """What is recorded, and where."""

    bag: Path  # its folder, which does not exist yet
    storage: str = 'mcap'
    duration_s: float | None = None  # None is as long as nobody ends it
    bench: BenchConfig | None = None  # None records what others publish
    topics: tuple[str, ...] = ()  # topics that others publish; every Imu topic if none
    # folder of the logs; None has them beside the bag, and once all is up in its folder
    logs: Path | None = None
    analysis: Path | None = None  # parameter file of the analysis node; None runs none
    test: LiveTest | None = None  # what moves emulated sensors
    faults: bool = False  # whether scripted faults are news
    # variables of ROS 2 that are set where the user has not
    ros: Mapping[str, str] = field(default_factory=dict)
    # who reaches the nodes, as `imu_bench.nodes.network.variables` takes it
    network: str = network.ALL


class Session:
    """
    Starts nodes and recorder, shows them, and stops them in order, whatever ends it.

    The recorder is up before the first sensor is started: what is published is heard.  What is
    not up in time leaves its logs, and no bag; who stops it before finds nothing.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._bench = plan.bench or BenchConfig(name='')
        self._logs = plan.logs or plan.bag.with_name(f'{plan.bag.name}.log')
        self._logs.mkdir(parents=True, exist_ok=True)
        chosen = network.variables(plan.network)
        environment = bench_nodes.environment(self._logs, plan.ros, chosen)
        self._processes = BenchProcesses(self._logs, environment)
        self._hosts = bench_nodes.hosts(self._bench)
        self._more: dict[str, Any] = {}
        self._begin_s = math.nan
        self._begun = self._ours = False
        self._worth_a_look = True
        self._killed: list[str] = []

    def run(self) -> Judgement:
        """
        Record, and judge what came of it.

        Raises
        ------
        NotReady
            If something does not come up; nothing is kept then.
        KeyboardInterrupt
            If a signal comes before everything is up; nothing is kept then.
        """
        # imported here: this module can be imported without ROS 2
        from imu_bench.nodes.bench_monitor import BenchMonitor

        processes.remove_leftovers()
        names = [sensor.name for sensor in self._bench.sensors]
        with Interruption() as asked:
            try:
                with BenchMonitor(names, str(self._plan.bag.resolve())) as monitor:
                    return self._record(monitor, asked)
            except KeyboardInterrupt:
                self._worth_a_look = False
                raise
            finally:
                self._stop()
                if not self._begun:
                    self._leave_nothing()
                elif self._plan.test is not None:
                    self._write_truth(self._plan.test)

    def _record(self, monitor: BenchMonitor, asked: Interruption) -> Judgement:
        def ask() -> None:
            if asked.asked:
                raise KeyboardInterrupt

        rows = self._start(monitor, ask)
        plan = self._plan
        showing = Showing(
            rows,
            self._processes,
            monitor.recorder,
            plan.bag,
            plan.duration_s,
            asked,
            settled=lambda: self._settled(monitor),
            hosts={
                **{name: [sensor.name for sensor in each] for name, each in self._hosts.items()},
                ANALYSIS: (),
            },
            start_again=self._start_again,
            news=FaultNews(monitor.sensors).lines if plan.faults else tuple,
            noise=plan.analysis is not None,
        )
        show(showing, UP_WITHIN_S if plan.bench else TOPIC_WITHIN_S)
        ended_s = time.monotonic()
        if showing.begun_s is None:
            raise KeyboardInterrupt
        if asked.asked:
            say('stopping')
        # while the monitor listens: they say as they go what they lost and stored at last
        self._stop()
        return Judgement(
            plan.bag,
            monitor.sensors,
            monitor.recorder,
            showing,
            ended_s,
            asked.asked,
            self._killed,
        )

    def _stop(self) -> None:
        """Stop what runs, the recorder last: it writes down what the others say as they go."""
        for group in (self._hosts, [ANALYSIS], [RECORDER]):
            for name in self._processes.stop(group):
                log = self._processes.log(name)
                say(f'{name} did not stop and was killed: {log}')
                self._killed.append(name)

    # --- beginning ---------------------------------------------------------------------

    def _start(self, monitor: BenchMonitor, ask: Callable[[], None]) -> list[Row]:
        """Start what is to be started; return what is shown."""
        if self._plan.bench is None:
            main, recorded = await_topics(monitor.topics, self._plan.topics, ask)
            say(f'topics: {", ".join(main)}')
            self._start_recorder(monitor, recorded, ask)
            return [TopicRow(monitor.recorder, name) for name in main]
        spaces = [sensor.namespace for sensor in self._bench.sensors]
        own = [f'{space}/{suffix}' for space in spaces for suffix in SUFFIXES]
        self._start_recorder(monitor, (), ask)
        refuse_two_of_one(monitor.topics(), own, monitor.publishers)
        if self._plan.analysis is not None:
            self._start_again(ANALYSIS)
        if self._plan.test is not None:
            self._more = self._plan.test.write(self._plan.bag.parent / 'scenario')
        bench_nodes.start_sensors(
            self._processes, self._bench, self._logs, self._more, recorded=True
        )
        return [
            SensorRow(
                monitor.sensors[sensor.name],
                monitor.recorder,
                sensor.namespace,
                plays=sensor.backend == 'recorded',
            )
            for sensor in self._bench.sensors
        ]

    def _start_recorder(
        self, monitor: BenchMonitor, topics: Iterable[str], ask: Callable[[], None]
    ) -> None:
        plan = self._plan
        own = [sensor.namespace for sensor in self._bench.sensors]
        bench_nodes.start_recorder(self._processes, plan.bag, plan.storage, list(topics), own)
        began = time.monotonic()
        # whoever asks to stop waits, too: until it is heard nobody knows whether the bag is ours
        # in stretches, because the end of a process wakes nobody
        while not monitor.wait_for(lambda: monitor.recorder.heard_s > -math.inf, LOOK_S):
            for name, code in self._processes.ended().items():
                raise NotReady(ended(self._processes, name, code))
            if time.monotonic() - began > UP_WITHIN_S:
                raise NotReady(
                    f'the recorder is not up after {UP_WITHIN_S:g} s: '
                    f'{self._processes.log(RECORDER)}'
                )
        self._ours = True
        ask()

    def _start_again(self, name: str) -> None:
        """Start a process that is not running."""
        if name == ANALYSIS and self._plan.analysis is not None:
            bench_nodes.start_analysis(self._processes, self._bench, self._plan.analysis)
        else:
            bench_nodes.start_sensors(
                self._processes, self._bench, self._logs, self._more, [name], recorded=True
            )

    def _settled(self, monitor: BenchMonitor) -> float:
        """Let the scenario begin, if there is one; return when the recording begins."""
        if self._plan.logs is None:
            self._logs = self._plan.bag / 'log'
            self._processes.move_logs(self._logs)
        if self._plan.test is None:
            self._begun = True
            return time.monotonic()
        emulated = [s.name for s in self._bench.sensors if s.backend == 'emulated']
        self._begin_s = time.time() + LEAD_S
        monitor.begin(self._begin_s, emulated)
        self._more['simulation.begin'] = self._begin_s
        self._begun = True
        return time.monotonic() + self._begin_s - time.time()

    # --- what is left ------------------------------------------------------------------

    def _write_truth(self, test: LiveTest) -> None:
        """Write what is true about the recording beside it, as `imu-bench simulate` does."""
        from imu_bench.bench import simulate
        from imu_bench.simulation.recording import write_truth

        # what is played, or measured, does not know of the scenario
        emulated = [sensor for sensor in self._bench.sensors if sensor.backend == 'emulated']
        sensors = [simulate(sensor, test.scenario) for sensor in emulated]
        write_truth(
            self._plan.bag.parent,
            sensors,
            test.scenario,
            test.duration_s,
            start_ns=round(self._begin_s * 1e9),
        )

    def _leave_nothing(self) -> None:
        """Remove a bag that has nothing worth keeping; logs that say why stay."""
        if self._ours:
            shutil.rmtree(self._plan.bag, ignore_errors=True)
        for log in self._logs.iterdir():
            if not (self._worth_a_look and log.stat().st_size):
                log.unlink()
        with suppress(OSError):  # it is not empty
            self._logs.rmdir()


def refuse_two_of_one(
    published: Iterable[str], own: Iterable[str], who: Callable[[str], str]
) -> None:
    """Check that nobody publishes the topics of a bench before its nodes do."""
    taken = sorted(set(own) & set(published))
    if taken:
        raise NotReady(
            f'{taken[0]}: {who(taken[0])} publishes this already; stop that node, or leave the '
            'bench out to record what is published'
        )


WITHIN_S = 10.0
"""How long somebody may take to publish; nodes on other machines are found within 3 s."""

SETTLED_S = 1.5
"""When no topic has come for so long, all are known."""

LOOK_S = 0.1

NEIGHBOURS = ('sensor_msgs/msg/MagneticField', 'sensor_msgs/msg/Temperature')


class Topics(NamedTuple):
    """The topics that count, and all that are recorded."""

    main: tuple[str, ...]
    recorded: tuple[str, ...]


def await_topics(
    graph: Callable[[], Mapping[str, str]], wanted: Sequence[str], ask: Callable[[], None]
) -> Topics:
    """Wait until there is something to record."""
    began = changed = time.monotonic()
    found: Mapping[str, str] = {}
    while True:
        ask()
        now, seen = time.monotonic(), graph()
        if seen != found:
            found, changed = seen, now
        imus, settled = _imus(found), now - changed > SETTLED_S
        names = [_full(name, found, imus if settled else ()) for name in wanted]
        if names and all(names):
            every = tuple(dict.fromkeys(names))
            return Topics(every, every)
        if imus and not names and settled:
            return Topics(imus, (*imus, *_neighbours(found)))
        if now - began > WITHIN_S + SETTLED_S:
            lost = [name for name, topic in zip(wanted, names, strict=True) if not topic]
            raise NotReady(_nobody_publishes(lost, found))
        # the pace of looking: the graph tells nobody that it has changed
        time.sleep(LOOK_S)


def _full(name: str, graph: Mapping[str, str], imus: Sequence[str]) -> str:
    """Return the topic that a name stands for: a short one is that of one Imu topic alone."""
    found = meant(name, graph) if '/' + name.lstrip('/') in graph else meant(name, imus)
    return found[0] if len(found) == 1 else ''


def _imus(graph: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(name for name, kind in graph.items() if kind == IMU_TYPE)


def _neighbours(graph: Mapping[str, str]) -> Iterable[str]:
    """Return what is recorded beside Imu topics: as the recorder does, and the same by type."""
    ends = tuple(f'/{suffix}' for suffix in SUFFIXES)
    for name, kind in graph.items():
        known = kind in NEIGHBOURS or name == DIAGNOSTICS or name.endswith(ends)
        if known and kind != IMU_TYPE:
            yield name


def _nobody_publishes(names: Sequence[str], graph: Mapping[str, str]) -> str:
    for name in names:
        if len(several := meant(name, _imus(graph))) > 1:
            return f'{name!r} names several topics: {", ".join(several)}'
    there = ', '.join(_imus(graph)) or 'none'
    if names:
        lost = ', '.join(names)
        return f'{lost}: nobody publishes this after {WITHIN_S:g} s; Imu topics: {there}'
    return (
        f'nobody publishes an Imu topic after {WITHIN_S:g} s; start a driver, check '
        'ROS_DOMAIN_ID, or name a bench to start its sensors'
    )
