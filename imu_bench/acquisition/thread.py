# SPDX-License-Identifier: Apache-2.0
"""One thread per sensor: it reads on time, counts what goes wrong, and brings the sensor back."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
import threading

from imu_bench.acquisition import priority
from imu_bench.acquisition.correction import Correct
from imu_bench.acquisition.device import Device, NoTape, Tape
from imu_bench.acquisition.stats import AcquisitionStats, error_of
from imu_bench.acquisition.streams import (
    CountedStream,
    main_stream,
    PacedStream,
    PolledStream,
    Schedule,
)
from imu_bench.bus.interface import Clock
from imu_bench.errors import BenchError, NotReady, RecordingError, RecordingOver
from imu_bench.metrology.estimate import Estimate
from imu_bench.samples import Samples

CAPACITY_S = 10.0
"""Default length of the queue: a consumer may be away for this long."""

RETRIES = 3
"""So many readings may fail in a row before the sensor is brought up again."""

FIRST_BACKOFF_S = 0.05
LONGEST_BACKOFF_S = 0.4
"""Pause between attempts to bring a sensor up: short enough to be back within 2 s."""

UNDATED = Estimate.not_observable(
    'Hz', 'it is read too seldom to tell its pace; see the delivered rate'
)


UNDATED_STAMPS = Estimate.not_observable('s', UNDATED.reason)


class Acquisition:
    """
    Read a sensor from a thread of its own, into a bounded queue.

    The bus thread never waits for a consumer: what does not fit into the queue
    is dropped and counted as lost.  An error never ends the acquisition; it is
    counted and shown, and the sensor is brought up again until it works.

    Parameters
    ----------
    driver : Device
        A driver on its bus.
    clock : Clock
        The time in which it lives; with a simulated one use `advance`.
    capacity_samples : int, optional
        Length of the queue; `CAPACITY_S` of samples by default.
    on_data : callable, optional
        Called from the thread whenever there is something to drain, or to say.
    correct : callable, optional
        Calibration, applied to every run as it is drained.
    tape : Tape, optional
        What records or plays the wire.
    name : str
        Of the thread and in error texts.
    """

    def __init__(
        self,
        driver: Device,
        clock: Clock,
        *,
        capacity_samples: int | None = None,
        on_data: Callable[[], None] | None = None,
        correct: Correct | None = None,
        tape: Tape | None = None,
        name: str = 'sensor',
    ) -> None:
        self.name = name
        self._tape: Tape = tape or NoTape()
        self._correct = correct
        self.on_data = on_data
        self.error: BenchError | None = None  # what is wrong now
        self.device = driver  # what is read; only its own thread touches it while that runs
        self._clock = clock
        self._capacity = capacity_samples or max(64, round(CAPACITY_S * driver.rate_hz))
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._queue: deque[Samples] = deque()
        self._queued = 0
        self._counts: Counter[str] = Counter()
        self._errors: Counter[str] = Counter()
        # why it has ended by itself: what is played has no more.  Empty until then
        self.over = self._last_error = self._scheduling = ''
        self._main = main_stream(driver.rate_hz, driver.paced)
        self._beside: dict[tuple[str, ...], PolledStream] = {}
        self._state = 'stopped'
        self._part = ''
        self._ready = False
        self._failures_in_row = 0
        self._backoff_s = FIRST_BACKOFF_S
        self._continuity = 0
        self._heard_ns = self._looked_ns = 0
        self._schedule = Schedule(driver, 0)
        self._due_ns = 0

    def prepare(self) -> str:
        """
        Check who answers and configure it, in the caller's thread; return the part's name.

        Not needed before `start`, which does the same and keeps trying: this
        is for those who want to refuse a sensor that is not there.

        Raises
        ------
        BenchError
            If the sensor does not answer, or is another one.
        """
        self._part = self.device.identify()
        self.device.configure()
        self._ready = True
        return self._part

    def start(self) -> None:
        """
        Start the thread; errors show in `error` and `stats`, not here.

        Raises
        ------
        NotReady
            If it runs already.
        RecordingError
            If what is played has no more.
        """
        if self._thread is not None:
            raise NotReady(f'{self.name}: acquisition runs already; stop it first')
        self._tape.begin()
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, name=f'acquire-{self.name}', daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """
        Stop thread and stream; what was read stays to be drained.

        Raises
        ------
        NotReady
            If the thread does not end in time; a transfer on the bus hangs then.
        """
        if self._thread is None:
            return
        self._stopping.set()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            raise NotReady(
                f'{self.name}: the bus has not answered for {timeout_s:g} s; '
                'check the wiring, then end the process'
            )
        self._thread = None

    def close(self) -> None:
        """Stop, and release the bus."""
        self.stop()
        self._tape.finish()
        self.device.close()

    def drain(self) -> list[Samples]:
        """Return everything that waits, oldest first; stamps rise within each stream."""
        with self._lock:
            waiting, self._queued = list(self._queue), 0
            self._queue.clear()
        return waiting if self._correct is None else [self._correct(run) for run in waiting]

    @property
    def stats(self) -> AcquisitionStats:
        """A picture of now; may be taken from any thread."""
        with self._lock:
            model, meter = self._main.model, self._main.meter
            rate = model.rate() if self.device.dated else UNDATED
            return AcquisitionStats(
                state=self._state,
                error='' if self.error is None else str(self.error),
                part=self._part,
                nominal_hz=model.nominal_hz,
                rate=rate,
                rate_error=error_of(rate, model.nominal_hz),
                delivered=meter.delivered(),
                jitter=meter.jitter(),
                stamp_uncertainty=model.uncertainty() if self.device.dated else UNDATED_STAMPS,
                samples=self._counts['samples'],
                lost=self._counts['lost'] + model.missing + self._counts['dropped'],
                dropped=self._counts['dropped'],
                bus_errors=self.device.counters['bus_errors'],
                failures=self._counts['failures'],
                recoveries=self._counts['recoveries'],
                late=self._counts['late'],
                queued=self._queued,
                counters=dict(self.device.counters),
                errors=dict(self._errors),
                last_error=self._last_error,
                scheduling=priority.still(self._scheduling),
                over=self.over,
                tape=self._tape.said,
                tape_problem=self._tape.problem,
            )

    def keep(self, seconds: float, most: int) -> None:
        """Let the queue hold so much, and never more than `most` samples."""
        self._capacity = min(max(64, round(seconds * self.device.rate_hz)), most)

    def step(self) -> int:
        """
        Do what is due now; return when to come back, in ns of the clock.

        The thread does nothing but this.  Tests and simulations call it themselves.

        Raises
        ------
        RecordingError
            If what is played has no more, or cannot be played further.
        """
        try:
            if self._state == 'running':
                self._read()
            else:
                self._bring_up()
        except RecordingError:
            raise
        except BenchError as error:
            due_ns = self._failed(error)
            if self.on_data is not None:
                self.on_data()
            return due_ns
        return self._next_due()

    def advance(self, until_ns: int) -> None:
        """Run in the caller's thread until a time of a simulated clock."""
        if self._state == 'stopped':
            self._begin()
        try:
            while self._due_ns <= until_ns:
                self._clock.sleep_until(self._due_ns)
                self._due_ns = self.step()
            self._clock.sleep_until(until_ns)
        except RecordingError as error:
            self._end(error)

    def finish(self) -> None:
        """End the stream in the caller's thread; hand over what was held back."""
        self._tape.finish()
        if self._state == 'running':
            try:
                self.device.stop()
            except BenchError as error:
                self._counts['failures'] += 1
                self.error = error
        with self._lock:
            self._enqueue(self._main.flush())
            self._state = 'stopped'
            news = self._queued > 0 or self.over
        if news and self.on_data is not None:
            self.on_data()

    def _run(self) -> None:
        self._scheduling = priority.raise_priority()
        self._begin()
        try:
            while not self._stopping.is_set():
                due_ns = self.step()
                self._clock.sleep_until(due_ns)
        except RecordingError as error:
            self._end(error)
        finally:
            self.finish()

    def _end(self, error: RecordingError) -> None:
        """Take note that there is nothing to go on with, for good or bad."""
        with self._lock:
            self.over = str(error)
            if not isinstance(error, RecordingOver):
                self.error = error

    def _begin(self) -> None:
        """Leave 'stopped': from the next step on the sensor is brought up."""
        with self._lock:
            # what passed while nobody wanted data is not lost
            self._counts['lost'] += self._main.model.missing
            self._main = main_stream(self.device.rate_hz, self.device.paced)
        self._state = 'starting'
        self._due_ns = 0  # now; without a look at the clock, so that all begin alike

    def _bring_up(self) -> None:
        """Identify, configure and start the sensor."""
        if not self._ready:
            self.prepare()
        self._ready = False
        self.device.start()
        with self._lock:
            self._counts['recoveries'] += self._state == 'recovering'
            self._enqueue(self._main.interrupt())
            self._state = 'running'
            self.error = None
        self._failures_in_row = 0
        self._backoff_s = FIRST_BACKOFF_S
        self._continuity = self.device.continuity
        self._heard_ns = self._looked_ns = self._clock.now_ns()
        self._schedule = Schedule(self.device, self._heard_ns)

    def _read(self) -> None:
        runs = self.device.read()
        self._failures_in_row = 0
        with self._lock:
            self.error = None
            if self.device.continuity != self._continuity:
                self._continuity = self.device.continuity
                self._enqueue(self._main.interrupt())
            heard = False
            for place, run in enumerate(runs):
                if place in self.device.skipped:
                    self._main.skip(self.device.skipped[place])
                stream = self._stream(run)
                # another die may go on while the FIFO of the main one is stuck
                heard |= stream is self._main and len(run) > 0
                driver = self.device
                if isinstance(stream, PacedStream):
                    self._enqueue(stream.push(run, self._schedule.due_ns))
                elif isinstance(stream, PolledStream):
                    self._enqueue(stream.push(run), False)
                elif driver.dated:
                    self._enqueue(stream.push(run, driver.edge, driver.latch_ns))
                else:
                    self._enqueue(stream.push_undated(run))
            waiting = self._queued > 0
        if waiting and self.on_data is not None:
            self.on_data()
        self._listen(heard)

    def _stream(self, run: Samples) -> CountedStream | PacedStream | PolledStream:
        if not self.device.rates_hz:
            return self._main
        kind = tuple(run.columns)
        if not any(quantity in self.device.rates_hz for quantity in kind):
            return self._main
        return self._beside.setdefault(kind, PolledStream())

    def _listen(self, heard: bool) -> None:
        """Notice a chip that answers and yet delivers nothing: it was reset behind our back."""
        now = self._clock.now_ns()
        # while nobody looked, as when somebody else held the bus, the chip was not silent
        away = now - self._looked_ns - round(2 * self._schedule.poll_ns)
        self._heard_ns = now if heard else self._heard_ns + max(away, 0)
        self._looked_ns = now
        patience_s = self._schedule.patience_s
        if now - self._heard_ns > patience_s * 1e9:
            self._failures_in_row = RETRIES
            raise NotReady(
                f'{self.name}: no samples for {patience_s:g} s although the chip answers; '
                'configuring it again'
            )

    def _enqueue(self, runs: list[Samples], of_main: bool = True) -> None:
        for run in runs:
            if self._queued + len(run) > self._capacity:
                self._counts['dropped'] += len(run)
                continue
            if of_main:
                self._counts['samples'] += len(run)
            self._queue.append(run)
            self._queued += len(run)

    def _failed(self, error: BenchError) -> int:
        """Count an error; read again, or bring the sensor up again after a pause."""
        with self._lock:
            self.error = error
            self._last_error = f'{type(error).__name__}: {error}'
            self._errors[type(error).__name__] += 1
            self._counts['failures'] += 1
            self._failures_in_row += 1
            if self._state == 'running':
                if self._failures_in_row < RETRIES:
                    return self._next_due()
                self._state = 'recovering'
        pause_s, self._backoff_s = self._backoff_s, min(2 * self._backoff_s, LONGEST_BACKOFF_S)
        return self._clock.now_ns() + round(pause_s * 1e9)

    def _next_due(self) -> int:
        late = self._schedule.late
        due_ns = self._schedule.next_ns(self._clock.now_ns())
        self._counts['late'] += self._schedule.late - late
        return due_ns
