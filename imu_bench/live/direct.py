# SPDX-License-Identifier: Apache-2.0
"""
Recording without a middleware: what sensors give goes straight into the bag.

The messages, topics, types and diagnostics are those that the nodes would publish, so the bag is
read, analysed and played as any other.  There is no transport that could lose anything: the
reference for a recording over ROS, and the way where ROS is not installed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
import os
from pathlib import Path
import threading
from typing import Any

from imu_bench import bench, wires
from imu_bench.account import FIRST, MISSED, STORED
from imu_bench.acquisition import AcquisitionStats
from imu_bench.bags.background import BackgroundWriter
from imu_bench.bags.topic_info import describe, OfferedQos
from imu_bench.bags.writer import BagWriter
from imu_bench.bus.clock import SystemClock
from imu_bench.config import SensorConfig
from imu_bench.errors import needed, RecordingError
from imu_bench.live.packets import Wish
from imu_bench.live.reading import ReadingProcess
from imu_bench.live.status import Health, Status
from imu_bench.samples import Samples
from msg_conversions.encoding import independent, SensorEncoder
from msg_conversions.quantities import IMU, TYPES
from msg_conversions.transforms import LATCHED, static_transform, TF_STATIC, TF_TYPE
import numpy as np

DIAGNOSTICS, DIAGNOSTICS_TYPE = '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'
PERIOD_S = 1.0
"""Diagnostics come once a second, as those of the nodes."""

EVERY_S = 0.1
"""Nobody listens, so samples may come some dozens at a time."""

RECORDER = 'recorder: recording'
"""Name of the recorder's status, as its node has it."""

LEVELS = {'ok': 0, 'warn': 1, 'error': 2, 'stale': 3}
"""diagnostic_msgs/msg/DiagnosticStatus."""


class _Sensor:
    """One sensor and its messages on the way to the bag."""

    def __init__(
        self, config: SensorConfig, clock: SystemClock, put: Callable[..., None],
        add: Callable[[str, str], None], process: ReadingProcess,
    ) -> None:  # fmt: skip
        self.config = config
        self.published: dict[str, tuple[int, int]] = {}
        self.health = Health(config, bench.hardware_id(config))
        self._encoder = SensorEncoder(config.frame_id, independent(config.stddevs))
        self._clock, self._put, self._add = clock, put, add
        self.reading = process.read(Wish(config, clock, every_s=EVERY_S), self._take)

    def prepare(self) -> None:
        """Check who answers; the topic exists from now on."""
        self.reading.prepare()
        self._declare(IMU)

    @property
    def status(self) -> Status:
        """How it does."""
        return self.health.status(self.reading.stats, self.published)

    def _take(self, runs: list[Samples], stats: AcquisitionStats) -> None:
        for run in runs:
            for topic, stamps, rows in self._encoder.encode(run.stamps, run.columns):
                if topic not in self.published:
                    self._declare(topic)
                now_ns = np.full(len(rows), self._clock.now_ns())
                self._put(f'{self.config.namespace}/{topic}', now_ns, rows)
                count, _ = self.published[topic]
                self.published[topic] = count + len(rows), int(stamps[-1])

    def _declare(self, topic: str) -> None:
        if topic not in self.published:
            self.published[topic] = 0, 0
            self._add(f'{self.config.namespace}/{topic}', TYPES[topic])


