# SPDX-License-Identifier: Apache-2.0
"""
What any program in Python pays for publishing and for taking: the least there is, with rclpy.

``python -m benchmarks._floors publish RATE…`` publishes ready-made bytes, a topic per rate, in
bursts; ``take TOPIC…`` takes what comes on topics, as bytes; ``ahead SPEED RATE…`` publishes
blocks as sensors do, on stamps that run faster than time.  A line on its input makes each of
them answer with how many messages there were so far; the end of its input ends it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import select
import sys
import time
from typing import Any

from imu_bench.nodes import qos
from msg_conversions import blocks, covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np
import rclpy
from rclpy.callback_groups import CallbackGroup
from sensor_msgs.msg import Imu
from std_msgs.msg import UInt8MultiArray

BURST_S = 0.02
"""A burst is what a FIFO holds when it is read 50 times a second; so often is taken, too."""

BLOCK_S = 0.05
"""As `imu_bench.nodes.sensor_topics` hands blocks over."""

PER_BLOCK = 90
"""Messages of 340 bytes: 30 kB, as there."""


class _Untouched(CallbackGroup):
    """Of subscriptions that no executor waits for or takes from."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


def template() -> ImuTemplate:
    return ImuTemplate(
        'imu_link',
        acceleration_covariance=covariance.UNKNOWN,
        angular_velocity_covariance=covariance.UNKNOWN,
    )


def topic(number: int) -> str:
    """Return the name of a topic that `publish` publishes."""
    return f'/floor/source_{number}/imu/data_raw'


def publish(node: Any, rates: Sequence[float]) -> Iterator[int]:
    """Publish ready-made bytes in bursts; yield how many there were."""
    zeros = np.zeros((1, 3))
    (blob,) = template().encode_imu(np.zeros(1, np.int64), zeros, zeros)
    data = bytes(blob)
    profile = qos.keep_last(3000, 'reliable')
    publishers = [node.create_publisher(Imu, topic(n), profile) for n in range(len(rates))]
    began, sent = time.monotonic(), [0] * len(rates)
    while True:
        yield sum(sent)
        passed = time.monotonic() - began
        for number, (rate, publisher) in enumerate(zip(rates, publishers, strict=True)):
            due = int(passed * rate)
            for _ in range(due - sent[number]):
                publisher.publish(data)
            sent[number] = due


def take(node: Any, topics: Sequence[str]) -> Iterator[int]:
    """Take what has come, as bytes; yield how many there were."""
    group = _Untouched()
    profile = qos.keep_last(3000, 'reliable')
    handles = [
        node.create_subscription(
            Imu, name, lambda message: None, profile, callback_group=group, raw=True
        ).handle
        for name in topics
    ]
    count = 0
    while True:
        yield count
        for handle in handles:
            with handle:
                while handle.take_message(Imu, True) is not None:
                    count += 1


def ahead(node: Any, rates: Sequence[float], speed: float) -> Iterator[int]:
    """Publish blocks on stamps that run faster than time; yield how many messages."""
    rng = np.random.default_rng(1)
    profile = qos.keep_last(2048, 'reliable')
    spaces = [f'/bench/ahead_{number}' for number in range(len(rates))]
    # the graph has to know of the topics that the blocks stand for
    mains = [node.create_publisher(Imu, f'{space}/imu/data_raw', 10) for space in spaces]
    outs = [node.create_publisher(UInt8MultiArray, f'{s}/{blocks.TOPIC}', profile) for s in spaces]
    form, epoch_ns = template(), time.time_ns()
    sent = [0] * len(mains)
    while not all(out.get_subscription_count() for out in outs):
        yield 0
    began = time.monotonic()
    while True:
        yield sum(sent)
        passed = speed * (time.monotonic() - began)
        for number, (rate, out) in enumerate(zip(rates, outs, strict=True)):
            due = int(passed * rate)
            while sent[number] < due:
                count = min(PER_BLOCK, due - sent[number])
                index = sent[number] + np.arange(count)
                stamps = epoch_ns + np.rint(index * (1e9 / rate)).astype(np.int64)
                values = rng.normal(scale=0.02, size=(2, count, 3))
                blobs = form.encode_imu(stamps, values[0], values[1])
                rows = np.frombuffer(b''.join(bytes(b) for b in blobs), np.uint8)
                part = blocks.Part(
                    'imu/data_raw', sent[number], time.time_ns(), rows.reshape(count, -1)
                )
                out.publish(blocks.encode(number + 1, [part]))
                sent[number] += count


def run(work: Iterator[int], period_s: float) -> None:
    """Go on with something at a pace, and answer."""
    count = 0
    while True:
        if select.select([sys.stdin], [], [], 0.0)[0]:
            if not sys.stdin.readline():
                return
            print(count, flush=True)
        time.sleep(period_s)
        count = next(work)


def main(kind: str, *given: str) -> int:
    rclpy.init(args=[])
    node = rclpy.create_node(f'floor_{kind}')
    kinds: dict[str, tuple[Callable[[], Iterator[int]], float]] = {
        'publish': (lambda: publish(node, [float(rate) for rate in given]), BURST_S),
        'take': (lambda: take(node, given), BURST_S),
        'ahead': (lambda: ahead(node, [float(r) for r in given[1:]], float(given[0])), BLOCK_S),
    }
    work, period_s = kinds[kind]
    run(work(), period_s)
    rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
