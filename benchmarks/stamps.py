# SPDX-License-Identifier: Apache-2.0
"""
How far are stamps off the true time of measurement, with and without a data-ready line?

Every chip that has a pin, emulated, its oscillator 2 % fast, read by a computer that is late by
50 µs in the mean and by 5 ms once in a hundred readings.  The handler of the line's interrupt is
late, too: see imu_bench/emulators/pin.py.  The truth is the emulated chip's.
"""

from __future__ import annotations

from dataclasses import dataclass
import sys

from imu_bench.acquisition import Acquisition
from imu_bench.drivers import load, names
from imu_bench.emulators import create
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np

from benchmarks._frame import Benchmark

RATE_ERROR = 0.02
WITHIN_US = 20.0


class Source:
    """Samples that hold still, at a rate of their own; their stamps are kept as the truth."""

    def __init__(self, clock: SimulatedClock) -> None:
        self.truth: list[np.ndarray] = []
        self.nominal_hz = 1000.0
        self.restart(clock.now_ns())

    def restart(self, t_ns: int, nominal_hz: float | None = None) -> None:
        self.nominal_hz = nominal_hz or self.nominal_hz
        self.period_ns = 1e9 / (self.nominal_hz * (1 + RATE_ERROR))
        self._anchor_ns, self._made = t_ns, 0

    def samples_until(self, t_ns: int) -> Samples:
        due = max(int((t_ns - self._anchor_ns) / self.period_ns), self._made)
        stamps = self._anchor_ns + np.rint(
            np.arange(self._made + 1, due + 1) * self.period_ns
        ).astype(np.int64)
        self._made = due
        self.truth.append(stamps)
        n = len(stamps)
        return Samples(stamps, np.full((n, 3), 1.0), np.zeros((n, 3)), None, np.full(n, 25.0))


class LateClock:
    """A clock on which a computer wakes up late."""

    def __init__(self, clock: SimulatedClock) -> None:
        self.now_ns = clock.now_ns
        self.sleep = clock.sleep
        self._clock = clock
        self._noise = np.random.default_rng(1)

    def sleep_until(self, deadline_ns: int) -> None:
        late = self._noise.exponential(50e3) + 5e6 * (self._noise.random() < 0.01)
        self._clock.sleep_until(deadline_ns + round(late))


@dataclass(frozen=True)
class Errors:
    """Of settled stamps, µs: mean, scatter, RMS; the bound stated, and how many keep it."""

    mean: float
    scatter: float
    rms: float
    bound: float
    held: float


def measured(name: str, kind: str, wired: bool, seconds: float, settling_s: float) -> Errors:
    """Return by how much stamps of a chip are off."""
    clock = SimulatedClock()
    source = Source(clock)
    buses = create(name, kind, source, clock, lines=('data_ready',) if wired else ())
    clock.sleep(load(name).start_up_s)
    acquisition = Acquisition(load(name)(buses, clock, {}), LateClock(clock), name=name)
    start_ns, stamps = clock.now_ns(), []
    for second in range(1, round(seconds + settling_s) + 1):
        acquisition.advance(start_ns + second * 1_000_000_000)
        runs = acquisition.drain()
        if second > settling_s:
            stamps += [run.stamps for run in runs if run.acceleration is not None]
    truth, given = np.concatenate(source.truth), np.concatenate(stamps)
    right = np.searchsorted(truth, given).clip(1, len(truth) - 1)
    off = np.stack([given - truth[right - 1], given - truth[right]])
    errors = 1e-3 * off[np.abs(off).argmin(axis=0), np.arange(len(given))]
    bound = 1e6 * (acquisition.stats.stamp_uncertainty.high or float('nan'))
    return Errors(
        float(errors.mean()),
        float(errors.std()),
        float(np.sqrt(np.mean(errors**2))),
        bound,
        float(np.mean(np.abs(errors) <= bound)),
    )


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--seconds', 60.0, quick=1.0, help='bench time of each')
    bench.add_size('--settling', 5.0, quick=1.0, help='seconds before that are not counted')
    options = bench.start()
    bench.head(
        f'{"chip":18}', f'{"read":8}', 'mean µs', 'scatter µs', 'RMS µs', 'bound µs', 'held'
    )
    for name in names():
        for kind in load(name).bus_kinds if load(name).data_ready_pin else ():
            for wired in (True, False):
                one = measured(name, kind, wired, options.seconds, options.settling)
                how = 'line' if wired else 'polled'
                numbers = (one.mean, one.scatter, one.rms, one.bound)
                cells = (f'{x:.1f}' for x in numbers)
                bench.row(f'{name} {kind}', how, *cells, f'{one.held:.1%}')
                if wired:
                    bench.claim(f'{name} {kind}: RMS', one.rms, at_most=WITHIN_US, unit='µs')
                bench.claim(f'{name} {kind}, {how}: inside the bound', one.held, at_least=0.95)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
