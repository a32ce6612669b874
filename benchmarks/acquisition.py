# SPDX-License-Identifier: Apache-2.0
"""
Does one I²C line of 400 kHz carry MPU-9250 at 1000 Hz and LSM303DLHC at 1344 Hz without loss?

Emulated chips on one emulated line: bytes take their time, one transfer at a time, and chips
keep their own time (0.4 % and 2 % fast).  Beside the drivers runs the polling loop of a program
without FIFO, as in Shabulinzenze 2020 (table 5.2: 740 Hz of 1000 and 1260 Hz of 1344 on a
Raspberry Pi 3B): each sensor in a loop of its own asks for new data, reads the registers and
publishes.  How long publishing keeps such a loop busy the thesis does not say; it is drawn
anew for each sample around the means shown.

Then the cost on the host: what the drivers read in one minute is played back from memory, so
that only driver and acquisition work.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
import heapq
import math
import sys
import time
from typing import Any, NamedTuple

from imu_bench.acquisition import Acquisition
from imu_bench.drivers import load
from imu_bench.emulators import create
from imu_bench.emulators.line import Line, Timing
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np

from benchmarks._frame import Benchmark

SECOND = 1_000_000_000
SENSORS = {'mpu9250': 0.004, 'lsm303dlhc': 0.02}
PUBLISHING_S = (0.3e-3, 0.6e-3)
CHUNK = 4096
COST_US = 12.5
"""Eight sensors at 1 kHz are then a tenth of a core."""

# status register and bit, first data register, bytes: as a loop without FIFO reads them
POLLED = {'mpu9250': (0x3A, 0x01, 0x3B, 14), 'lsm303dlhc': (0x27, 0x08, 0x28, 6)}


class Source:
    """White noise at an exact rate, from a table: the chip's own work shall not cost much."""

    def __init__(self, clock: SimulatedClock, rate_error: float) -> None:
        self.nominal_hz = 1000.0
        self._rate_error = rate_error
        self._table = np.random.default_rng(1).normal(size=(2 * CHUNK, 3))
        self.total = 0
        self.restart(clock.now_ns())

    def restart(self, t_ns: int, nominal_hz: float | None = None) -> None:
        self.nominal_hz = nominal_hz or self.nominal_hz
        self.period_ns = 1e9 / (self.nominal_hz * (1 + self._rate_error))
        self._anchor_ns, self._made = t_ns, 0

    def samples_until(self, t_ns: int) -> Samples:
        due = max(int((t_ns - self._anchor_ns) / self.period_ns), self._made)
        k = np.arange(self._made + 1, due + 1)
        self.total += len(k)
        self._made = due
        stamps = self._anchor_ns + np.rint(k * self.period_ns).astype(np.int64)
        first = due % CHUNK
        noise = (
            self._table[first : first + len(k)]
            if len(k) <= CHUNK
            else np.resize(self._table, (len(k), 3))
        )
        return Samples(stamps, noise, noise, noise * 1e-6, noise[:, 0])


class Tape:
    """Passes a bus through and keeps what it answered, or plays that back."""

    def __init__(self, bus: Any, clock: SimulatedClock) -> None:
        self.name = bus.name
        self._bus = bus
        self._clock = clock
        self.answers: list[tuple[bytes, int]] = []

    def read(self, register: int, length: int) -> bytes:
        data: bytes = self._bus.read(register, length)
        self.answers.append((data, self._clock.now_ns()))
        return data

    def write(self, register: int, data: bytes) -> None:
        self._bus.write(register, data)
        self.answers.append((b'', self._clock.now_ns()))

    def close(self) -> None:
        pass


class Playback:
    """A bus that gives the answers of a tape at the times of the tape, for nothing."""

    def __init__(self, tape: Tape, clock: SimulatedClock) -> None:
        self.name = tape.name
        self._next = iter(tape.answers).__next__
        self._until = clock.sleep_until

    def read(self, register: int, length: int) -> bytes:
        data, now = self._next()
        self._until(now)
        return data

    def write(self, register: int, data: bytes) -> None:
        self._until(self._next()[1])

    def close(self) -> None:
        pass


class Row(NamedTuple):
    """What came of one sensor."""

    name: str
    made: int
    delivered: int
    note: str


def show(bench: Benchmark, title: str, rows: list[Row]) -> None:
    bench.head('sensor', 'made', 'delivered', 'lost', 'share', '', title=title)
    for name, made, delivered, note in rows:
        lost = made - delivered
        bench.row(name, f'{made:,}', f'{delivered:,}', f'{lost:,}', f'{lost / made:.2%}', note)


Loop = tuple[int, Callable[[], int]]
"""When it wants to begin, and what it does; that returns when it wants to come back."""


def together(clock: SimulatedClock, loops: list[Loop], until_ns: int) -> None:
    """Do what is due, whoever's turn it is."""
    due = [(first, i) for i, (first, _) in enumerate(loops)]
    heapq.heapify(due)
    while due[0][0] < until_ns:
        at, i = heapq.heappop(due)
        clock.sleep_until(at)
        heapq.heappush(due, (loops[i][1](), i))


def powered(
    clock: SimulatedClock, names: Iterable[str] = SENSORS
) -> dict[str, tuple[Source, Mapping[str, Any]]]:
    """Return source and buses of each sensor, on one line."""
    line = Line(clock, Timing.i2c(400e3))
    made = {}
    for name in names:
        source = Source(clock, SENSORS.get(name, 0.0))
        made[name] = source, create(name, 'i2c', source, clock, line=line)
    clock.sleep(0.05)
    return made


