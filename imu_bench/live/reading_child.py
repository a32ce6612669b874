# SPDX-License-Identifier: Apache-2.0
"""
The process that reads sensors: ``python -m imu_bench.live.reading_child`` of `live.reading`.

The main thread only takes commands, one at a time, and otherwise sleeps, so that no thread that
reads ever waits for it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import gc
from multiprocessing.connection import Connection
import os
import signal
import socket
import sys
import time

from imu_bench import bench
from imu_bench.acquisition import Acquisition, AcquisitionStats, priority
from imu_bench.config import SensorConfig
from imu_bench.config.beginning import Beginning
from imu_bench.errors import BenchError
from imu_bench.live.packets import Data, Ended, Opened, Packet, Wish
from imu_bench.samples import Samples

SWITCH_S = 0.5e-3
"""
How long a thread keeps Python's lock while another waits for it.

The default of 5 ms is the sample period of an inclinometer, and a reading asks for the lock after
each of its ten frames.
"""

KEPT_S = 120.0
KEPT_SAMPLES = 500_000
"""
What is kept for a process that is away: so long, and never more than this.  A sample of an IMU
takes some 100 bytes in bursts and 1.2 kB alone, as polled chips give them: 50 MB at most.
"""

STATS_S = 0.5
"""How often it is said how a sensor does; at once when that changes."""

PACKET_SAMPLES = 400
"""Samples in one packet at most: 60 kB, of the 208 kB that a socket of Linux holds by default."""


class Sender:
    """Hands over what one acquisition gives, from its own thread, without ever waiting."""

    def __init__(self, data: socket.socket, every_s: float, *, always_say: bool) -> None:
        self.acquisition: Acquisition | None = None
        self._data, self._always_say = data, always_say
        self._every_s, self._turn = every_s, 0.0
        self._outbox: deque[bytes] = deque()
        self._said_s = 0.0
        self._said: tuple[object, ...] = ()

    def push(self) -> None:
        """Send what there is, as far as there is room; the rest stays in the acquisition."""
        acquisition = self.acquisition
        if acquisition is None:
            return
        if acquisition.over:
            self.flush()
            return
        # all sensors at the same time, so that who receives them wakes up once for all
        now = time.monotonic()
        turn = now // self._every_s if self._every_s else now
        if not self._outbox and (turn != self._turn or self._state(acquisition) != self._said):
            self._turn = turn
            self._collect(acquisition)
        while self._outbox:
            try:
                self._data.send(self._outbox[0], socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
            except BlockingIOError:
                return
            except OSError:
                # nobody is there any more, and the main thread is about to notice
                self._outbox.clear()
                return
            self._outbox.popleft()

    def flush(self) -> None:
        """Send everything, however long it takes."""
        if self.acquisition is not None:
            self._collect(self.acquisition)
        while self._outbox:
            self._data.send(self._outbox.popleft(), socket.MSG_NOSIGNAL)

    def end(self) -> None:
        """Send everything, and that this was all."""
        self.flush()
        if self.acquisition is not None:
            ended = Packet(Ended(self.acquisition.stats))
            self._data.send(ended.raw(), socket.MSG_NOSIGNAL)

    def _collect(self, acquisition: Acquisition) -> None:
        # before the runs, so that nobody sees more samples than are counted
        runs, stats = acquisition.drain(), self._news(acquisition)
        held: list[Samples] = []
        size = 0
        for joined in by_stream(runs):
            for start in range(0, len(joined), PACKET_SAMPLES):
                part = joined[start : start + PACKET_SAMPLES]
                if held and size + len(part) > PACKET_SAMPLES:
                    self._put(held, stats, acquisition.error)
                    held, size, stats = [], 0, None
                held.append(part)
                size += len(part)
        if held or stats is not None:
            self._put(held, stats, acquisition.error)

    def _put(
        self, runs: list[Samples], stats: AcquisitionStats | None, error: BenchError | None
    ) -> None:
        self._outbox.append(Packet(Data(runs, stats, error)).raw())

    def _news(self, acquisition: Acquisition) -> AcquisitionStats | None:
        now, state = time.monotonic(), self._state(acquisition)
        if not self._always_say and state == self._said and now - self._said_s < STATS_S:
            return None
        self._said, self._said_s = state, now
        priority.watch_budget()
        return acquisition.stats

    @staticmethod
    def _state(acquisition: Acquisition) -> tuple[object, ...]:
        return type(acquisition.error), acquisition.over


def by_stream(runs: list[Samples]) -> list[Samples]:
    """
    Join the runs of each stream, though those of others lie between them.

    What is told of one quantity stays in its order, also where the others of its run change, as
    when an orientation comes and goes.
    """
    groups: list[tuple[tuple[str, ...], list[Samples]]] = []
    for run in runs:
        kind = tuple(run.columns)
        for known, group in reversed(groups):
            if known == kind:
                group.append(run)
                break
            if not set(known).isdisjoint(kind):
                groups.append((kind, [run]))
                break
        else:
            if kind:
                groups.append((kind, [run]))
    return [Samples.concatenate(group) for _, group in groups]


class Sensor:
    """One sensor of this process."""

    def __init__(self, data: socket.socket, wish: Wish) -> None:
        self._data = data
        self._beginning = Beginning(wish.begin_s)
        sensor = wish.sensor
        bench.import_all(sensor)
        # what comes of a fault is told from how it went at that very moment
        scripted = bool(bench.faults_of(sensor))
        self._sender = Sender(data, wish.every_s, always_say=scripted)
        self.switched_on_ns = wish.clock.now_ns()
        self.acquisition = bench.build(
            sensor,
            wish.clock,
            on_data=self._sender.push,
            switched_on_ns=self.switched_on_ns,
            beginning=self._beginning,
        )
        self.acquisition.keep(KEPT_S, KEPT_SAMPLES)
        self._sender.acquisition = self.acquisition

    def do(self, verb: str, argument: object) -> object:
        """Do what was asked; return the answer."""
        if verb == 'prepare':
            return self.acquisition.prepare()
        if verb == 'start':
            self.acquisition.start()
        elif verb == 'stop':
            self.acquisition.stop()
            self._sender.end()
        elif verb == 'begin':
            self._beginning.at_s = float(argument)  # type: ignore[arg-type]
        elif verb == 'close':
            self.acquisition.close()
            self._data.close()
        return None


def serve(line: socket.socket) -> None:
    """Do what is asked until nobody is there any more; then release everything."""
    sensors: dict[int, Sensor] = {}
    commands = Connection(os.dup(line.fileno()))
    try:
        while True:
            number, verb, argument = commands.recv()
            try:
                answer: object = None
                if verb == 'fork':
                    answer, line, commands = _fork(line, commands, argument)
                    if not answer:
                        continue
                elif verb == 'open':
                    data = _received(line)
                    sensors[number] = sensor = Sensor(data, argument)
                    gc.collect()
                    gc.freeze()
                    answer = Opened(sensor.acquisition.stats, sensor.switched_on_ns)
                else:
                    answer = sensors[number].do(verb, argument)
                    if verb == 'close':
                        del sensors[number]
                reply = True, answer
            except BenchError as error:
                reply = False, error
            commands.send(reply)
    except (EOFError, OSError):
        pass  # the process that asked has ended: so does this one
    for sensor in sensors.values():
        sensor.acquisition.close()


def _fork(
    line: socket.socket, commands: Connection, sensors: Sequence[SensorConfig]
) -> tuple[int, socket.socket, Connection]:
    """Return as `os.fork` does, with the line on which this process is told what to do."""
    other = _received(line)
    for sensor in sensors:
        bench.import_all(sensor)
    gc.collect()
    gc.freeze()
    if pid := os.fork():
        other.close()
        return pid, line, commands
    commands.close()
    line.close()
    priority.lock_memory()
    return 0, other, Connection(os.dup(other.fileno()))


def _received(line: socket.socket) -> socket.socket:
    _, (handle,), _, _ = socket.recv_fds(line, 1, 1)
    return socket.socket(fileno=handle)


def main(arguments: list[str]) -> None:
    """Serve on a socket that was inherited."""
    # Ctrl-C in the terminal is for the process that started this one
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    # nobody waits for what was forked
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    line, kind = arguments
    sys.setswitchinterval(SWITCH_S)
    if kind != 'real-time':
        priority.lower('it was asked for')
    priority.limit()
    priority.lock_memory()
    gc.collect()
    gc.freeze()
    serve(socket.socket(fileno=int(line)))


if __name__ == '__main__':
    # under the name by which its packets are known elsewhere
    from imu_bench.live import reading_child

    reading_child.main(sys.argv[1:])
