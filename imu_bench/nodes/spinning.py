# SPDX-License-Identifier: Apache-2.0
"""
Start a node, spin it, and leave cleanly, whatever ends it.

Every executable is ``def main(args=None): return run('package.module:NodeClass', args=args)``.
The node class takes no arguments.  If it has a Future ``ended``, the spin ends when that is
done, with the error that is its result, if it is one.  If it has a method ``close()``, that is
called once before the node is destroyed, with ROS 2 still up: stop threads, flush files,
release buses, publish last words there.

SIGINT and SIGTERM both end the spin with exit code 0.  They are blocked and collected by
a thread of their own, so that no KeyboardInterrupt exists which a second signal could
throw into the clean-up (a launch that is interrupted delivers SIGINT twice).  The handlers
of rclpy are not used: they take the context down under the running executor, so that
nothing can be published any more while the node closes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import gc
from importlib import import_module
import os
import re
import signal
import sys
import threading
from typing import Any

from imu_bench.errors import BenchError, NotReady

INSTALL = (
    'ROS 2 is not installed for this Python. Either source an installation '
    '(source /opt/ros/jazzy/setup.bash), or on x86-64 Linux install the wheels: '
    "pip install '.[ros]' in the folder of imu_bench"
)

SIGNALS = (signal.SIGINT, signal.SIGTERM)

RECORDS, SHOWS = -5, 5
"""
Nice values: who publishes and records goes before ordinary programs, who only shows goes behind.
A step is a tenth of the processor time (sched(7)): against one busy loop 0.75 of a core, 0.25.
"""


def require_ros() -> None:
    """
    Import ROS 2, or say what to do.

    Raises
    ------
    NotReady
        If it is not installed.
    """
    try:
        import_module('rclpy')
    except ModuleNotFoundError as error:
        raise NotReady(INSTALL) from error


class _Stop:
    """The wish of the outside world that this process ends."""

    def __init__(self) -> None:
        # before any other thread exists: threads inherit the mask
        block_signals()
        self._asked = threading.Event()
        self._future: Any = None
        threading.Thread(target=self._collect, name='signals', daemon=True).start()

    def _collect(self) -> None:
        while True:
            signal.sigwait(SIGNALS)
            self._asked.set()
            if self._future is not None:
                self._future.set_result(None)

    def attach(self, future: Any) -> None:
        """Complete this future at the first signal, or now if that has been."""
        self._future = future
        if self._asked.is_set():
            future.set_result(None)


def block_signals() -> None:
    """Keep SIGINT and SIGTERM from threads and processes that are started from now on."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)


