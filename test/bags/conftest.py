# SPDX-License-Identifier: Apache-2.0
"""Messages and bags that the tests of the container formats share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from imu_bench.bags.topic_info import describe, OfferedQos
from imu_bench.bags.writer import BagWriter
import numpy as np
import pytest

IMU = 'sensor_msgs/msg/Imu'
START = 1_700_000_000_000_000_000


@pytest.fixture
def messages() -> Callable[[int], list[tuple[str, int, bytes]]]:
    """Return a maker of messages on two topics: opaque bytes of several lengths."""

    def make(count: int) -> list[tuple[str, int, bytes]]:
        rng = np.random.default_rng(7)
        sizes = rng.integers(1, 400, count)
        return [
            (f'/imu{index % 2}', START + 1000 * index, rng.bytes(int(size)))
            for index, size in enumerate(sizes)
        ]

    return make


@pytest.fixture
def write_bag(tmp_path) -> Callable[..., Path]:
    """Return a writer of finished bags; every 50 messages make a chunk or transaction."""

    def write(messages: list[tuple[str, int, bytes]], storage: str = 'mcap', **options) -> Path:
        path = tmp_path / f'bag_of_{storage}'
        with BagWriter(path, storage, **options) as bag:
            for topic in ('/imu0', '/imu1'):
                bag.add_topic(describe(topic, IMU, [OfferedQos()]))
            for index, message in enumerate(messages):
                bag.write(*message)
                if index % 50 == 49:
                    bag.flush()
        return path

    return write