class DirectRecording:
    """
    Sensors read and recorded by this program and the processes that read them.

    Parameters
    ----------
    bag : Path
        Folder of the bag; must not exist.
    sensors : sequence of SensorConfig
        Whose samples are recorded.
    storage : {'mcap', 'sqlite3'}
        Format of the storage files.
    said : callable, optional
        Called once a second, from a thread, with the statuses.

    Raises
    ------
    BenchError
        If a sensor is not there, or the bag cannot be written.
    """

    def __init__(
        self,
        bag: Path,
        sensors: Sequence[SensorConfig],
        storage: str = 'mcap',
        said: Callable[[Mapping[str, Status]], None] | None = None,
    ) -> None:
        # the latest of every sensor, by its name, and that of the recorder, as `RECORDER`
        self.statuses: dict[str, Status] = {}
        self._said = said
        self._bag = bag
        self._clock = SystemClock()
        self._processes: list[ReadingProcess] = []
        self._sensors: list[_Sensor] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._tell, name='diagnostics', daemon=True)
        self._writer = BackgroundWriter(BagWriter(bag, storage))
        self._add(DIAGNOSTICS, DIAGNOSTICS_TYPE)
        try:
            cores = min(len(sensors), len(os.sched_getaffinity(0)))
            self._processes = [ReadingProcess()]
            self._processes = self._processes[0].several(cores, sensors)
            for config, number in zip(sensors, wires.spread(sensors, cores), strict=True):
                process = self._processes[number]
                sensor = _Sensor(config, self._clock, self._put, self._add, process)
                self._sensors.append(sensor)
                sensor.prepare()
            self._place(sensors)
        except BaseException:
            self._release()
            self._writer.close()
            raise

    @property
    def error(self) -> RecordingError | None:
        """Why nothing can be written any more."""
        return self._writer.error

    def start(self) -> None:
        """Start all sensors."""
        for sensor in self._sensors:
            sensor.reading.start()
        self._thread.start()

    def close(self) -> None:
        """
        Stop all sensors and finish the bag; the last statuses say what came of it.

        Raises
        ------
        RecordingError
            If the disk is full or failed.
        """
        try:
            for sensor in self._sensors:
                sensor.reading.stop()
            self._stop.set()
            if self._thread.ident is not None:
                self._thread.join()
            self._say()
        finally:
            self._release()
            try:
                self._writer.close()
            finally:
                self._tell_all(self._statuses())

    def _release(self) -> None:
        for sensor in self._sensors:
            sensor.reading.close()
        for process in self._processes:
            process.close()

    def _add(self, topic: str, kind: str) -> None:
        self._writer.add_topic(describe(topic, kind, [OfferedQos()]))

    def _place(self, sensors: Iterable[SensorConfig]) -> None:
        """Write where the sensors are that have a place."""
        placed = {one.frame_id: one.mounting for one in sensors if one.mounting is not None}
        if placed:
            self._writer.add_topic(describe(TF_STATIC, TF_TYPE, [OfferedQos(durability=LATCHED)]))
        now_ns = self._clock.now_ns()
        for frame_id, mounting in placed.items():
            told = static_transform(now_ns, frame_id, mounting)
            self._put(TF_STATIC, np.array([now_ns]), np.frombuffer(told, np.uint8)[None])

    def _put(self, topic: str, times_ns: Any, rows: Any) -> None:
        self._writer.put(topic, times_ns, rows)

    # --- diagnostics -------------------------------------------------------------------

    def _tell(self) -> None:
        while not self._stop.wait(PERIOD_S):
            self._say()

    def _say(self) -> None:
        now_ns, found = self._clock.now_ns(), self._statuses()
        row = np.frombuffer(serialised(now_ns, list(found.values())), np.uint8)
        self._put(DIAGNOSTICS, np.array([now_ns]), row[None])
        self._tell_all(found)

    def _statuses(self) -> dict[str, Status]:
        found = {sensor.config.name: sensor.status for sensor in self._sensors}
        found[RECORDER] = self._status()
        return found

    def _tell_all(self, statuses: dict[str, Status]) -> None:
        self.statuses = statuses
        if self._said is not None:
            self._said(statuses)

    def _status(self) -> Status:
        writer, counts = self._writer, self._writer.counts
        level, message = 'ok', f'recording {len(counts)} topics'
        if writer.dropped:
            level, message = 'error', f'{writer.dropped} messages dropped: the disk is too slow'
        if writer.error is not None:
            level, message = 'error', str(writer.error)
        values: dict[str, object] = {
            'bag': self._bag,
            'stored': sum(counts.values()),
            'waiting': writer.waiting,
            'spilled': writer.spilled,
            'dropped': writer.dropped,
        }
        for topic, count in counts.items():
            values |= {STORED + topic: count}
            if topic != DIAGNOSTICS:
                # nothing lies between who publishes and who stores
                values |= {MISSED + topic: 0, FIRST + topic: 0}
        return Status(RECORDER, level, message, str(self._bag), values)


def serialised(stamp_ns: int, statuses: Sequence[Status]) -> bytes:
    """Return diagnostic_msgs/DiagnosticArray as CDR, without ROS."""
    store, types = _types()
    time = types['builtin_interfaces/msg/Time']
    header = types['std_msgs/msg/Header'](
        stamp=time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9), frame_id=''
    )
    made = [
        types['diagnostic_msgs/msg/DiagnosticStatus'](
            level=LEVELS[status.level],
            name=status.name,
            message=status.message,
            hardware_id=status.hardware_id,
            values=[
                types['diagnostic_msgs/msg/KeyValue'](key=key, value=str(value))
                for key, value in status.values.items()
            ],
        )
        for status in statuses
    ]
    array = types[DIAGNOSTICS_TYPE](header=header, status=made)
    data: bytes = bytes(store.serialize_cdr(array, DIAGNOSTICS_TYPE))
    return data


@cache
def _types() -> tuple[Any, Mapping[str, Any]]:
    # imported late: it takes a while, and no sensor waits for it
    with needed('rosbags', 'recording without ROS 2'):
        from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    return store, store.types
