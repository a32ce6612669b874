# SPDX-License-Identifier: Apache-2.0
"""A simulated bench into a bag, as its nodes would publish, or into columns; at full speed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
import errno
from functools import partial
import json
import os
from pathlib import Path
from typing import Any, TypeVar

from imu_bench.bags.block import Messages
from imu_bench.bags.columns import ColumnWriter
from imu_bench.bags.topic_info import describe, OfferedQos, TopicInfo
from imu_bench.bags.writer import BagWriter
from imu_bench.errors import RecordingError
from imu_bench.metrology.trials.inclination import inclination
from imu_bench.samples import Samples
from imu_bench.simulation.clock import START_NS
from imu_bench.simulation.scenario import Scenario
from imu_bench.simulation.simulated import SimulatedSensor
from imu_bench.version import __version__
from msg_conversions.encoding import independent, SensorEncoder
from msg_conversions.quantities import AXES, INCLINATION, QUANTITIES, TEMPERATURE, TYPES
from msg_conversions.transforms import LATCHED, static_transform, TF_STATIC, TF_TYPE
import numpy as np
import numpy.typing as npt

TEMPERATURE_HZ = 10.0
"""A node publishes the newest temperature of each block it reads; here that often at most."""

TRANSPORT_NS = 1_000_000
"""From the measurement to the recorder: about what the live bench has, always the same."""


class SensorMessages:
    """Turns samples of one sensor into messages."""

    def __init__(self, sensor: SimulatedSensor) -> None:
        config = sensor.config
        self._namespace = config.namespace
        self._fields = {field for source in sensor.sources for field in source.quantities}
        # one temperature out of so many samples
        self._every = max(1, round(sensor.rate_hz / TEMPERATURE_HZ))
        self._before_temperature = 0
        self._angle_step = sensor.angle_step
        if self._angle_step:
            self._fields.add(INCLINATION.field)
        self._encoder = SensorEncoder(config.frame_id, independent(config.stddevs))

    @property
    def topics(self) -> list[TopicInfo]:
        """What the bag is to know of the topics."""
        names = dict.fromkeys(q.topic for q in QUANTITIES if q.field in self._fields)
        return [
            describe(f'{self._namespace}/{name}', TYPES[name], [OfferedQos()]) for name in names
        ]

    def encode(self, run: Samples) -> Iterator[Messages]:
        """Yield the messages of one run."""
        columns = run.columns
        celsius = columns.pop(TEMPERATURE.field, None)
        if run.acceleration is not None and self._angle_step:
            angles = [inclination(run.acceleration, axis) for axis in AXES]
            steps = np.rint(np.column_stack(angles) / self._angle_step)
            columns[INCLINATION.field] = steps * self._angle_step
        for name, stamps, rows in self._encoder.encode(run.stamps, columns):
            yield self._messages(name, stamps, rows)
        if celsius is not None:
            chosen = slice(self._before_temperature, None, self._every)
            stamps = run.stamps[chosen]
            self._before_temperature += stamps.size * self._every - len(run)
            if stamps.size:
                rows = self._encoder.rows(stamps, {TEMPERATURE.field: celsius[chosen]})
                yield self._messages(TEMPERATURE.topic, stamps, rows)

    def _messages(
        self, name: str, stamps: npt.NDArray[np.int64], rows: npt.NDArray[np.uint8]
    ) -> Messages:
        return Messages(f'{self._namespace}/{name}', stamps + TRANSPORT_NS, rows)


Progress = Callable[[int, int], None]
"""Called with simulated seconds done and their number."""

SLICE_S = 8.0
"""Simulated time that is computed at once; two slices of all sensors are in memory."""

WRITE_S = 0.1
FEWEST = 400
"""Messages of different topics are interleaved at this grain, or at that of so many messages."""

TRUTH = 'truth.json'
SCHEMA = 'imu_bench.truth/1'

_FULL = (errno.ENOSPC, errno.EDQUOT)

COLUMNS = 'npy'
"""Columns alone, in place of a bag."""

Made = TypeVar('Made')


def slices(
    sensors: Sequence[SimulatedSensor],
    duration_s: float,
    make: Callable[[int, list[Samples]], Made],
) -> Iterator[tuple[float, list[Made]]]:
    """Yield what is made of each slice of time, all sensors side by side, one slice ahead."""

    def job(index: int, until_ns: int) -> Made:
        runs = [source.samples_until(until_ns) for source in sensors[index].sources]
        return make(index, runs)

    ends = [*np.arange(SLICE_S, duration_s, SLICE_S).tolist(), duration_s]
    # the busiest first, so that nobody waits for it in the end
    order = sorted(range(len(sensors)), key=lambda k: -sensors[k].rate_hz)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:

        def begin(end: float) -> dict[int, Future[Made]]:
            until = START_NS + round(end * 1e9)
            return {index: pool.submit(job, index, until) for index in order}

        waiting = begin(ends[0])
        for end, following in zip(ends, [*ends[1:], None], strict=True):
            made = [waiting[index].result() for index in range(len(sensors))]
            waiting = {} if following is None else begin(following)
            yield end, made


def writer(storage: str) -> Callable[..., dict[str, int]]:
    """Return what writes a recording: `write_columns` for `COLUMNS`, else `write_bag`."""
    return write_columns if storage == COLUMNS else partial(write_bag, storage=storage)


def write_bag(
    path: Path,
    sensors: Sequence[SimulatedSensor],
    scenario: Scenario,
    duration_s: float,
    *,
    storage: str = 'mcap',
    run: int = 0,
    progress: Progress | None = None,
) -> dict[str, int]:
    """
    Write the bag that a recorder on the bench would have written, with the truth beside it.

    Parameters
    ----------
    path : Path
        Folder of the bag; must not exist.
    sensors : sequence of SimulatedSensor
        Whose samples are written.
    storage : {'mcap', 'sqlite3'}
        Format of the storage files.
    run : int
        For the truth.
    progress : callable, optional
        Called with the seconds that are written, and with all.

    Returns
    -------
    dict of str to int
        Messages by topic.

    Raises
    ------
    RecordingError
        If the folder exists, or the disk is full; what was written so far can be read.
    """
    encoders = [SensorMessages(sensor) for sensor in sensors]

    def encode(index: int, runs: list[Samples]) -> list[Messages]:
        return [messages for part in runs for messages in encoders[index].encode(part)]

    custom = {'simulated_by': f'imu_bench {__version__}', 'scenario': scenario.name}
    with BagWriter(path, storage, custom={**custom, 'seed': str(run)}) as bag:
        write_truth(path, sensors, scenario, duration_s, run)
        for encoder in encoders:
            for topic in encoder.topics:
                bag.add_topic(topic)
        _place(bag, sensors)
        for end, made in slices(sensors, duration_s, encode):
            _interleave(bag, [messages for part in made for messages in part])
            bag.flush()
            if progress is not None:
                progress(int(end), int(duration_s))
    return bag.counts


def _place(bag: BagWriter, sensors: Sequence[SimulatedSensor]) -> None:
    """Write where the sensors are that have a place."""
    configs = [sensor.config for sensor in sensors]
    placed = {one.frame_id: one.mounting for one in configs if one.mounting is not None}
    if placed:
        bag.add_topic(describe(TF_STATIC, TF_TYPE, [OfferedQos(durability=LATCHED)]))
    for frame_id, mounting in placed.items():
        bag.write(TF_STATIC, START_NS, static_transform(START_NS, frame_id, mounting))


def _interleave(bag: BagWriter, slice_: list[Messages]) -> None:
    """Write the messages of a slice in small steps of time, topic after topic."""
    if not slice_:
        return
    first = min(int(messages.receive_ns[0]) for messages in slice_)
    last = max(int(messages.receive_ns[-1]) for messages in slice_)
    count = sum(len(messages.rows) for messages in slice_)
    grain = max(round(WRITE_S * 1e9), (last - first) * FEWEST // count)
    edges = np.arange(first, last + 1, grain)
    cuts = [
        [*np.searchsorted(messages.receive_ns, edges).tolist(), len(messages.rows)]
        for messages in slice_
    ]
    for step in range(edges.size):
        for messages, cut in zip(slice_, cuts, strict=True):
            part = slice(cut[step], cut[step + 1])
            if part.start < part.stop:
                bag.write_many(messages.topic, messages.receive_ns[part], messages.rows[part])


def write_columns(
    path: Path,
    sensors: Sequence[SimulatedSensor],
    scenario: Scenario,
    duration_s: float,
    *,
    run: int = 0,
    progress: Progress | None = None,
) -> dict[str, int]:
    """
    Write the columns of every sensor as .npy files, one folder per sensor.

    Parameters, errors and result as `write_bag`, with samples in place of messages.
    """
    try:
        path.mkdir(parents=True)
    except FileExistsError as problem:
        raise RecordingError(f'{path}: exists already; choose another name') from problem
    except OSError as problem:
        raise RecordingError(f'{path}: cannot be written: {problem.strerror}') from problem
    write_truth(path, sensors, scenario, duration_s, run)
    writers = [
        ColumnWriter(path / sensor.name, [source.quantities[0] for source in sensor.sources[1:]])
        for sensor in sensors
    ]
    try:
        for end, _ in slices(sensors, duration_s, lambda index, runs: writers[index].write(runs)):
            if progress is not None:
                progress(int(end), int(duration_s))
        for writer in writers:
            writer.close()
    except OSError as problem:
        reason = 'the disk is full' if problem.errno in _FULL else problem.strerror
        raise RecordingError(f'{path}: {reason}; the columns are not complete') from problem
    finally:
        for writer in writers:
            writer.abandon()  # what is not closed yet: on an error, or when stopped
    return {sensor.name: writer.count for sensor, writer in zip(sensors, writers, strict=True)}


def write_truth(
    path: Path,
    sensors: Sequence[SimulatedSensor],
    scenario: Scenario,
    duration_s: float,
    run: int = 0,
    start_ns: int = START_NS,
) -> None:
    """
    Write what is true about a simulated recording into truth.json in its folder.

    Raises
    ------
    RecordingError
        If the disk is full.
    """
    document: Mapping[str, Any] = {
        'schema': SCHEMA,
        'package': {'name': 'imu_bench', 'version': __version__},
        'run': run,
        'start_ns': start_ns,
        'duration': {'value': duration_s, 'unit': 's'},
        'scenario': scenario.truth,
        'sensors': {sensor.name: sensor.truth() for sensor in sensors},
    }
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1)
    try:
        (path / TRUTH).write_text(text + '\n', encoding='utf-8')
    except OSError as problem:
        raise RecordingError(f'{path / TRUTH}: cannot be written: {problem.strerror}') from problem
