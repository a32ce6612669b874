# SPDX-License-Identifier: Apache-2.0
"""
What it costs to read a sensor, as far as its samples wait to be drained: nothing is published.

CPU time of the reading thread per sample, what of it the emulated chip takes (a real one costs
none of it), share of one core, and how often a second the thread wakes up.  Run as
``python -m benchmarks._reading_cost [--bench NAME] [--sensor NAME] [--seconds S] [--simulated]``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
import threading
import time
from typing import Any, NamedTuple

from imu_bench import drivers
from imu_bench.acquisition import Acquisition
from imu_bench.bench import build, emulated_buses, GENERIC, load_bench
from imu_bench.bus.clock import SystemClock
from imu_bench.config import SensorConfig
from imu_bench.config.location import config_file
from imu_bench.emulators.line import Waiting
from imu_bench.simulation.clock import SimulatedClock

SETTLING_S = 3.0
"""What a sensor does first, and the first fits of its clock model, is not counted."""

DRAIN_S = 0.1


class Cost(NamedTuple):
    """What reading has cost over a while; µs of CPU per sample, of which in the emulator."""

    name: str
    rate_hz: float
    per_sample: float
    emulator: float
    core: float
    wakeups_hz: float
    lost: int
    late: int

    def __str__(self) -> str:
        own = self.per_sample - self.emulator
        return (
            f'{self.name:12}{self.rate_hz:9.1f}{own:10.1f}{self.emulator:10.1f}'
            f'{self.per_sample:10.1f}{100 * self.core:9.1f}{self.wakeups_hz:10.0f}'
            f'{self.lost:7}{self.late:6}'
        )


HEAD = (
    f'{"sensor":12}{"samples/s":>9}{"own µs":>10}{"emul. µs":>10}{"sum µs":>10}'
    f'{"% core":>9}{"wake-ups/s":>10}{"lost":>7}{"late":>6}'
)


class Metered:
    """Anything whose methods are timed, in CPU time of the calling thread."""

    def __init__(self, thing: Any) -> None:
        self._thing = thing
        self.ns = 0

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._thing, name)
        if not callable(found):
            return found

        def timed(*given: Any, **named: Any) -> Any:
            before = time.thread_time_ns()
            try:
                return found(*given, **named)
            finally:
                self.ns += time.thread_time_ns() - before

        setattr(self, name, timed)
        return timed

    @property
    def baud(self) -> int:
        return int(self._thing.baud)

    @baud.setter
    def baud(self, baud: int) -> None:
        self._thing.baud = baud


class Bed:
    """A sensor of a bench with its acquisition, and a meter on what is emulated."""

    def __init__(self, sensor: SensorConfig, clock: Any) -> None:
        self.name = sensor.name
        self.meters: list[Metered] = []
        if sensor.driver == GENERIC:
            self.acquisition = build(sensor, clock)
            return
        driver = drivers.load(sensor.driver)
        if isinstance(clock, SystemClock):
            clock = Waiting(clock)
        buses = {part: Metered(bus) for part, bus in emulated_buses(sensor, clock).items()}
        self.meters = list(buses.values())
        clock.sleep(driver.start_up_s)
        device = driver(buses, clock, sensor.settings)
        self.acquisition = Acquisition(device, clock, name=sensor.name)

    def emulated_ns(self) -> int:
        return sum(meter.ns for meter in self.meters)

    def samples(self) -> int:
        """Return how many samples of the main stream there were so far."""
        return self.acquisition.stats.samples


def on_the_clock(beds: Iterable[Bed], seconds: float) -> list[Cost]:
    """Run sensors at the same time, each in its own thread, on the computer's clock."""
    beds = list(beds)
    for bed in beds:
        bed.acquisition.prepare()
        bed.acquisition.start()
    _drain(beds, SETTLING_S)
    before = [_state(bed) for bed in beds]
    _drain(beds, seconds)
    while any(bed.samples() == since[1] for bed, since in zip(beds, before, strict=True)):
        _drain(beds, DRAIN_S)  # of a short run on a busy machine
    costs = [_cost(bed, since, _state(bed)) for bed, since in zip(beds, before, strict=True)]
    for bed in beds:
        bed.acquisition.close()
    return costs