def run(
    node: str | Callable[[], Any],
    *,
    args: Sequence[str] | None = None,
    nice: int = 0,
) -> int:
    """Run a node until it is asked to stop; return the exit code of the process."""
    with suppress(OSError):  # only root may go before others
        os.setpriority(os.PRIO_PROCESS, 0, nice)
    stop = _Stop()
    command = list(sys.argv if args is None else args)
    try:
        import rclpy
    except ModuleNotFoundError as error:
        if error.name != 'rclpy':
            raise
        print(INSTALL, file=sys.stderr)  # noqa: T201  (there is no ROS logger to tell)
        return 1
    from rclpy.impl.implementation_singleton import rclpy_implementation
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args, try_shutdown

    make = _load(node) if isinstance(node, str) else node
    try:
        with _rcl_silent():
            rclpy.init(args=command, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        _logger().fatal(f'ROS 2 does not start: {_reason(str(error))}')
        return 1
    try:
        unknown = remove_ros_args(command)[1:]
        if unknown:
            if {'-h', '--help'} & set(unknown):
                print(_usage(command[0]))  # noqa: T201
                return 0
            _logger().fatal(
                f'unknown argument {unknown[0]!r}; parameters are given as '
                '--ros-args -p name:=value or --ros-args --params-file FILE'
            )
            return 2
        return _life(make, stop)
    finally:
        try_shutdown()


def _usage(program: str) -> str:
    """Return what `--help` says."""
    name = os.path.basename(program)
    return (
        f'usage: {name} [--ros-args -p NAME:=VALUE … --params-file FILE … -r __ns:=NAMESPACE]\n'
        'its parameters, with what each may be, while it runs: ros2 param list, ros2 param '
        'describe NODE NAME\n'
        'what there is of topics and parameters: docs/nodes.md; all commands: imu-bench --help'
    )


def _life(make: Callable[[], Any], stop: _Stop) -> int:
    """Construct, spin, close and destroy the node; the context outlives it."""
    from rclpy.exceptions import ParameterException
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.task import Future
    from rclpy.utilities import ok

    make_future: Any = Future  # without type hints in rclpy of Jazzy
    node: Any = None
    executor: Any = None
    try:
        _freeze_objects()
        node = make()
        _freeze_objects()
        executor = SingleThreadedExecutor()
        for each in _nodes(node):
            for service in each.services:
                service.callback = _refusing_nonsense(service)
            executor.add_node(each)
        asked = getattr(node, 'ended', None) or make_future()
        asked.add_done_callback(lambda _: executor.wake())
        stop.attach(asked)
        while ok() and not asked.done():
            # not until the future is complete: that adds a callback to it at every wake-up,
            # 2 MB a minute (ros2/rclpy issues 1371, 1374, 1702)
            executor.spin_once()
        if isinstance(asked.result(), BenchError):
            raise asked.result()
        return 0
    except ExternalShutdownException:
        return 0
    except (BenchError, ParameterException) as error:
        for line in str(error).splitlines():
            _logger().fatal(line)
        return 1
    finally:
        if node is not None:
            _take_down(node, executor)


def _freeze_objects() -> None:
    """Let the garbage collector never look again at what exists now."""
    # The hundreds of thousands of objects of the imported packages stay for good, and one walk
    # through them takes longer than the FIFO of a chip at 1 kHz can wait.
    gc.collect()
    gc.freeze()


def _refusing_nonsense(service: Any) -> Callable[[Any, Any], Any]:
    """
    Return the callback of a service, with an empty answer to a request that it cannot handle.

    rclpy raises for a transition that is not registered, and for a parameter of no type, out of
    the executor: whoever sent such a request would end the node.
    """
    handle, told = service.callback, False

    def answer(request: Any, response: Any) -> Any:
        nonlocal told
        try:
            return handle(request, response)
        except Exception as error:
            if not told:  # once: who asks without end fills no log
                told = True
                _logger().error(f'{service.srv_name}: refused a request: {_one_line(error)}')
            return service.srv_type.Response()

    return answer


def _one_line(error: Exception) -> str:
    return ' '.join(f'{type(error).__name__}: {error}'.split())


def _nodes(made: Any) -> list[Any]:
    """Return the nodes of what was made: itself, or those it stands for."""
    found: list[Any] = getattr(made, 'nodes', None) or [made]
    return found if isinstance(found, list) else [made]


def _take_down(node: Any, executor: Any) -> None:
    try:
        close = getattr(node, 'close', None)
        if close is not None:
            close()
    finally:
        for each in _nodes(node):
            if executor is not None:
                executor.remove_node(each)
            each.destroy_node()
        if executor is not None:
            executor.shutdown()


def _logger() -> Any:
    from rclpy.logging import get_logger

    return get_logger('imu_bench')


def _load(node: str) -> Callable[[], Any]:
    module, name = node.split(':')
    loaded: Callable[[], Any] = getattr(import_module(module), name)
    return loaded


@contextmanager
def _rcl_silent() -> Iterator[None]:
    """Keep rcl from logging the error that it also raises."""
    from rclpy.impl.logging_severity import LoggingSeverity
    from rclpy.logging import set_logger_level

    set_logger_level('rcl', LoggingSeverity.FATAL)
    try:
        yield
    finally:
        set_logger_level('rcl', LoggingSeverity.UNSET)


def _reason(error: str) -> str:
    """Return what rcl says without the places in its sources, and what can be done."""
    text = re.sub(r', at [^\s,]+:\d+', '', ' '.join(error.split()))
    hints = {
        'opening YAML': 'is the path right?',
        'params file': 'is it YAML with spaces instead of tabs, and names: values?',
        'logging': 'set HOME or ROS_LOG_DIR',
    }
    hint = next((hint for word, hint in hints.items() if word in text), 'check --ros-args')
    return f'{text}; {hint}'
