# SPDX-License-Identifier: Apache-2.0
"""What a running bench says of itself: diagnostics and noise figures, by sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import math
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped
from imu_bench.account import counts
from imu_bench.errors import NotReady
from imu_bench.live.views import RecorderView, SensorView
from imu_bench.nodes import discovery
from imu_bench.nodes.diagnostics import fresh
from imu_bench.nodes.others import full_name
from msg_conversions.quantities import IMU_QUANTITIES
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

BEGIN = 'simulation.begin'
"""Parameter of a sensor's node: Unix time at which the scenario begins, s."""

ANSWER_S = 10.0
"""So long a node may take to answer; it does nothing else that takes long."""


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
        keys = ['--ros-args', '--enclave', '/imu_bench/monitor']
        try:
            rclpy.init(args=keys, signal_handler_options=SignalHandlerOptions.NO)
            # rclpy of Jazzy has few type hints
            self._node: Any = rclpy.create_node('bench_monitor')
        except RuntimeError as error:  # no keys, no security in the middleware, a bad setting
            try_shutdown()
            raise NotReady(f'ROS 2 does not start: {str(error).partition(", at ")[0]}') from error
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnostics, 10)
        for name in self.sensors:
            for quantity in IMU_QUANTITIES:
                topic = f'/bench/{name}/imu/noise_density/{quantity.name}'
                self._node.create_subscription(
                    Vector3Stamped, topic, self._listener(name, quantity.name), 10
                )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._spin, name='bench monitor', daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        # the thread ends by itself, and only then what it spins on is taken away
        self._over.set()
        # something to do: woken with nothing to do, spin_once waits again
        self._executor.create_task(lambda: None)
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()

    def _spin(self) -> None:
        # one by one: spin_until_future_complete keeps a callback of every wake-up (see spinning)
        while not self._over.is_set():
            self._executor.spin_once()

    def wait_for(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """
        Wait until something holds; return whether it does.

        Parameters
        ----------
        done : callable
            Asked again after every message on /diagnostics.
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
            Of the sensors.

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
        stamp = message.header.stamp
        if not fresh(stamp.sec * 1_000_000_000 + stamp.nanosec):
            return
        for status in message.status:
            view = self.sensors.get(status.name.partition(':')[0].rpartition('/')[2])
            if view is not None and status.name.endswith('faults'):
                view.hear_of_faults(_values(status))
            elif view is not None and status.name.endswith('analysis'):
                missed = counts(_values(status)).get('missed', 0)
                # one that was started again has missed less
                view.unanalysed = max(view.unanalysed, missed)
            elif view is not None and status.name.endswith('acquisition'):
                view.hear(status.level[0], status.message, _values(status))
            elif status.name.endswith('recording') and status.hardware_id == self.recorder.bag:
                self._hear_recorder(status)
        with self._news:
            self._news.notify_all()

    def _hear_recorder(self, status: DiagnosticStatus) -> None:
        failed = status.level == DiagnosticStatus.ERROR
        self.recorder.hear(failed, status.message, _values(status))

    def topics(self) -> dict[str, str]:
        """Return the topics that somebody publishes now, as name to type."""
        graph = discovery.find(self._node)
        return {name: kind for name, kind in graph.items() if self._node.count_publishers(name)}

    def publishers(self, topic: str) -> str:
        """Return the names of the nodes that publish a topic now."""
        found = self._node.get_publishers_info_by_topic(topic)
        return ', '.join(sorted({full_name(each) for each in found}))

    def _listener(self, name: str, quantity: str) -> Callable[[Vector3Stamped], None]:
        def listen(message: Vector3Stamped) -> None:
            vector = (message.vector.x, message.vector.y, message.vector.z)
            axes = [value for value in vector if not math.isnan(value)]
            if axes:
                self.sensors[name].noise[quantity] = sum(axes) / len(axes)

        return listen


def _values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}
