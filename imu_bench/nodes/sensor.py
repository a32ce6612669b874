# SPDX-License-Identifier: Apache-2.0
"""The node of every sensor: a lifecycle node around one acquisition."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
import re
import sys
import time
import traceback
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench import bench
from imu_bench.acquisition import AcquisitionStats
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.recording import read_head
from imu_bench.config import (
    sensor_from_parameters,
    SENSOR_SETTINGS,
    SensorConfig,
    SIMULATION_SETTINGS,
)
from imu_bench.errors import (
    BenchError,
    BusBusy,
    ConfigError,
    PermissionDenied,
    RecordingError,
)
from imu_bench.live.packets import Wish
from imu_bench.live.reading import LocalReading, ReaderDied, Reading, ReadingProcess
from imu_bench.live.status import Health
from imu_bench.nodes import diagnostics, parameters
from imu_bench.nodes.fault_report import FaultReport
from imu_bench.nodes.others import Guard
from imu_bench.nodes.sensor_topics import SensorTopics
from imu_bench.nodes.topic_names import ROOT
from imu_bench.samples import Samples
from msg_conversions import building
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future

PLAIN = 'sensor'
"""What is left of the plain executable's name without '_node'."""

PASSING = (PermissionDenied, BusBusy)
"""What others have to put right while the node waits: a permission, a chip in use."""

BEGIN = 'simulation.begin'

EVERY_S = 0.05
"""
Samples wait so long for one another, and for those of the other sensors: each time they go out
costs a quarter of a millisecond, on a small machine a core at 400 Hz and ten sensors.
"""


def executable() -> str:
    """
    Return the sensor that the executable's name stands for: 'mpu9250' for mpu9250_node.

    Empty for ``sensor_node`` and ``bench_node``, and for programs that are no node at all.
    """
    stem = Path(sys.argv[0]).stem
    name = stem.removesuffix('_node')
    return '' if name in (stem, PLAIN, 'bench') else name


def default_name(arguments: list[str]) -> str:
    """
    Return the name of a sensor to which nobody gave a namespace.

    It is that of the executable, then that of the parameter file the user wrote.
    """
    name = executable()
    if not name and '--params-file' in arguments[:-1]:
        name = Path(arguments[arguments.index('--params-file') + 1]).stem
    name = re.sub(r'\W+', '_', name, flags=re.ASCII)
    return re.sub(r'^(?=\d)', '_', name) or PLAIN