def simulated(bed: Bed, seconds: float, clock: SimulatedClock) -> Cost:
    """Run a sensor on a simulated clock, in this thread."""
    start_ns = clock.now_ns()
    _advance(bed, start_ns, 0.0, SETTLING_S)
    before = (bed.samples(), time.thread_time_ns(), bed.emulated_ns(), 0)
    _advance(bed, start_ns, SETTLING_S, SETTLING_S + seconds)
    after = (bed.samples(), time.thread_time_ns(), bed.emulated_ns(), 0)
    return _cost(bed, (0.0, *before), (seconds, *after))


def _advance(bed: Bed, start_ns: int, since_s: float, until_s: float) -> None:
    for k in range(round(since_s / DRAIN_S) + 1, round(until_s / DRAIN_S) + 1):
        bed.acquisition.advance(start_ns + round(k * DRAIN_S * 1e9))
        bed.acquisition.drain()


def _drain(beds: Iterable[Bed], seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(DRAIN_S)
        for bed in beds:
            bed.acquisition.drain()


def _state(bed: Bed) -> tuple[float, int, int, int, int]:
    """Return seconds, samples, CPU time, time in the emulator, and wake-ups so far."""
    name = f'acquire-{bed.name}'
    thread = next(thread for thread in threading.enumerate() if thread.name == name)
    task = Path(f'/proc/self/task/{thread.native_id}')
    cpu_ns = int((task / 'schedstat').read_text().split()[0])
    switches = next(
        int(line.split()[1])
        for line in (task / 'status').read_text().splitlines()
        if line.startswith('voluntary_ctxt_switches')
    )
    return time.monotonic(), bed.samples(), cpu_ns, bed.emulated_ns(), switches


def _cost(bed: Bed, before: tuple[Any, ...], after: tuple[Any, ...]) -> Cost:
    span, samples, cpu, emulated, wakeups = (b - a for a, b in zip(before, after, strict=True))
    stats = bed.acquisition.stats
    return Cost(
        bed.name, samples / span, cpu / samples * 1e-3, emulated / samples * 1e-3,
        cpu * 1e-9 / span, wakeups / span, stats.lost, stats.late,
    )  # fmt: skip


def main(given: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--bench', default='machine_vibration')
    parser.add_argument('--sensor', action='append', help='only this one; may be repeated')
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--simulated', action='store_true', help='as fast as it goes')
    parser.add_argument('--together', action='store_true', help='all at once, in one process')
    asked = parser.parse_args(given)
    bench = load_bench(config_file(f'benches/{asked.bench}.yaml'))
    sensors = [s for s in bench.sensors if asked.sensor is None or s.name in asked.sensor]
    costs: list[Cost] = []
    print(HEAD)
    groups = [sensors] if asked.together and not asked.simulated else [[s] for s in sensors]
    for group in groups:
        if asked.simulated:
            clock = SimulatedClock()
            made = [simulated(Bed(group[0], clock), asked.seconds, clock)]
        else:
            made = on_the_clock([Bed(sensor, SystemClock()) for sensor in group], asked.seconds)
        for cost in made:
            print(cost, flush=True)
        costs += made
    rate, core = sum(c.rate_hz for c in costs), sum(c.core for c in costs)
    emulated = sum(c.emulator * c.rate_hz for c in costs) * 1e-6
    print(
        f'{"together":12}{rate:9.1f}{1e6 * (core - emulated) / rate:10.1f}'
        f'{1e6 * emulated / rate:10.1f}{1e6 * core / rate:10.1f}{100 * core:9.1f}'
        f'{sum(c.wakeups_hz for c in costs):10.0f}'
    )


if __name__ == '__main__':
    main()
