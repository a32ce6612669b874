# SPDX-License-Identifier: Apache-2.0
"""What a running bench says of itself: diagnostics and noise figures, by sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
import math
import threading
import time
from types import TracebackType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped
from imu_bench.acquisition.stats import RATE_TOLERANCE, WINDOW_S
from imu_bench.errors import NotReady
from imu_bench.nodes import discovery
from imu_bench.samples import IMU_QUANTITIES
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

LATE_S = 1.0
"""So much later than a recovery its samples may have left the rate's window."""

BEGIN = 'simulation.begin'
"""Parameter of a sensor's node: Unix time at which the scenario begins, s."""

STRETCH_S = 1.0

ANSWER_S = 10.0
"""So long a node may take to answer; it does nothing else that takes long."""


@dataclass
class SensorView:
    """The latest that one sensor's node and the analysis node said of it."""

    name: str
    level: int = 3
    message: str = 'has not been heard of'
    values: dict[str, str] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)
    """Mean one-sided noise density of the axes there are, SI, by quantity."""
    faults: dict[int, dict[str, str]] = field(default_factory=dict)
    """What is known of each scripted fault, as `imu_bench.nodes.fault_report` has it."""
    recovered_s: float = -math.inf
    """When the latest recovery from a fault was heard of, on the clock of `time.monotonic`."""
    heard_s: float = -math.inf
    """When the values were heard, on the same clock."""

    def number(self, key: str) -> float:
        """Return a diagnostic value as a number; NaN when there is none."""
        try:
            return float(self.values[key].split()[0])
        except (KeyError, ValueError, IndexError):
            return math.nan

    def hear_of_faults(self, values: Mapping[str, str]) -> None:
        """Take note of what the sensor's node says of its faults, by '<number>.<key>'."""
        for path, value in values.items():
            number, _, key = path.partition('.')
            fault = self.faults.setdefault(int(number), {})
            if key == 'state' and value == 'recovered' != fault.get(key):
                self.recovered_s = time.monotonic()
            fault[key] = value

    @property
    def publishing(self) -> bool:
        """Whether samples have arrived."""
        return self.number('samples') > 0

    @property
    def at_full_rate(self) -> bool:
        """Whether samples arrive now at the rate at which the chip makes them."""
        nominal, delivered = self.number('nominal_hz'), self.number('delivered_hz')
        true = self.number('rate_hz')
        expected = nominal if math.isnan(true) else true
        return delivered >= (1 - RATE_TOLERANCE) * expected

    @property
    def kept_rate(self) -> bool:
        """Whether everything the chip made has arrived so far."""
        return self.number('lost') == 0 and self.at_full_rate

    @property
    def begun_faults(self) -> list[dict[str, str]]:
        """The scripted faults that have begun."""
        return [fault for fault in self.faults.values() if fault.get('state') != 'planned']

    @property
    def lost_by_faults(self) -> int:
        """Samples that the scripted faults have cost."""
        return sum(int(fault.get('lost', '0')) for fault in self.begun_faults)

    @property
    def lost_otherwise(self) -> int:
        """Samples that were lost beside; what two faults share is counted with both of them."""
        lost = self.number('lost')
        return 0 if math.isnan(lost) else max(0, int(lost) - self.lost_by_faults)

    @property
    def verdict(self) -> str:
        """Say in words whether the sensor kept its rate."""
        if not self.publishing:
            return f'gave no data: {self.message}'
        seen = f'{self.number("delivered_hz"):.1f} of {self.number("nominal_hz"):.0f} Hz'
        if self.begun_faults:
            return self._verdict_with_faults(seen)
        if self.kept_rate:
            return f'kept its rate ({seen}), nothing lost'
        return f'did NOT keep its rate: {seen}, {self.values.get("lost", "?")} samples lost'

    def _verdict_with_faults(self, seen: str) -> str:
        """Say what the scripted faults took, what else was lost, and how it goes since."""
        otherwise = self.lost_otherwise
        text = f'{self.lost_by_faults} samples lost to the scripted faults, '
        text += f'{otherwise} otherwise' if otherwise else 'none otherwise'
        if any(fault.get('state') != 'recovered' for fault in self.begun_faults):
            return f'{text}; has NOT recovered: {seen}'
        if self.at_full_rate:
            return f'{text}; keeps its rate since ({seen})'
        if self.heard_s - self.recovered_s < WINDOW_S + LATE_S:
            return f'{text}; its rate of the last {WINDOW_S:g} s has the last fault in it ({seen})'
        return f'{text}; does NOT keep its rate since: {seen}'


