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
from contextlib import contextmanager
import gc
from importlib import import_module
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

_SPIN_S = 3600.0
"""
Spin in stretches of this length: without a timeout the events executor of the Jazzy wheels
burns a whole core and is deaf to other threads (their C++ library computes an endless
deadline that overflows).
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
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
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


def run(
    node: str,
    *,
    args: Sequence[str] | None = None,
    executor: str = 'single',
    imported: Callable[[], None] | None = None,
) -> int:
    """
    Run one node until it is asked to stop; return the exit code of the process.

    Parameters
    ----------
    node : str
        'module:Class' of the node; imported late.
    args : sequence of str, optional
        Command line with the program's name first; sys.argv by default.
    executor : {'single', 'events'}
        'events' handles many more messages per second, but no guard conditions.
    imported : callable, optional
        Called when everything is imported and no thread of ROS exists yet.

    Returns
    -------
    int
        0 after SIGINT, SIGTERM or a shutdown of the context; 1 when ROS 2 is missing or
        the node refused its parameters or failed; 2 for unknown arguments.
    """
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

    make = _load(node)
    if imported is not None:
        imported()
    try:
        with _rcl_silent():
            rclpy.init(args=command, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        _logger().fatal(f'ROS 2 does not start: {_reason(str(error))}')
        return 1
    try:
        unknown = remove_ros_args(command)[1:]
        if unknown:
            _logger().fatal(
                f'unknown argument {unknown[0]!r}; parameters are given as '
                '--ros-args -p name:=value or --ros-args --params-file FILE'
            )
            return 2
        return _life(make, executor, stop)
    finally:
        try_shutdown()


def _life(make: Callable[[], Any], executor_name: str, stop: _Stop) -> int:
    """Construct, spin, close and destroy the node; the context outlives it."""
    from rclpy.exceptions import ParameterException
    from rclpy.executors import ExternalShutdownException
    from rclpy.task import Future
    from rclpy.utilities import ok

    make_future: Any = Future  # without type hints in rclpy of Jazzy
    node, executor = None, None
    try:
        _spare_the_collector()
        node = make()
        executor = _executor(executor_name)
        executor.add_node(node)
        asked = getattr(node, 'ended', None) or make_future()
        stop.attach(asked)
        while ok() and not asked.done():
            executor.spin_until_future_complete(asked, _SPIN_S)
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


def _spare_the_collector() -> None:
    """
    Let the garbage collector never look again at what exists now.

    The hundreds of thousands of objects of the imported packages stay for good, and one walk
    through them takes longer than the FIFO of a chip at 1 kHz can wait.
    """
    gc.collect()
    gc.freeze()


def spare_the_collector_again() -> None:
    """
    Do so for what has been imported since, as an emulated chip with its libraries.

    Nothing happens in a process that `run` has not started.
    """
    if gc.get_freeze_count():
        _spare_the_collector()


def _take_down(node: Any, executor: Any) -> None:
    try:
        close = getattr(node, 'close', None)
        if close is not None:
            close()
    finally:
        if executor is not None:
            executor.remove_node(node)
            executor.shutdown()
        node.destroy_node()


def _executor(name: str) -> Any:
    from rclpy.executors import SingleThreadedExecutor

    if name == 'events':
        try:
            from rclpy.experimental.events_executor import EventsExecutor
        except ImportError:
            _logger().warning(
                'this rclpy has no events executor (7.1.4 and later have): messages cost more'
            )
        else:
            return EventsExecutor()
    return SingleThreadedExecutor()


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
    """
    Return what rcl says without the places in its sources, and what can be done.

    Examples
    --------
    >>> _reason("Couldn't parse params file: 'a'. Error opening YAML file, at /a.c:1")
    "Couldn't parse params file: 'a'. Error opening YAML file; is the path right?"
    """
    text = re.sub(r', at [^\s,]+:\d+', '', ' '.join(error.split()))
    hints = {
        'opening YAML': 'is the path right?',
        'params file': 'is it YAML with spaces instead of tabs, and names: values?',
        'logging': 'set HOME or ROS_LOG_DIR',
    }
    hint = next((hint for word, hint in hints.items() if word in text), 'check --ros-args')
    return f'{text}; {hint}'