class Bursts:
    """A driver with its acquisition, and what came out of it."""

    def __init__(self, clock: SimulatedClock, name: str, source: Source, buses: Any) -> None:
        self.name = name
        self._clock = clock
        self._source = source
        driver = load(name)(buses, clock, {})
        self.poll_ns = round(driver.poll_period_s * SECOND)
        self.acquisition = Acquisition(driver, clock, name=name)
        self._first_ns = self._last_ns = 0

    def step(self) -> int:
        due_ns = self.acquisition.step()
        self.drain()
        return due_ns

    def drain(self) -> None:
        for run in self.acquisition.drain():
            if run.acceleration is not None:
                self._first_ns = self._first_ns or int(run.stamps[0])
                self._last_ns = int(run.stamps[-1])

    def row(self) -> Row:
        """Compare what came with what the chip made between the first and the last of it."""
        self.acquisition.finish()
        self.drain()
        stats = self.acquisition.stats
        made = round((self._last_ns - self._first_ns) / self._source.period_ns) + 1
        counted = {name: count for name, count in stats.counters.items() if count}
        others = ''.join(f', {count} {name}' for name, count in counted.items())
        return Row(self.name, made, stats.samples, f'counted: {stats.lost} lost{others}')


def with_drivers(seconds: float) -> list[Row]:
    """Return what driver and acquisition deliver."""
    clock = SimulatedClock()
    sensors = [
        Bursts(clock, name, source, buses) for name, (source, buses) in powered(clock).items()
    ]
    for sensor in sensors:
        sensor.acquisition.prepare()
    loops = []
    for sensor in sensors:
        sensor.acquisition.advance(clock.now_ns())
        loops.append((clock.now_ns() + sensor.poll_ns, sensor.step))
    together(clock, loops, clock.now_ns() + round(seconds * SECOND))
    return [sensor.row() for sensor in sensors]


def polling(
    clock: SimulatedClock, name: str, bus: Any, publishing_s: float, counts: Counter[str]
) -> Callable[[], int]:
    """Return one pass of a loop without FIFO."""
    status, ready, first, length = POLLED[name]
    rng = np.random.default_rng(len(name))
    busy_ns = rng.gamma(4.0, publishing_s * SECOND / 4, CHUNK).astype(int)

    def step() -> int:
        if not bus.read(status, 1)[0] & ready:
            return clock.now_ns()
        bus.read(first, length)
        counts[name] += 1
        return clock.now_ns() + int(busy_ns[counts[name] % CHUNK])

    return step


def with_polling(seconds: float, publishing_s: float) -> list[Row]:
    """Return what loops without FIFO get."""
    clock = SimulatedClock()
    sensors = powered(clock)
    for name, (_, buses) in sensors.items():
        load(name)(buses, clock, {'magnetometer_rate_hz': 0.0}).configure()
    sensors['mpu9250'][1][''].write(0x38, b'\x01')
    sensors['lsm303dlhc'][1][''].write(0x24, b'\x00')
    before = {name: source.total for name, (source, _) in sensors.items()}
    counts: Counter[str] = Counter()
    loops = [
        (clock.now_ns(), polling(clock, name, buses[''], publishing_s, counts))
        for name, (_, buses) in sensors.items()
    ]
    together(clock, loops, clock.now_ns() + round(seconds * SECOND))
    return [
        Row(name, source.total - before[name], counts[name], f'{counts[name] / seconds:.0f} Hz')
        for name, (source, _) in sensors.items()
    ]


def host_cost(name: str, seconds: float) -> tuple[float, float]:
    """Return µs per sample of driver plus acquisition, and samples per reading."""
    clock = SimulatedClock()
    _, buses = powered(clock, [name])[name]
    tapes = {part: Tape(bus, clock) for part, bus in buses.items()}
    start_ns = clock.now_ns()
    run(Acquisition(load(name)(tapes, clock, {}), clock), start_ns, seconds)
    best, samples = math.inf, 0
    for _ in range(3):
        clock = SimulatedClock(start_ns)
        bus = {part: Playback(tape, clock) for part, tape in tapes.items()}
        acquisition = Acquisition(load(name)(bus, clock, {}), clock)
        before = time.process_time()
        run(acquisition, start_ns, seconds)
        best = min(best, time.process_time() - before)
        samples = acquisition.stats.samples
        period_s = load(name)(bus, clock, {}).poll_period_s
    return best / samples * 1e6, samples / seconds * period_s


def run(acquisition: Acquisition, start_ns: int, seconds: float) -> None:
    for k in range(1, round(seconds * 2) + 1):
        acquisition.advance(start_ns + k * SECOND // 2)
        acquisition.drain()


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--minutes', 10.0, quick=0.02, help='bench time')
    bench.add_size('--tape', 60.0, quick=2.0, help='seconds that are played back')
    options = bench.start()
    rows = with_drivers(60.0 * options.minutes)
    show(bench, 'FIFO bursts, driver and acquisition', rows)
    for row in rows:
        bench.claim(f'{row.name}: lost', row.made - row.delivered, at_most=0, unit='samples')
    for publishing_s in PUBLISHING_S:
        title = f'polling loop, busy for {publishing_s * 1e3:g} ms per sample'
        show(bench, title, with_polling(60.0 * options.minutes, publishing_s))
    title = 'host cost of driver plus acquisition, without the bus'
    bench.head('sensor', 'µs per sample', 'samples per reading', title=title)
    for name in (*SENSORS, 'lsm9ds1'):
        cost, burst = host_cost(name, options.tape)
        bench.row(name, f'{cost:.2f}', f'{burst:.1f}')
        bench.claim(f'{name}: driver and acquisition', cost, at_most=COST_US, unit='µs per sample')
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
