# SPDX-License-Identifier: Apache-2.0
"""
Does the analysis node take six sensors at 0.18 of a core, and 12 000 messages/s without loss?

Real processes over loopback: one publisher per sensor, the node as users start it, and for
comparison the plain subscriber everybody writes first (message objects, default
executor, no analysis at all).  Prints what was offered, received and lost, and the share of a
core that the receiving process used.

A window of 600 s would take 600 s to fill, so the analysis alone is measured with a full
window as well, without ROS: seconds of work per second of data of all sensors, with new metrics
as often as the node makes them.  Together with what the messages cost that is the share of a core
after ten minutes.
"""

from __future__ import annotations

import itertools
import math
import os
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from imu_bench.nodes.live_analysis import LiveAnalysis
from imu_bench.nodes.processes import BenchProcesses
from imu_bench.samples import Samples
import numpy as np
import rclpy

from benchmarks._frame import Benchmark
from benchmarks._measured import cpu_seconds

BENCH = (400.0, 1000.0, 952.0, 100.0, 1344.0, 1000.0)
"""Rates of the six sensors of Shabulinzenze 2020 in Hz: 4796 messages per second."""

LOADS = {'six sensors': BENCH, 'eight at 1 kHz': (1000.0,) * 8, 'twelve at 1 kHz': (1000.0,) * 12}

TAKES = 0.18
"""Of a core, at most."""

SETTLING = 0.2
"""Part of the time that counts for the losses and not for the core: the nodes find each other."""

FETCH_S = 3.0
"""At most so long a receiver may take for what has been sent."""


class Row(NamedTuple):
    """One line of the table."""

    offered_hz: float
    sent: int
    received: int
    cpu_share: float
    analysis_share: float


class Receiver:
    """The process under test, and what it says of itself on /diagnostics."""

    def __init__(self, module: str, arguments: list[str], logs: Path) -> None:
        self._processes = BenchProcesses(logs, os.environ)
        self._processes.start('receiver', module, arguments)
        self.received: dict[str, int] = {}
        self.analysis_share = 0.0
        self._node: Any = rclpy.create_node('benchmark')  # rclpy of Jazzy has few type hints
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._keep, 100)

    def _keep(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if 'received' in values:
                self.received[status.name] = int(values['received'])
            self.analysis_share = float(values.get('analysis_share', self.analysis_share))

    @property
    def cpu_s(self) -> float:
        """Seconds of processor time used so far."""
        return cpu_seconds(self._processes.number('receiver'))

    def listen(self, seconds: float, sent: float = math.inf) -> None:
        """Let time pass, or until so many messages are received."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0 and sum(self.received.values()) < sent:
            rclpy.spin_once(self._node, timeout_sec=left)

    def why_not(self) -> str:
        """Return what is known of a receiver that did not subscribe."""
        code = self._processes.ended().get('receiver')
        if code is None:
            return 'the receiver runs and did not subscribe'
        return f'the receiver ended with {code}: {self._processes.last_words("receiver")}'

    def close(self) -> None:
        """End the process."""
        self._processes.stop()
        self._node.destroy_node()


class Publisher:
    """One sensor; see `benchmarks._imu_publisher`."""

    def __init__(self, topic: str, rate_hz: float, seconds: float) -> None:
        module = ['-m', 'benchmarks._imu_publisher']
        self._process: Any = subprocess.Popen(
            [sys.executable, *module, topic, str(rate_hz), str(seconds)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def begin(self, at_s: float) -> None:
        """Say when to start, s of `time.time`."""
        self._process.stdin.write(f'{at_s}\n')
        self._process.stdin.flush()

    def says(self) -> str:
        """Wait for its next line; it is empty when the process ended."""
        return str(self._process.stdout.readline())

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def measure(receiver: Receiver, rates: tuple[float, ...], seconds: float) -> Row:
    """Return what one receiver made of one load."""
    publishers = [
        Publisher(f'/bench/sensor{index}/imu/data_raw', rate, seconds)
        for index, rate in enumerate(rates)
    ]
    try:
        if any(one.says() != 'ready\n' for one in publishers):
            raise SystemExit(receiver.why_not())
        start = time.time() + 0.5
        for one in publishers:
            one.begin(start)
        receiver.listen(SETTLING * seconds)
        before, began = receiver.cpu_s, time.monotonic()
        receiver.listen((1 - SETTLING) * seconds)
        share = (receiver.cpu_s - before) / (time.monotonic() - began)
        analysis_share = receiver.analysis_share
        sent = sum(int(one.says()) for one in publishers)
        receiver.listen(FETCH_S, sent)
    finally:
        for one in publishers:
            one.close()
        receiver.close()
    return Row(sum(rates), sent, sum(receiver.received.values()), share, analysis_share)


def full_window(rates: tuple[float, ...], window_s: float, seconds: int = 5) -> float:
    """Return seconds of work per second of data, in blocks as the node takes them."""
    rng = np.random.default_rng(1)
    work = 0.0
    for rate in rates:
        analysis = LiveAnalysis(window_s)
        total = round(rate * (window_s + seconds))
        stamps = np.rint(np.arange(total) * (1e9 / rate)).astype(np.int64)
        values = rng.normal(size=(2, total, 3))
        block = max(1, round(rate / 10))
        filled = round(rate * window_s)
        for start in range(0, total, block):
            part = slice(start, start + block)
            clock = time.process_time()
            analysis.add(Samples(stamps[part], values[0, part], values[1, part]))
            if start >= filled:
                work += time.process_time() - clock
        clock = time.process_time()
        analysis.result()
        # the node waits as long as this for a window that has changed
        work += (time.process_time() - clock) * seconds / max(1.0, analysis.refresh_s)
    return work / seconds


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--seconds', 20.0, quick=1.0, help='of each load')
    bench.add_size('--window', 600.0, quick=5.0, help='seconds of the analysis window')
    bench.add_size('--loads', len(LOADS), quick=1, help='how many of the loads')
    options = bench.start()
    window = f'window_s:={options.window}'
    receivers = {
        'analysis node': ('imu_bench.nodes.analysis_node', ['--ros-args', '-p', window]),
        'plain': ('benchmarks._plain_subscriber', []),
    }
    bench.head('load', 'receiver', 'offered/s', 'sent', 'lost', 'core')
    rows = {}
    rclpy.init(args=[])
    with TemporaryDirectory() as logs:
        for load, rates in itertools.islice(LOADS.items(), options.loads):
            for name, (module, arguments) in receivers.items():
                receiver = Receiver(module, arguments, Path(logs))
                row = rows[load, name] = measure(receiver, rates, options.seconds)
                lost = row.sent - row.received
                bench.row(
                    load, name, f'{row.offered_hz:.0f}', row.sent, lost, f'{row.cpu_share:.1%}'
                )
                if name != 'plain':
                    bench.claim(f'{load}: lost', lost, at_most=0, unit='messages')
    rclpy.shutdown()

    six, plain = rows['six sensors', 'analysis node'], rows['six sensors', 'plain']
    messages = max(0.0, six.cpu_share - six.analysis_share)
    full = messages + full_window(BENCH, options.window)
    over = six.cpu_share / plain.cpu_share
    print(
        f'\nsix sensors: {over:.2f} of the time of the plain subscriber; messages {messages:.1%}'
    )
    bench.claim('six sensors', six.cpu_share, at_most=TAKES, unit='cores')
    bench.claim('six sensors, window full', full, at_most=TAKES, unit='cores')
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