@dataclass
class RecorderView:
    """The latest that the recorder of one bag said."""

    bag: str = ''
    message: str = ''
    failed: bool = False
    values: dict[str, str] = field(default_factory=dict)
    heard_s: float = -math.inf
    """When it was heard, on the clock of `time.monotonic`."""

    def stored(self, topic: str) -> int:
        """Return how many messages of a topic are on the disk."""
        return int(self.values.get(f'stored.{topic}', '0'))

    @property
    def dropped(self) -> int:
        """Messages that came faster than the disk took them."""
        return int(self.values.get('dropped', '0'))


class BenchMonitor:
    """
    Listens to a bench in a thread of its own; use as a context manager.

    Parameters
    ----------
    sensors : list of str
        Names of the sensors, last part of their namespaces below /bench.
    bag : str
        The bag whose recorder is listened to, as the recorder was told it; none by default.
    """

    def __init__(self, sensors: list[str], bag: str = '') -> None:
        self.sensors = {name: SensorView(name) for name in sensors}
        self.recorder = RecorderView(bag)
        self._news = threading.Condition()

    def __enter__(self) -> BenchMonitor:
        # Ctrl-C is for the main thread alone: rclpy's handler would take the context down under
        # the executor, and whoever calls shutdown at that moment gets an error for it
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node: Any = rclpy.create_node('bench_monitor')  # rclpy of Jazzy has few type hints
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnostics, 10)
        for name in self.sensors:
            for quantity in IMU_QUANTITIES:
                topic = f'/bench/{name}/imu/noise_density/{quantity.name}'
                self._node.create_subscription(
                    Vector3Stamped, topic, self._listener(name, quantity.name), 10
                )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        make_future: Any = Future
        self._over = make_future()
        self._thread = threading.Thread(target=self._spin, name='bench monitor', daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # the thread ends by itself, and only then what it spins on is taken away
        self._over.set_result(None)
        self._executor.wake()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()

    def _spin(self) -> None:
        while not self._over.done():
            # in stretches: should a wake-up come just before it waits, it is not missed for long
            self._executor.spin_until_future_complete(self._over, STRETCH_S)

    def wait_for(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """
        Wait until something holds; return whether it does.

        Parameters
        ----------
        done : callable
            Asked again after every message on /diagnostics.
        timeout_s : float
        """
        with self._news:
            return self._news.wait_for(done, timeout_s)

    def begin(self, at_s: float, names: Iterable[str]) -> None:
        """
        Tell sensors when the scenario begins that they wait for.

        Parameters
        ----------
        at_s : float
            Unix time, s.
        names : iterable of str

        Raises
        ------
        NotReady
            If a sensor does not answer, or refuses.
        """
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=at_s)
        request = SetParameters.Request(parameters=[Parameter(name=BEGIN, value=value)])
        clients = {
            name: self._node.create_client(
                SetParameters, f'/bench/{name}/sensor_node/set_parameters'
            )
            for name in names
        }
        for name, client in clients.items():
            if not client.wait_for_service(ANSWER_S):
                raise NotReady(f'{name}: its parameters cannot be reached after {ANSWER_S:g} s')
        answers = {name: client.call_async(request) for name, client in clients.items()}
        for name, answer in answers.items():
            heard = threading.Event()
            answer.add_done_callback(lambda _, heard=heard: heard.set())
            if not heard.wait(ANSWER_S):
                raise NotReady(f'{name}: did not answer within {ANSWER_S:g} s when to begin')
            (result,) = answer.result().results
            if not result.successful:
                raise NotReady(f'{name}: cannot begin: {result.reason}')

    def _diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            view = self.sensors.get(status.name.partition(':')[0].rpartition('/')[2])
            if view is not None and status.name.endswith('faults'):
                view.hear_of_faults({pair.key: pair.value for pair in status.values})
            elif view is not None and status.name.endswith('acquisition'):
                view.level = status.level[0]
                view.message = status.message
                view.values = {pair.key: pair.value for pair in status.values}
                view.heard_s = time.monotonic()
            elif status.name.endswith('recording') and status.hardware_id == self.recorder.bag:
                self._hear_recorder(status)
        with self._news:
            self._news.notify_all()

    def _hear_recorder(self, status: DiagnosticStatus) -> None:
        view = self.recorder
        view.message, view.failed = status.message, status.level == DiagnosticStatus.ERROR
        view.values = {pair.key: pair.value for pair in status.values}
        view.heard_s = time.monotonic()

    def topics(self) -> dict[str, str]:
        """Return the topics that somebody publishes now, as name to type."""
        graph = discovery.find(self._node)
        return {name: kind for name, kind in graph.items() if self._node.count_publishers(name)}

    def _listener(self, name: str, quantity: str) -> Callable[[Vector3Stamped], None]:
        def listen(message: Vector3Stamped) -> None:
            vector = (message.vector.x, message.vector.y, message.vector.z)
            axes = [value for value in vector if not math.isnan(value)]
            if axes:
                self.sensors[name].noise[quantity] = sum(axes) / len(axes)

        return listen
