# SPDX-License-Identifier: Apache-2.0
"""
Does the analysis node take six sensors at under half a core, and 12 000 messages/s without loss?

Real processes over loopback: one publisher per sensor, the node as users start it, and for
comparison the plain subscriber everybody writes first (message objects, default
executor, no analysis at all).  Prints what was offered, received and lost, and the share of a
core that the receiving process used.  Run as ``python -m benchmarks.analysis_node
[seconds]``.

A window of 600 s would take 600 s to fill, so the analysis alone is measured with a full
window as well, without ROS: seconds of work per second of data of all sensors.  Together with
what the messages cost that is the share of a core after ten minutes.
"""

from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from imu_bench.nodes.live_analysis import LiveAnalysis
from msg_conversions.cdr import ImuBlock
import numpy as np
import rclpy

BENCH = (400.0, 1000.0, 952.0, 100.0, 1344.0, 1000.0)
"""Rates of the six sensors of Shabulinzenze 2020 in Hz: 4796 messages per second."""

LOADS = {'six sensors': BENCH, 'eight at 1 kHz': (1000.0,) * 8, 'twelve at 1 kHz': (1000.0,) * 12}

SECONDS = 20.0
WARM_UP_S = 4.0
WINDOW_S = 600.0
HALF = 0.5

NODE = ['-m', 'imu_bench.nodes.analysis_node', '--ros-args', '-p', f'window_s:={WINDOW_S}']
PLAIN = ['-m', 'benchmarks._plain_subscriber']


@dataclass
class Row:
    """One line of the table."""

    offered_hz: float
    sent: int
    received: int
    cpu_share: float
    analysis_share: float


class Receiver:
    """The process under test, and what it says of itself on /diagnostics."""

    def __init__(self, command: list[str]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.received: dict[str, int] = {}
        self.analysis_share = 0.0
        self._node = rclpy.create_node('benchmark')
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._keep, 100)

    def _keep(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if 'received' in values:
                self.received[status.name] = int(values['received'])
            self.analysis_share = float(values.get('analysis_share', self.analysis_share))

    @property
    def cpu_s(self) -> float:
        """Seconds of processor time used so far (proc(5), fields 14 and 15 of stat)."""
        text = Path(f'/proc/{self.process.pid}/stat').read_text()
        fields = text.rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def listen(self, seconds: float) -> None:
        """Let time pass."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            rclpy.spin_once(self._node, timeout_sec=left)

    def close(self) -> None:
        """End the process."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(20.0)
        self._node.destroy_node()


def measure(command: list[str], rates: tuple[float, ...], seconds: float) -> Row:
    """Return what one receiver made of one load."""
    receiver = Receiver(command)
    publishers = [
        subprocess.Popen(
            [
                *(sys.executable, '-m', 'benchmarks._imu_publisher'),
                *(f'/bench/sensor{index}/imu/data_raw', str(rate), str(seconds)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for index, rate in enumerate(rates)
    ]
    lines = [publisher.stdout.readline() for publisher in publishers]
    if not all(lines):
        receiver.process.kill()
        raise SystemExit(f'the receiver did not subscribe: {" ".join(command)}')
    start = time.time() + 0.5
    for publisher in publishers:
        publisher.stdin.write(f'{start}\n')
        publisher.stdin.flush()
    receiver.listen(WARM_UP_S)
    before = receiver.cpu_s
    receiver.listen(seconds - WARM_UP_S)
    share = (receiver.cpu_s - before) / (seconds - WARM_UP_S)
    analysis_share = receiver.analysis_share
    sent = sum(int(publisher.stdout.readline()) for publisher in publishers)
    receiver.listen(3.0)
    received = sum(receiver.received.values())
    for publisher in publishers:
        publisher.communicate()
    receiver.close()
    return Row(sum(rates), sent, received, share, analysis_share)


def full_window(rates: tuple[float, ...], seconds: int = 5) -> float:
    """Return seconds of work per second of data, in blocks as the node takes them."""
    rng = np.random.default_rng(1)
    work = 0.0
    for rate in rates:
        analysis = LiveAnalysis(WINDOW_S)
        total = round(rate * (WINDOW_S + seconds))
        stamps = np.rint(np.arange(total) * (1e9 / rate)).astype(np.int64)
        values = rng.normal(size=(2, total, 3))
        known = np.zeros(total)
        block = max(1, round(rate / 10))
        filled = round(rate * WINDOW_S)
        for start in range(0, total, block):
            part = slice(start, start + block)
            clock = time.process_time()
            analysis.add(
                ImuBlock(
                    stamps[part], values[0, part], values[1, part], known[part], known[part],
                    ('imu_link',),
                )
            )  # fmt: skip
            if start >= filled:
                work += time.process_time() - clock
        clock = time.process_time()
        analysis.result()
        work += (time.process_time() - clock) * seconds
    return work / seconds


def main(seconds: float = SECONDS) -> int:
    """Print the table; return 1 if a claim does not hold."""
    os.environ.setdefault('OMP_NUM_THREADS', '1')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    rclpy.init(args=[])
    print(f'{"load":<16} {"receiver":<14} {"offered/s":>9} {"sent":>8} {"lost":>7} {"core":>6}')
    rows = {}
    for name, rates in LOADS.items():
        for receiver, command in (('analysis node', NODE), ('plain', PLAIN)):
            row = rows[name, receiver] = measure(command, rates, seconds)
            print(
                f'{name:<16} {receiver:<14} {row.offered_hz:9.0f} {row.sent:8d} '
                f'{row.sent - row.received:7d} {row.cpu_share:6.1%}',
                flush=True,
            )
    rclpy.shutdown()
    return 0 if verdict(rows) else 1


def verdict(rows: dict[tuple[str, str], Row]) -> bool:
    """Print what follows from the table; return whether the claims hold."""
    six, plain = rows['six sensors', 'analysis node'], rows['six sensors', 'plain']
    twelve = rows['twelve at 1 kHz', 'analysis node']
    messages = max(0.0, six.cpu_share - six.analysis_share)
    analysis = full_window(BENCH)
    print(
        f'six sensors, window of {WINDOW_S:g} s full: messages {messages:.1%} '
        f'+ analysis {analysis:.1%} = {messages + analysis:.1%} of a core'
    )
    print(
        f'six sensors: {six.cpu_share / plain.cpu_share:.2f} of the time of the plain subscriber'
    )
    lost = any(row.sent != row.received for row in (six, twelve))
    return not lost and six.cpu_share < HALF and messages + analysis < HALF


if __name__ == '__main__':
    sys.exit(main(*map(float, sys.argv[1:])))
