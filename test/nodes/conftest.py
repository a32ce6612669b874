# SPDX-License-Identifier: Apache-2.0
"""Nodes on a context of their own, spun by hand until something has happened."""

from collections.abc import Callable
import os
from pathlib import Path
import subprocess
import sys
import time

import pytest

PATIENCE_S = 300.0
"""Nothing waits this long on a healthy machine; it ends a test that would hang."""


class Ros:
    """A context with its nodes; ROS 2 is imported when a test asks for it."""

    def __init__(self):
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self.context = Context()
        self.context.init(args=[])
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes = []

    def add(self, make, *args, parameters=None, **options):
        """Make a node with parameters as a user would give them, and spin it from now on."""
        from rclpy.parameter import Parameter

        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        node = make(*args, context=self.context, parameter_overrides=overrides, **options)
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def spin_until(self, happened: Callable[[], object], what: str = ''):
        """Spin until something is true and return it."""
        deadline = time.monotonic() + PATIENCE_S
        while not (result := happened()):
            if time.monotonic() > deadline:
                raise AssertionError(f'did not happen within {PATIENCE_S:g} s: {what or happened}')
            self.executor.spin_once(timeout_sec=0.1)
        return result

    def call(self, client, request):
        """Call a service and return its response."""
        self.spin_until(client.service_is_ready, client.srv_name)
        future = client.call_async(request)
        self.spin_until(future.done, client.srv_name)
        return future.result()

    def close(self):
        """Close every node in the order in which a process would."""
        for node in self.nodes:
            if hasattr(node, 'close'):
                node.close()
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()


@pytest.fixture
def ros(monkeypatch):
    """Give a context of ROS 2 with a hand-spun executor."""
    # sensors that go on are not silent, however long a recorder that is closed waits for that
    monkeypatch.setattr('imu_bench.nodes.intake.LINGER_S', 0.5)
    made = Ros()
    yield made
    made.close()


@pytest.fixture
def elsewhere(ros):
    """Another process, as far as the middleware can tell."""
    made = type(ros)()
    yield made
    made.close()


@pytest.fixture
def said(ros):
    """Return what is said on /diagnostics, by name; of whom has not spoken yet it is empty."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
    from rclpy.node import Node

    class Said(dict):
        def __missing__(self, name):
            return DiagnosticStatus()

    found = Said()

    def listen(message):
        found.update({status.name: status for status in message.status})

    ros.add(Node, 'listener').create_subscription(DiagnosticArray, '/diagnostics', listen, 100)
    return found


class Process:
    """One executable of the bench, as a user would start it, or a script."""

    def __init__(self, module, *arguments, **environment):
        program = [str(module)] if isinstance(module, Path) else ['-m', module]
        self.process = subprocess.Popen(
            [sys.executable, *program, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, 'PYTHONUNBUFFERED': '1', **environment},
        )

    def wait_for(self, text):
        """Return the first line of output that contains a text."""
        lines = []
        for line in self.process.stdout:
            lines.append(line)
            if text in line:
                return line
        raise AssertionError(f'{text!r} is not in the output:\n{"".join(lines)}')

    def finish(self):
        """Wait for the end; return exit code and the rest of the output."""
        output, _ = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, output


@pytest.fixture
def start():
    """Start executables that do not outlive the test."""
    running = []

    def start_one(module, *arguments, **environment):
        running.append(Process(module, *arguments, **environment))
        return running[-1]

    yield start_one
    for each in running:
        if each.process.poll() is None:
            each.process.kill()
        each.process.communicate()
