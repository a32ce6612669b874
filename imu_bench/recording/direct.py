# SPDX-License-Identifier: Apache-2.0
"""A recording without a middleware, from the first sensor to the closed bag."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
import shutil
import time

from imu_bench.config import BenchConfig
from imu_bench.errors import BenchError, RecordingError
from imu_bench.live.direct import DirectRecording, LEVELS, RECORDER
from imu_bench.live.status import Status
from imu_bench.live.views import RecorderView, SensorView
from imu_bench.nodes.processes import BenchProcesses
from imu_bench.recording.interruption import Interruption
from imu_bench.recording.judgement import Judgement
from imu_bench.recording.rows import SensorRow
from imu_bench.recording.showing import show, Showing

UP_WITHIN_S = 60.0


class Heard:
    """What sensors and recorder say, where there is no `BenchMonitor` to listen to ROS."""

    def __init__(self, names: list[str], bag: Path) -> None:
        self.sensors = {name: SensorView(name) for name in names}
        self.recorder = RecorderView(str(bag))

    def hear(self, statuses: Mapping[str, Status]) -> None:
        """Take note of what each says now."""
        for name, status in statuses.items():
            values = {key: str(value) for key, value in status.values.items()}
            if name == RECORDER:
                self.recorder.hear(status.level == 'error', status.message, values)
            else:
                self.sensors[name].hear(LEVELS[status.level], status.message, values)


class Session:
    """
    Reads the sensors of a bench, records them here, shows them, and judges what came of it.

    Parameters
    ----------
    bag : Path
        Its folder, which does not exist yet.
    duration_s : float or None
        None is as long as nobody ends it.
    """

    def __init__(
        self, bag: Path, storage: str, duration_s: float | None, bench: BenchConfig
    ) -> None:
        self._bag, self._storage, self._duration_s = bag, storage, duration_s
        self._bench = bench
        self._heard = Heard([sensor.name for sensor in bench.sensors], bag)

    def run(self) -> Judgement:
        """
        Record, and judge what came of it.

        Raises
        ------
        BenchError
            If a sensor is not there; nothing is kept then.
        KeyboardInterrupt
            If a signal comes before everything is up; nothing is kept then.
        """
        with Interruption() as asked:
            recording = DirectRecording(
                self._bag, self._bench.sensors, self._storage, self._heard.hear
            )
            showing = self._showing(recording, asked)
            try:
                recording.start()
                show(showing, UP_WITHIN_S)
                if showing.begun_s is None:
                    raise KeyboardInterrupt
            except (KeyboardInterrupt, BenchError):
                recording.close()
                shutil.rmtree(self._bag, ignore_errors=True)
                raise
            ended_s = time.monotonic()
            with suppress(RecordingError):  # the statuses say it, too
                recording.close()
            heard = self._heard
            return Judgement(
                self._bag, heard.sensors, heard.recorder, showing, ended_s, asked.asked
            )

    def _showing(self, recording: DirectRecording, asked: Interruption) -> Showing:
        rows = [
            SensorRow(
                self._heard.sensors[sensor.name],
                self._heard.recorder,
                sensor.namespace,
                plays=sensor.backend == 'recorded',
            )
            for sensor in self._bench.sensors
        ]
        none = BenchProcesses(self._bag, {})
        return Showing(
            rows,
            none,
            self._heard.recorder,
            self._bag,
            self._duration_s,
            asked,
            broken=lambda: str(recording.error or ''),
        )
