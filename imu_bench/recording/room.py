# SPDX-License-Identifier: Apache-2.0
"""How much a recording takes on the disk, and whether there is room for it."""

from __future__ import annotations

from pathlib import Path
import shutil
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from imu_bench.errors import RecordingError
from imu_bench.offline.notation import duration

if TYPE_CHECKING:
    from imu_bench.config import BenchConfig

REHEARSED_S = (2.0, 6.0)
"""Simulated lengths whose difference is what a second takes, without what a bag has once."""

MARGIN = 1.25
"""
What a live bag takes beside: diagnostics, and stamps that a clock gave.  Six emulated sensors
took 1.2 times what was simulated (machine_vibration as mcap, with the topics of the analysis).
"""

SHORTEST_S = 60.0
"""A disk that has no room for so much is full."""

RESERVE_S, RESERVE_BYTES, RESERVE_SHARE = 5.0, 1 << 20, 0.01
"""
Kept free, so that a bag can be finished: what comes in so many seconds, metadata, and the
summary of an mcap, which is 0.6 % of the smallest messages and less of others.
"""


def bytes_per_second(bench: BenchConfig, storage: str) -> float:
    """
    Return what a second of a bench takes in a bag, from a few simulated seconds of its sensors.

    Compression makes this depend on the sensors: 42 bytes per message on the average as mcap,
    376 as sqlite3, which rosbag2 does not compress.

    Raises
    ------
    ConfigError
        If settings of a sensor make no sense.
    """
    from imu_bench.bench import simulate
    from imu_bench.simulation.recording import write_bag
    from imu_bench.simulation.scenario import load_scenario

    scenario = load_scenario('still')
    sizes = []
    for length_s in REHEARSED_S:
        sensors = [simulate(sensor, scenario) for sensor in bench.sensors]
        with TemporaryDirectory() as folder:
            bag = Path(folder) / 'bag'
            write_bag(bag, sensors, scenario, length_s, storage=storage)
            sizes.append(stored_bytes(bag, '*_0.*'))
    return MARGIN * (sizes[1] - sizes[0]) / (REHEARSED_S[1] - REHEARSED_S[0])


def stored_bytes(bag: Path, pattern: str = '*') -> int:
    """Return the bytes of the files of a bag."""
    return sum(file.stat().st_size for file in bag.glob(pattern) if file.is_file())


def free_bytes(path: Path) -> int:
    """Return what is free on the disk where a path is, or will be."""
    place = path.absolute()
    while not place.exists():
        place = place.parent
    return shutil.disk_usage(place).free


def reserve(stored: float, per_second: float) -> float:
    """Return how much has to stay free, so that a bag of this size can be finished."""
    return RESERVE_BYTES + RESERVE_SHARE * stored + RESERVE_S * per_second


def check(bag: Path, per_second: float, length_s: float | None) -> str:
    """
    Say what a recording takes and what there is.

    Parameters
    ----------
    bag : Path
        Where it will be.
    per_second : float
        Bytes.
    length_s : float or None
        None is as long as nobody ends it.

    Raises
    ------
    RecordingError
        If it does not fit.
    """
    free = free_bytes(bag)
    usable = (free - RESERVE_BYTES) / ((1.0 + RESERVE_SHARE) * per_second) - RESERVE_S
    if length_s is None and usable >= SHORTEST_S:
        return f'{size(free)} free, room for about {duration(usable)}'
    wanted = SHORTEST_S if length_s is None else length_s
    needed = wanted * per_second + reserve(wanted * per_second, per_second)
    if needed > free:
        shorter = f', or record {usable:.0f} s at most' if usable >= SHORTEST_S else ''
        raise RecordingError(
            f'{bag}: {duration(wanted)} of recording take about {size(needed)}, and {size(free)} '
            f'are free there; make room, or name another disk{shorter}'
        )
    return f'about {size(needed)} of the {size(free)} that are free'


def size(count: float) -> str:
    """
    Return bytes as disks are sold by them.

    Examples
    --------
    >>> size(850), size(6_574_205), size(84.96e9)
    ('850 B', '6.6 MB', '85.0 GB')
    """
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000.0:
            return f'{count:.0f} B' if unit == 'B' else f'{count:.1f} {unit}'
        count /= 1000.0
    return f'{count:.1f} TB'