class SensorNode(parameters.FromDump, LifecycleNode):
    """
    One sensor of the bench.

    configure opens the bus, checks the identity and writes the settings; activate starts
    sampling; deactivate stops it; cleanup and shutdown release the bus.  With `autostart`
    the node does the first two itself.  The sensor is read in a process of its own, and a
    thread publishes what comes from there: the executor has nothing to do with samples.
    """

    def __init__(
        self,
        name: str = '',
        *,
        reader: ReadingProcess | None = None,
        waits: bool = False,
        **options: Any,
    ) -> None:
        name = name or default_name(sys.argv)
        super().__init__(
            f'{executable() or PLAIN}_node',
            namespace=f'{ROOT}/{name}',
            automatically_declare_parameters_from_overrides=True,
            **options,
        )
        untyped: Any = self  # rclpy of Jazzy has few type hints
        self.log = untyped.get_logger()
        self._up = (untyped.trigger_configure, untyped.trigger_activate)
        self._down = (untyped.trigger_deactivate, untyped.trigger_cleanup)
        self.config = self._configuration(self.get_namespace().rpartition('/')[2] or name)
        self.acquisition: Reading | None = None
        # the process that reads it, which may read others, too; a thread of this one by default
        self.reader = reader
        self._topics: SensorTopics | None = None
        self._reason: BenchError | None = None
        self._refusals: Counter[str] = Counter()
        self._guard = Guard(self, self.config.name)
        self._health = Health(self.config, bench.hardware_id(self.config))
        self._faults: FaultReport | None = None
        self._begin_s: float = self.config.simulation.get('begin', 0.0)
        untyped.add_on_set_parameters_callback(self._changed)
        self._said: type = type(None)
        again = self._bring_up_again if self.config.autostart else None
        self._diagnostics = diagnostics.Diagnostics(self, self._statuses, again)
        make_future: Any = Future
        # done when a recording has been played; the result is the error if it could not be
        self.ended = make_future()
        if self.config.backend not in ('hardware', 'iio'):
            what = 'measured then' if self.config.measured else 'not measurements'
            self.log.warning(f'{self.config.name}: {bench.label(self.config)}: these are {what}')
        if self.config.autostart and not waits:
            with suppress(*PASSING):
                self.bring_up()

    def _configuration(self, name: str) -> SensorConfig:
        given = parameters.take_given(self)
        if self.get_parameter('use_sim_time').value:
            raise ConfigError(
                f'{parameters.SOURCE}.use_sim_time: true is not allowed; samples are dated by the '
                "machine's clock, or by that of the recording that is played"
            )
        expected = executable()
        if expected and given.setdefault('driver', expected) != expected:
            raise ConfigError(
                f'{parameters.SOURCE}.driver: {given["driver"]!r} is not allowed; {expected}_node '
                f'runs {expected}, use sensor_node for others'
            )
        config = sensor_from_parameters(
            name,
            given,
            settings_of=bench.settings_of,
            recorded_in=read_head,
            source=parameters.SOURCE,
        )
        if config.backend == 'recorded':
            # what is played is what the parameters say
            given = {**given, 'driver': config.driver, **config.settings}
        own: Any = bench.settings_of(config.driver)
        parameters.declare(self, (*SENSOR_SETTINGS, *SIMULATION_SETTINGS, *own), given)
        return config

    def _changed(self, changed: Sequence[Any]) -> SetParametersResult:
        """Take over what may change while the node runs: when the scenario begins."""
        for parameter in changed:
            if parameter.name == BEGIN:
                if not self._begin_s:
                    reason = f'it began when it was switched on; start the node with {BEGIN}'
                    return SetParametersResult(successful=False, reason=reason)
                if self._begin_s <= time.time():
                    self._guard.note(f'set {BEGIN}', 'refused, it has begun')
                    return SetParametersResult(successful=False, reason='it has begun')
                self._guard.note(f'set {BEGIN}', f'{parameter.value:.3f}')
                self._begin_s = parameter.value
                if self.acquisition is not None:
                    self.acquisition.begin(parameter.value)
        return SetParametersResult(successful=True)

    def bring_up(self) -> None:
        """Configure and activate."""
        self.configure()
        self.activate()

    def configure(self) -> None:
        """Open the bus, check who answers, write the settings; raises as `bring_up`."""
        self._trigger(self._up[0])

    @property
    def heard(self) -> bool:
        """Whether a recorder takes every sample that it will publish."""
        return self._topics is not None and self._topics.heard

    def activate(self) -> None:
        """Start sampling; raises as `bring_up`."""
        self._trigger(self._up[1])

    def _trigger(self, transition: Callable[[], TransitionCallbackReturn]) -> None:
        with self._guard.own():
            result = transition()
        if result != TransitionCallbackReturn.SUCCESS:
            raise self._reason or BenchError(f'{self.config.name}: does not come up')

    def _bring_up_again(self) -> None:
        """Try again what others had to put right, or what died in the process that reads."""
        dead = self.acquisition is not None and isinstance(self.acquisition.error, ReaderDied)
        if dead:
            self._refusals['ReaderDied'] += 1
            # releases what is left of it, and leaves a lifecycle node that can be configured
            with self._guard.own():
                for trigger in self._down:
                    trigger()
        elif self.acquisition is not None or not isinstance(self._reason, PASSING):
            return
        with suppress(*PASSING, ReaderDied):
            self.bring_up()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the bus, check who answers, write the settings."""
        self._guard.permits('configure it', stops=False)
        return self._attempt(self._configure)

    def _configure(self) -> None:
        clock = SystemClock()
        wish = Wish(self.config, clock, self._begin_s, EVERY_S)
        read: Any = LocalReading if self.reader is None else self.reader.read
        acquisition = self.acquisition = read(wish, self._publish)
        switched_on_ns = acquisition.switched_on_ns
        self._faults = FaultReport(self.config, self.log, clock, switched_on_ns)
        try:
            part = acquisition.prepare()
            nominal_hz = acquisition.stats.nominal_hz
            self._topics = SensorTopics(self, self.config, nominal_hz, clock)
        except Exception:
            self._release()
            raise
        self.log.info(f'{self.config.name}: {part}, {bench.label(self.config)}')
        if acquisition.stats.tape:
            self.log.info(f'{self.config.name}: {acquisition.stats.tape}')

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start sampling."""
        self._guard.permits('start it', stops=False)
        return self._attempt(self._activate)

    def _activate(self) -> None:
        if self.acquisition is not None:
            self.acquisition.start()

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop sampling; what was read is published."""
        return self._unless_recorded('stop it', self._deactivate)

    def _deactivate(self) -> None:
        if self.acquisition is not None:
            self.acquisition.stop()
            if self._topics is not None:
                self._topics.flush()

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the bus."""
        return self._unless_recorded('release it', self._release)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and release everything."""
        return self._unless_recorded('shut it down', self._release)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything, so that the sensor can be configured anew."""
        return self._attempt(self._release)

    def _release(self) -> None:
        acquisition, self.acquisition = self.acquisition, None
        try:
            if acquisition is not None:
                # what was read last is published before the topics go
                acquisition.close()
        finally:
            topics, self._topics = self._topics, None
            if topics is not None:
                topics.close()

    def close(self) -> None:
        """Stop sampling, publish what waits and the last counts, release the bus; idempotent."""
        self.halt()
        self._attempt(self._release)

    def halt(self) -> None:
        """Stop sampling; publish what waits and the last counts."""
        acquisition = self.acquisition
        if acquisition is None or not self.context.ok():
            return
        if acquisition.stats.state != 'stopped':
            self._attempt(self._deactivate)
        self._diagnostics.publish()

    def _unless_recorded(self, what: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        if self._guard.permits(what):
            return self._attempt(action)
        self._diagnostics.publish_soon()
        return TransitionCallbackReturn.FAILURE

    def _attempt(self, action: Callable[[], None]) -> TransitionCallbackReturn:
        """Do part of a transition: rclpy swallows what a transition raises, so say it here."""
        try:
            action()
        except BenchError as error:
            if str(error) != str(self._reason):
                self.log.error(f'{self.config.name}: {error}')
            self._reason = error
            self._refusals[type(error).__name__] += 1
            return TransitionCallbackReturn.FAILURE
        except Exception:
            self.log.error(traceback.format_exc())
            return TransitionCallbackReturn.ERROR
        self._reason = None
        return TransitionCallbackReturn.SUCCESS

    def _publish(self, runs: list[Samples], stats: AcquisitionStats) -> None:
        """Publish what a sensor gave; called from the thread that takes it."""
        topics, acquisition = self._topics, self.acquisition
        if topics is not None and self.context.ok():
            topics.publish(runs)
        if acquisition is not None:
            self._say_what_changed(acquisition, runs, stats)

    def _say_what_changed(
        self, acquisition: Reading, runs: list[Samples], stats: AcquisitionStats
    ) -> None:
        """Publish diagnostics at once when an error comes or goes, or a scripted fault does."""
        news = False
        if self._faults is not None and self._faults.scripted:
            self._faults.arrived(runs)
            news = self._faults.look(stats)
        error = type(acquisition.error)
        if news or error is not self._said:
            self._said = error
            self._diagnostics.publish_soon()
        self._diagnostics.catch_up()
        if stats.over and not self.ended.done():
            self._end(acquisition)

    def _end(self, acquisition: Reading) -> None:
        """Say that a recording has been played, or why not to its end, and ask to be ended."""
        self._diagnostics.publish()
        if isinstance(acquisition.error, RecordingError):
            self.ended.set_result(acquisition.error)
        else:
            self.log.info(f'{self.config.name}: {acquisition.over}')
            self.ended.set_result(None)

    def _statuses(self) -> list[DiagnosticStatus]:
        acquisition, topics = self.acquisition, self._topics
        refused = {f'refused.{kind}': count for kind, count in self._refusals.items()}
        if acquisition is None or topics is None:
            state = ('error', str(self._reason)) if self._reason else ('stale', 'not configured')
            return [building.diagnostic_status(*self._health.absent(*state, refused))]
        stats = acquisition.stats
        status = self._health.status(stats, topics.published, refused)
        own = [building.diagnostic_status(*status), self._guard.status(topics.published.copy())]
        if self._faults is None or not self._faults.scripted:
            return own
        self._faults.look(stats)
        return [*own, self._faults.status()]
