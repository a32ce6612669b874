# SPDX-License-Identifier: Apache-2.0
"""What passes between a process that reads sensors and the one that asked for it."""

from __future__ import annotations

from dataclasses import dataclass
import pickle
import socket

from imu_bench.acquisition import AcquisitionStats
from imu_bench.bus.clock import SystemClock
from imu_bench.config import SensorConfig
from imu_bench.errors import BenchError
from imu_bench.samples import Samples

PACKET_BYTES = 1 << 18


@dataclass(frozen=True)
class Wish:
    """What is to be read."""

    sensor: SensorConfig
    clock: SystemClock
    # when the scenario of an emulated sensor begins, Unix time; 0 for when it is switched on
    begin_s: float = 0.0
    # samples are handed over no more often than this: every time costs some 0.1 ms
    every_s: float = 0.0


@dataclass(frozen=True)
class Opened:
    """The answer to 'open'."""

    stats: AcquisitionStats
    switched_on_ns: int


@dataclass(frozen=True)
class Data:
    """What a sensor gave, and how it goes, if that is new."""

    runs: list[Samples]
    stats: AcquisitionStats | None
    error: BenchError | None


@dataclass(frozen=True)
class Ended:
    """Everything that was read before a stop has been sent."""

    stats: AcquisitionStats


@dataclass(frozen=True)
class Packet:
    """One message of the process about one sensor."""

    content: Data | Ended

    @classmethod
    def received(cls, data: socket.socket) -> Packet | None:
        """Return the next one; None when the sensor is closed or the process has ended."""
        try:
            raw = data.recv(PACKET_BYTES)
        except ConnectionResetError:
            raw = b''
        # only what our own child writes arrives here
        return cls(pickle.loads(raw)) if raw else None

    def raw(self) -> bytes:
        """Return it as bytes."""
        return pickle.dumps(self.content, protocol=5)
