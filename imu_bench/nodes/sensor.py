# SPDX-License-Identifier: Apache-2.0
"""The node of every sensor: a lifecycle node around one acquisition."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
import re
import sys
import traceback
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench import bench
from imu_bench.acquisition import Acquisition
from imu_bench.acquisition.priority import ordinary_priority
from imu_bench.bus.recording import read_head
from imu_bench.config import (
    sensor_from_parameters,
    SENSOR_SETTINGS,
    SensorConfig,
    SIMULATION_SETTINGS,
)
from imu_bench.config.beginning import Beginning
from imu_bench.errors import (
    BenchError,
    BusBusy,
    ConfigError,
    PermissionDenied,
    RecordingError,
)
from imu_bench.nodes import diagnostics, parameters
from imu_bench.nodes.fault_report import FaultReport
from imu_bench.nodes.sensor_topics import SensorTopics
from imu_bench.nodes.spinning import spare_the_collector_again
from imu_bench.samples import Samples
from msg_conversions import building
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future

PLAIN = 'sensor'
"""What is left of the plain executable's name without '_node'."""

ROOT = '/bench'

PASSING = (PermissionDenied, BusBusy)
"""What others have to put right while the node waits: a permission, a chip in use."""

AGAIN_S = 1.0

BEGIN = 'simulation.begin'


def executable() -> str:
    """
    Return the sensor that the executable's name stands for: 'mpu9250' for mpu9250_node.

    Empty for the plain ``sensor_node`` and for programs that are no node at all.
    """
    stem = Path(sys.argv[0]).stem
    name = stem.removesuffix('_node')
    return '' if name in (stem, PLAIN) else name


def default_name(arguments: list[str]) -> str:
    """
    Return the name of a sensor to which nobody gave a namespace.

    It is that of the executable, then that of the parameter file the user wrote.

    Examples
    --------
    >>> default_name(['sensor_node', '--ros-args', '--params-file', 'config/left-imu.yaml'])
    'left_imu'
    >>> default_name(['sensor_node'])
    'sensor'
    """
    name = executable()
    if not name and '--params-file' in arguments[:-1]:
        name = Path(arguments[arguments.index('--params-file') + 1]).stem
    name = re.sub(r'\W+', '_', name, flags=re.ASCII)
    return re.sub(r'^(?=\d)', '_', name) or PLAIN


