# SPDX-License-Identifier: Apache-2.0
"""
Does every parameter that goes into a simulated sensor come out inside its 95 % interval?

Every sensor of the benches is simulated at rest with many seeds, at its full rate, and
analysed; counted is how often each parameter lies inside the interval that the analysis gave
it.  A line fails when chance explains that few with a probability below 0.1 %.
Run as ``python -m benchmarks.closed_loop [seeds [samples]]``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
import sys
from typing import Any

from imu_bench import bench
from imu_bench.config import SensorConfig
from imu_bench.config.location import named_file
from imu_bench.simulation.clock import START_NS
from imu_bench.simulation.closed_loop import Check, check, coverage
from imu_bench.simulation.scenario import load_scenario

SEEDS = 100
SHORTEST_S = 3600.0
SAMPLES = 3e6
"""Of each recording: a slow sensor has to be recorded longer before B stands out from N and K."""

BENCHES = ('machine_vibration', 'mast_inclination', 'vehicle_vibration')

CHANGED: Mapping[str, Mapping[str, Any]] = {
    # at 16 g an LSB of 12 mg hides the noise
    'lsm303dlhc': {'accelerometer_range': 2.0},
    # a sensor that warms up is not at rest
    'iim42652': {'simulation.self_heating': '0 K'},
}
"""Settings under which a sensor shows what went into it."""


def sensors() -> Iterator[SensorConfig]:
    """Yield every sensor of the benches, once."""
    for name in BENCHES:
        config = bench.load_bench(named_file('benches', name))
        for sensor in config.sensors:
            overrides = {**config.overrides[sensor.name], **CHANGED.get(sensor.name, {})}
            yield bench.load_sensor(
                config.files[sensor.name], name=sensor.name, overrides=overrides
            )


def loop(config: SensorConfig, run: int, samples: float) -> list[Check]:
    """Return what one recording of one sensor gives back."""
    scenario = load_scenario('still')
    source = bench.simulate(config, scenario, run=run).sources[0]
    duration_s = max(SHORTEST_S, samples / source.rate_hz)
    recorded = source.samples_until(START_NS + round(duration_s * 1e9))
    return list(check(source, recorded))


def main(seeds: int = SEEDS, samples: float = SAMPLES) -> int:
    """Print the table; return 1 if a line does not hold."""
    print(
        f'{seeds} recordings of each sensor at rest, an hour or {samples:g} samples, '
        'its three axes\n'
    )
    print('| sensor | parameter | inside 95 % | of | |')
    print('|---|---|---|---|---|')
    good = True
    with ProcessPoolExecutor() as pool:
        for config in sensors():
            jobs = [pool.submit(loop, config, run, samples) for run in range(seeds)]
            found = coverage(one for job in jobs for one in job.result())
            for parameter, counted in found.items():
                good &= counted.acceptable
                print(
                    f'| {config.name} | {parameter} | {100 * counted.share:.1f} % '
                    f'| {counted.total} | {"ok" if counted.acceptable else "MISSED"} |',
                    flush=True,
                )
    return 0 if good else 1


if __name__ == '__main__':
    numbers = [float(argument) for argument in sys.argv[1:]]
    sys.exit(main(int(numbers[0]) if numbers else SEEDS, *numbers[1:]))
