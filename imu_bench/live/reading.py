# SPDX-License-Identifier: Apache-2.0
"""
Sensors read in a process of their own, where nothing else runs.

A thread that empties a FIFO goes before all others where the system permits it.  That helps only
if nobody it waits for is slower: in one process with a node it would wait for Python's lock,
which a thread of ordinary priority may hold while a busy machine keeps it waiting for a core.
Here the threads that read are the only ones that ever run for long.  They hand what they read
to the process that asked for it, and keep it while that process is away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
import os
import selectors
import socket
import subprocess
import threading
import time
from typing import Any, Protocol

from imu_bench import bench
from imu_bench.acquisition import Acquisition, AcquisitionStats
from imu_bench.config import SensorConfig
from imu_bench.config.beginning import Beginning
from imu_bench.errors import BenchError, NotReady
from imu_bench.live import children
from imu_bench.live.packets import Ended, Opened, Packet, Wish
from imu_bench.samples import Samples

Deliver = Callable[[list[Samples], AcquisitionStats], None]
"""Called from a thread with what a sensor gave, oldest first, and how it goes."""

ANSWER_S = 120.0
"""So long a command may take on a busy machine; a chip is opened in some 0.5 s."""

GATHER_S = 0.02
"""
After the first packet the others are awaited so long, and taken with it: they come at the same
time, but for the time between two bursts.
"""

LEAVE_S = 5.0
"""So long a process that is told to end may take before it is killed."""


class ReaderDied(NotReady):
    """The process that reads a sensor is gone."""


class Reading(Protocol):
    """One sensor that is read, here or in a process of its own."""

    switched_on_ns: int
    """From when on the scripted faults of an emulated sensor count."""

    @property
    def stats(self) -> AcquisitionStats: ...
    @property
    def error(self) -> BenchError | None: ...
    @property
    def over(self) -> str: ...
    def prepare(self) -> str: ...
    def start(self) -> None: ...
    def stop(self) -> None: ...
    def close(self) -> None: ...
    def begin(self, at_s: float) -> None: ...


class LocalReading:
    """
    Read a sensor in this process; a thread of ordinary priority delivers.

    For tests and simulations, and where a program reads one sensor and does little else.

    Parameters
    ----------
    deliver : callable
        See `Deliver`.

    Raises
    ------
    BenchError
        As `imu_bench.bench.build`.
    """

    def __init__(self, wish: Wish, deliver: Deliver) -> None:
        self._beginning = Beginning(wish.begin_s)
        self._deliver = deliver
        self._news = threading.Event()
        self._closed = False
        self._order = threading.Lock()
        bench.import_all(wish.sensor)
        self.switched_on_ns = wish.clock.now_ns()
        self._acquisition: Acquisition = bench.build(
            wish.sensor,
            wish.clock,
            on_data=self._news.set,
            switched_on_ns=self.switched_on_ns,
            beginning=self._beginning,
        )
        name = f'deliver-{wish.sensor.name}'
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def stats(self) -> AcquisitionStats:
        """How it goes now."""
        return self._acquisition.stats

    @property
    def error(self) -> BenchError | None:
        """What is wrong now."""
        return self._acquisition.error

    @property
    def over(self) -> str:
        """Why it has ended by itself; empty until then."""
        return self._acquisition.over

    def prepare(self) -> str:
        """Check who answers and configure it; see `Acquisition.prepare`."""
        return self._acquisition.prepare()

    def start(self) -> None:
        """Start sampling; see `Acquisition.start`."""
        self._acquisition.start()

    def stop(self) -> None:
        """Stop sampling; everything that was read has been delivered afterwards."""
        self._acquisition.stop()
        self._hand_over()

    def close(self) -> None:
        """Stop, and release the bus."""
        try:
            self._acquisition.close()
        finally:
            self._closed = True
            self._news.set()
            if threading.current_thread() is not self._thread:
                self._thread.join()
        self._hand_over()

    def begin(self, at_s: float) -> None:
        """Let the scenario of an emulated sensor begin, Unix time."""
        self._beginning.at_s = at_s

    def _run(self) -> None:
        while not self._closed:
            self._news.wait()
            self._news.clear()
            self._hand_over()

    def _hand_over(self) -> None:
        with self._order:
            runs = self._acquisition.drain()
            self._deliver(runs, self._acquisition.stats)


class ReadingProcess:
    """
    A process that reads sensors; `read` adds one.

    Parameters
    ----------
    real_time : bool
        Whether its threads that read may go before others, where the system permits it.
    origin : ReadingProcess, optional
        One that reads nothing yet, to be forked from; see `several`.
    reads : sequence of SensorConfig
        What the two are going to read.
    """

    def __init__(
        self,
        *,
        real_time: bool = True,
        origin: ReadingProcess | None = None,
        reads: Sequence[SensorConfig] = (),
    ) -> None:
        self._real_time = real_time
        self._asking = threading.Lock()
        self._next = 0
        self._sources = selectors.DefaultSelector()
        # what the thread that receives listens to as well, to know when it is over
        self._over, over = socket.socketpair()
        self._sources.register(over, selectors.EVENT_READ, None)
        self._start(origin, reads)
        self._thread = threading.Thread(target=self._receive, name='readings', daemon=True)
        self._thread.start()

    def _start(
        self, origin: ReadingProcess | None = None, reads: Sequence[SensorConfig] = ()
    ) -> None:
        self._process: subprocess.Popen[bytes] | children.Forked
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        if origin is None:
            self._process = children.started(theirs.fileno(), real_time=self._real_time)
        else:
            self._process = children.Forked(origin.ask(0, 'fork', reads, theirs))
        theirs.close()
        self._socket = ours
        self._commands = Connection(os.dup(ours.fileno()))

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def several(self, count: int, sensors: Sequence[SensorConfig]) -> list[ReadingProcess]:
        """
        Return this one and others, `count` together, that share its memory; before any reads.

        The libraries that reading takes are imported once, and nothing changes them later: of
        70 MB for emulated chips each further process has 15 of its own.

        Parameters
        ----------
        count : int
            How many there are to be, this one included.
        sensors : sequence of SensorConfig
            What they are going to read.

        Raises
        ------
        NotReady
            If this one has died.
        """
        kind = self._real_time
        more = range(count - 1)
        return [self, *(ReadingProcess(real_time=kind, origin=self, reads=sensors) for _ in more)]

    def read(self, wish: Wish, deliver: Deliver) -> RemoteReading:
        """
        Return the reading of one more sensor, not started yet.

        Raises
        ------
        BenchError
            As `imu_bench.bench.build`; `NotReady` if the process has died.
        """
        if self._process.poll() is not None:
            self._socket.close()
            self._start()
        number, self._next = self._next, self._next + 1
        reading = RemoteReading(self, number, wish.sensor.name, deliver)
        # of its own: in one for all, those who send little would leave no room for those behind
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            reading.opened(self.ask(number, 'open', wish, theirs))
        except BaseException:
            ours.close()
            raise
        finally:
            theirs.close()
        self._sources.register(ours, selectors.EVENT_READ, reading)
        return reading

    def ask(
        self, number: int, verb: str, argument: Any = None, handle: socket.socket | None = None
    ) -> Any:
        """Let the process do something; return its answer."""
        with self._asking:
            try:
                self._commands.send((number, verb, argument))
                if handle is not None:
                    socket.send_fds(self._socket, [b'.'], [handle.fileno()])
                if not self._commands.poll(ANSWER_S):
                    raise NotReady(
                        f'the process that reads sensors has not answered for {ANSWER_S:g} s'
                    )
                good, answer = self._commands.recv()
            except (EOFError, OSError) as error:
                raise ReaderDied(children.how_it_ended(self._process)) from error
        if good:
            return answer
        raise answer

    def close(self) -> None:
        """End the process."""
        self._commands.close()
        with suppress(OSError):  # it has ended already
            self._socket.shutdown(socket.SHUT_RDWR)
        try:
            self._process.wait(LEAVE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._socket.close()
        self._over.close()
        self._thread.join()

    def _receive(self) -> None:
        """Hand over what comes, a packet of each sensor in turn."""
        over = False
        while not over:
            self._sources.select()
            time.sleep(GATHER_S)
            while not over and (ready := self._sources.select(0)):
                for key, _ in ready:
                    if key.data is None:
                        over = True
                    else:
                        self._take(key.fileobj, key.data)
        for key in list(self._sources.get_map().values()):
            source: Any = key.fileobj
            source.close()
        self._sources.close()

    def _take(self, source: Any, reading: RemoteReading) -> None:
        packet = Packet.received(source)
        if packet is not None:
            reading.take(packet)
            return
        self._sources.unregister(source)
        source.close()
        if not reading.closed:
            reading.lost(ReaderDied(children.how_it_ended(self._process)))


class RemoteReading:
    """A sensor that a `ReadingProcess` reads; made by its `read`."""

    def __init__(self, process: ReadingProcess, number: int, name: str, deliver: Deliver) -> None:
        self._process, self._number, self._name = process, number, name
        self._deliver = deliver
        self._ended = threading.Event()
        self.error: BenchError | None = None
        self.closed = False
        self.heard_s = time.monotonic()

    def opened(self, answer: Opened) -> None:
        """Take note of what the process made."""
        self.stats: AcquisitionStats = answer.stats
        self.switched_on_ns = answer.switched_on_ns

    @property
    def over(self) -> str:
        """Why it has ended by itself; empty until then."""
        return self.stats.over

    def prepare(self) -> str:
        """Check who answers and configure it; see `Acquisition.prepare`."""
        part: str = self._ask('prepare')
        return part

    def start(self) -> None:
        """Start sampling; see `Acquisition.start`."""
        self._ended.clear()
        self._ask('start')

    def stop(self) -> None:
        """Stop sampling; everything that was read has been delivered afterwards."""
        if isinstance(self.error, ReaderDied):
            return
        self._ask('stop')
        # the answer comes on another way than the data
        if not self._ended.wait(ANSWER_S):
            raise NotReady(f'{self._name}: what was read last has not come within {ANSWER_S:g} s')

    def close(self) -> None:
        """Stop, and release the bus; what a process held that has died is free already."""
        try:
            self.stop()
        finally:
            self.closed = True
            if not isinstance(self.error, ReaderDied):
                self._ask('close')

    def begin(self, at_s: float) -> None:
        """Let the scenario of an emulated sensor begin, Unix time."""
        self._ask('begin', at_s)

    def take(self, packet: Packet) -> None:
        """Hand over what has come."""
        self.heard_s = time.monotonic()
        if isinstance(packet.content, Ended):
            self.stats = packet.content.stats
            self._deliver([], self.stats)
            self._ended.set()
            return
        if packet.content.stats is not None:
            self.stats, self.error = packet.content.stats, packet.content.error
        self._deliver(packet.content.runs, self.stats)

    def lost(self, error: BenchError) -> None:
        """Take note that the process is gone."""
        self.error = error
        self._deliver([], self.stats)
        self._ended.set()

    def _ask(self, verb: str, argument: Any = None) -> Any:
        return self._process.ask(self._number, verb, argument)