class SensorNode(LifecycleNode):
    """
    One sensor of the bench.

    configure opens the bus, checks the identity and writes the settings; activate starts
    sampling; deactivate stops it; cleanup and shutdown release the bus.  With `autostart`
    the node does the first two itself.  Samples arrive in a thread and are published in
    blocks by the executor, which a guard condition wakes: timers of rclpy do not hold 1 kHz.

    Parameters
    ----------
    name : str, optional
        Short name of the sensor, for the namespace /bench/<name>; from the command
        line by default.  A namespace that the user remapped takes precedence.
    **options
        For rclpy's LifecycleNode.

    Attributes
    ----------
    ended : Future
        Done when a recording has been played; the result is the error if it could not be.

    Raises
    ------
    ConfigError
        If a parameter is wrong: each with its name, its value and what is allowed.
    BenchError
        If it brings itself up and the sensor is not there.  For a permission, or for a chip that
        another program uses, it waits, and tries again every `AGAIN_S`.
    """

    def __init__(self, name: str = '', **options: Any) -> None:
        name = name or default_name(sys.argv)
        super().__init__(
            f'{executable() or PLAIN}_node',
            namespace=f'{ROOT}/{name}',
            automatically_declare_parameters_from_overrides=True,
            **options,
        )
        untyped: Any = self  # rclpy of Jazzy has few type hints
        self.log = untyped.get_logger()
        self._triggers = (untyped.trigger_configure, untyped.trigger_activate)
        self.config = self._configuration(self.get_namespace().rpartition('/')[2] or name)
        self.acquisition: Acquisition | None = None
        self._topics: SensorTopics | None = None
        self._reason: BenchError | None = None
        self._refusals: Counter[str] = Counter()
        self._waiting: Any = None
        self._before = diagnostics.Losses()
        self._faults: FaultReport | None = None
        self._beginning = Beginning(self.config.simulation.get('begin', 0.0))
        untyped.add_on_set_parameters_callback(self._changed)
        self._said: type = type(None)
        self._data: Any = self.create_guard_condition(self._publish_waiting)
        self._diagnostics = diagnostics.Diagnostics(self, self._statuses)
        make_future: Any = Future
        self.ended = make_future()
        if self.config.backend != 'hardware':
            what = 'measured then' if self.config.measured else 'not measurements'
            self.log.warning(f'{self.config.name}: {bench.label(self.config)}: these are {what}')
        if self.config.autostart:
            try:
                self.bring_up()
            except PASSING:
                self._waiting = self.create_timer(AGAIN_S, self._try_again)

    def _configuration(self, name: str) -> SensorConfig:
        given = parameters.take_given(self)
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
                if not self._beginning.at_s:
                    reason = f'it began when it was switched on; start the node with {BEGIN}'
                    return SetParametersResult(successful=False, reason=reason)
                self._beginning.at_s = parameter.value
        return SetParametersResult(successful=True)

    def bring_up(self) -> None:
        """
        Configure and activate.

        Raises
        ------
        BenchError
            Why it did not work.
        """
        for trigger in self._triggers:
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise self._reason or BenchError(f'{self.config.name}: does not come up')

    def _try_again(self) -> None:
        if self.acquisition is None:  # nobody else has configured it meanwhile
            try:
                self.bring_up()
            except PASSING:
                return
        self.destroy_timer(self._waiting)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the bus, check who answers, write the settings."""
        return self._attempt(self._configure)

    def _configure(self) -> None:
        with ordinary_priority():
            # now, because it takes a while and nothing is sampled yet
            bench.import_all(self.config)
            spare_the_collector_again()
        faults = self._faults = FaultReport(self.config, self.log)
        self.acquisition = bench.build(
            self.config,
            faults.clock,
            on_data=self._data.trigger,
            switched_on_ns=faults.switched_on_ns,
            beginning=self._beginning,
        )
        try:
            part = self.acquisition.prepare()
            self._topics = SensorTopics(self, self.config, self.acquisition.stats.nominal_hz)
        except Exception:
            self._release()
            raise
        self.log.info(f'{self.config.name}: {part}, {bench.label(self.config)}')
        if self.acquisition.stats.tape:
            self.log.info(f'{self.config.name}: {self.acquisition.stats.tape}')

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start sampling."""
        return self._attempt(self._activate)

    def _activate(self) -> None:
        if self.acquisition is not None:
            self.acquisition.start()

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop sampling; what was read is published."""
        return self._attempt(self._deactivate)

    def _deactivate(self) -> None:
        if self.acquisition is not None:
            self.acquisition.stop()
            self._publish_waiting()

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the bus."""
        return self._attempt(self._release)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and release everything."""
        return self._attempt(self._release)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything, so that the sensor can be configured anew."""
        return self._attempt(self._release)

    def _release(self) -> None:
        acquisition, self.acquisition = self.acquisition, None
        topics, self._topics = self._topics, None
        if acquisition is not None:
            try:
                acquisition.stop()
                if topics is not None and self.context.ok():
                    for run in acquisition.drain():
                        topics.publish(run)
            finally:
                acquisition.close()
        if topics is not None:
            topics.close()

    def close(self) -> None:
        """Stop the thread, publish what waits, release the bus; idempotent."""
        if self.acquisition is not None and self.context.ok():
            self._diagnostics.publish()
        self._attempt(self._release)

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

    def _publish_waiting(self) -> None:
        if self.acquisition is None or self._topics is None:
            return
        runs = self.acquisition.drain()
        for run in runs:
            self._topics.publish(run)
        self._say_what_changed(self.acquisition, runs)

    def _say_what_changed(self, acquisition: Acquisition, runs: list[Samples]) -> None:
        """Publish diagnostics at once when an error comes or goes, or a scripted fault does."""
        news = False
        if self._faults is not None and self._faults.scripted:
            self._faults.arrived(runs)
            news = self._faults.look(acquisition.stats)
        error = type(acquisition.error)
        if news or error is not self._said:
            self._said = error
            self._diagnostics.publish_soon()
        if acquisition.over and not self.ended.done():
            self._end(acquisition)

    def _end(self, acquisition: Acquisition) -> None:
        """Say that a recording has been played, or why not to its end, and ask to be ended."""
        self._diagnostics.publish()
        if isinstance(acquisition.error, RecordingError):
            self.ended.set_result(acquisition.error)
        else:
            self.log.info(f'{self.config.name}: {acquisition.over}')
            self.ended.set_result(None)

    def _statuses(self) -> list[DiagnosticStatus]:
        acquisition, topics = self.acquisition, self._topics
        name, hardware_id = f'{self.config.name}: acquisition', bench.label(self.config)
        values: dict[str, Any] = {'backend': self.config.backend, 'driver': self.config.driver}
        values['calibration'] = ', '.join(self.config.calibration) or 'none'
        values |= {f'refused.{kind}': count for kind, count in self._refusals.items()}
        if acquisition is None or topics is None:
            state = ('error', str(self._reason)) if self._reason else ('stale', 'not configured')
            return [building.diagnostic_status(name, *state, hardware_id, values)]
        stats = acquisition.stats
        level, message = diagnostics.judge(stats, self._before)
        self._before = diagnostics.Losses.of(stats)
        values |= diagnostics.acquisition_values(stats)
        values |= {f'published.{topic}': count for topic, count in topics.published.items()}
        own = [building.diagnostic_status(name, level, message, hardware_id, values)]
        if self._faults is None or not self._faults.scripted:
            return own
        self._faults.look(stats)
        return [*own, self._faults.status()]
