# SPDX-License-Identifier: Apache-2.0
"""
Does every parameter that goes into a simulated sensor come out inside its 95 % interval?

Every sensor of the benches is simulated at rest with many seeds, at its full rate, and analysed
as `imu-bench analyze` does it; counted is how often each parameter lies inside the interval that
the analysis gave it, or below the bound of what it did not claim.  Over all sensors a claim fails
below 93 %; of one sensor when chance explains that few with a probability below 0.1 %.

A slow sensor has to be recorded longer before B stands out from N and K.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
import sys
from typing import Any

from imu_bench import bench
from imu_bench.config import SensorConfig
from imu_bench.config.location import named_file
from imu_bench.simulation.clock import START_NS
from imu_bench.simulation.scenario import load_scenario
from scipy.stats import binom

from benchmarks._closed_loop import check, CONFIDENCE, coverage, Row, SURE
from benchmarks._frame import Benchmark
from benchmarks._parts import Parts

BENCHES = ('machine_vibration', 'mast_inclination', 'vehicle_vibration')

CHANGED: Mapping[str, Mapping[str, Any]] = {
    # at 16 g an LSB of 12 mg hides the noise
    'lsm303dlhc': {'accelerometer_range': 2.0},
    # a sensor that warms up is not at rest
    'iim42652': {'simulation.self_heating': '0 K'},
}
"""Settings under which a sensor shows what went into it."""


@cache
def sensors() -> dict[str, SensorConfig]:
    """Return every sensor of the benches, by the names of both."""
    found = {}
    for name in BENCHES:
        config = bench.load_bench(named_file('benches', name))
        for sensor in config.sensors:
            overrides = {**config.overrides[sensor.name], **CHANGED.get(sensor.name, {})}
            found[f'{name}/{sensor.name}'] = bench.load_sensor(
                config.files[sensor.name], name=sensor.name, overrides=overrides
            )
    return found


def loop(name: str, seed: int, hours: float, samples: int) -> list[Row]:
    """Return what one recording of one sensor gives back."""
    config = sensors()[name]
    source = bench.simulate(config, load_scenario('still'), run=seed).sources[0]
    duration_s = max(3600 * hours, samples / source.rate_hz)
    recorded = source.samples_until(START_NS + round(duration_s * 1e9))
    return [one.row for one in check(source, recorded)]


def main() -> int:
    run = Benchmark(__doc__)
    run.add_size('--seeds', 100, quick=1, help='recordings of each sensor')
    run.add_size('--hours', 1.0, quick=0.02, help='of each recording, at least')
    run.add_size('--samples', 3_000_000, quick=10_000, help='of each recording, at least')
    parts = Parts(run)
    options = run.start()
    keys = [
        (name, seed, options.hours, options.samples)
        for seed in range(options.seeds)
        for name in sensors()
    ]
    found = parts.run(options, loop, keys)
    run.head('parameter     ', 'inside 95 %', 'of     ', 'claimed', title='all sensors')
    for parameter, one in coverage(row for rows in found.values() for row in rows).items():
        run.row(parameter, one.inside, one.total, one.claimed)
        run.claim(f'{parameter}: inside 95 %', 100 * one.share, at_least=93.0, unit='%')
    for name in sensors():
        of_sensor = coverage(row for key in keys if key[0] == name for row in found[key])
        run.head('parameter     ', 'inside 95 %', 'of     ', 'claimed', title=name)
        for parameter, one in of_sensor.items():
            run.row(parameter, one.inside, one.total, one.claimed)
            fewest = binom.ppf(SURE, one.total, CONFIDENCE) / one.total
            run.claim(
                f'{name}, {parameter}: inside 95 %', 100 * one.share, at_least=100 * fewest,
                unit='%',
            )  # fmt: skip
    return run.done()


if __name__ == '__main__':
    sys.exit(main())
