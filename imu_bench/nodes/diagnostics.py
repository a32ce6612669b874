# SPDX-License-Identifier: Apache-2.0
"""Health on /diagnostics, once a second, as diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_bench.acquisition import AcquisitionStats
from imu_bench.metrology.estimate import Estimate
from imu_bench.nodes.topic_names import DIAGNOSTICS
from msg_conversions import building
from rclpy.duration import Duration
from rclpy.node import Node

PERIOD_S = 1.0
SOON_NS = 100_000_000
"""News go out at once, but no more often than this."""

LISTENING = Duration(seconds=1.0)
"""So long a node waits for those who have not heard its last words."""

RATE_TOLERANCE = 0.02
"""A sensor that delivers less than this much below its own rate is too slow."""


class Diagnostics:
    """
    Publishes the statuses of a node, every `PERIOD_S` and when asked.

    Parameters
    ----------
    node : Node
    statuses : callable
        Returns what to publish now.
    """

    def __init__(self, node: Node, statuses: Callable[[], Iterable[DiagnosticStatus]]) -> None:
        self._node = node
        self._statuses = statuses
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS, 10)
        self._said_ns = 0
        soon: Any = node.create_timer(SOON_NS * 1e-9, self.publish)
        soon.cancel()
        self._soon = soon
        node.create_timer(PERIOD_S, self.publish)

    def publish_soon(self) -> None:
        """Publish now, or a little later if that was just done."""
        now_ns: int = self._node.get_clock().now().nanoseconds
        if now_ns - self._said_ns >= SOON_NS:
            self.publish()
        elif self._soon.is_canceled():
            self._soon.reset()

    def publish(self) -> None:
        """Publish now."""
        self._soon.cancel()
        now_ns = self._said_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(building.diagnostic_array(now_ns, self._statuses()))

    def last_words(self) -> None:
        """Publish, and wait a little until everybody who listens has heard it."""
        self.publish()
        self._publisher.wait_for_all_acked(LISTENING)


class Losses(NamedTuple):
    """Counts that only grow; what grew since the last look is a fault of now."""

    lost: int = 0
    failures: int = 0
    bus_errors: int = 0
    recoveries: int = 0
    counters: Mapping[str, int] = MappingProxyType({})
    """Those of the driver; they say more about a loss, and are none by themselves."""

    @classmethod
    def of(cls, stats: AcquisitionStats) -> Losses:
        """Return the counts of an acquisition."""
        counters = {name: n for name, n in stats.counters.items() if name != 'bus_errors'}
        return cls(stats.lost, stats.failures, stats.bus_errors, stats.recoveries, counters)

    def grown_since(self, before: Losses) -> str:
        """Return what has grown, in words; nothing when only counters of the driver have."""
        now, then = self._asdict(), before._asdict()
        counters, counters_then = now.pop('counters'), then.pop('counters')
        grown = [f'{now[name] - then[name]} {name}' for name in now if now[name] != then[name]]
        if grown:
            grown += [
                f'{count - counters_then.get(name, 0)} {name}'
                for name, count in counters.items()
                if count != counters_then.get(name, 0)
            ]
        return ', '.join(grown).replace('_', ' ')


def number(name: str, estimate: Estimate) -> dict[str, str]:
    """
    Return the entries of a measured number: value, ends of its interval; or why there is none.

    Examples
    --------
    >>> number('rate_hz', Estimate(100.0, 99.5, 100.5, 'Hz'))
    {'rate_hz': '100', 'rate_hz.low': '99.5', 'rate_hz.high': '100.5'}
    >>> number('rate_hz', Estimate.not_observable('Hz', 'no data yet'))
    {'rate_hz': 'not observable: no data yet'}
    """
    if not estimate.observable:
        return {name: f'not observable: {estimate.reason}'}
    entries = {name: estimate.value, f'{name}.low': estimate.low, f'{name}.high': estimate.high}
    return {key: f'{value:.9g}' for key, value in entries.items() if value is not None}


def judge(stats: AcquisitionStats, before: Losses) -> tuple[str, str]:
    """
    Return level and one line about an acquisition that should be running.

    Parameters
    ----------
    stats : AcquisitionStats
    before : Losses
        The counts of the status before this one.
    """
    if stats.over:
        return ('error' if stats.over == stats.error else 'ok'), stats.over
    if stats.error:
        return 'error', f'{stats.state}: {stats.error}'
    if stats.state != 'running':
        return 'warn', stats.state
    now = Losses.of(stats)
    grown = now.grown_since(before)
    if grown:
        last = f'; {stats.last_error}' if now.failures > before.failures else ''
        return 'warn', f'since the last report: {grown}{last}'
    trouble = stats.tape_problem or _too_slow(stats)
    if trouble:
        return 'warn', trouble
    return 'ok', 'running'


def _too_slow(stats: AcquisitionStats) -> str:
    delivered, expected = stats.delivered.value, stats.rate.value or stats.nominal_hz
    if delivered is None or stats.delivered.high is None:
        return ''
    if stats.delivered.high < (1.0 - RATE_TOLERANCE) * expected:
        return f'delivers {delivered:.6g} Hz of {expected:.6g} Hz'
    return ''


def acquisition_values(stats: AcquisitionStats) -> dict[str, Any]:
    """Return everything an acquisition counts and measures, by key."""
    return {
        'state': stats.state,
        'part': stats.part,
        'nominal_hz': f'{stats.nominal_hz:g}',
        **number('rate_hz', stats.rate),
        **number('rate_error_ppm', stats.rate_error),
        **number('delivered_hz', stats.delivered),
        **number('jitter_s', stats.jitter),
        'samples': stats.samples,
        'lost': stats.lost,
        'dropped': stats.dropped,
        'bus_errors': stats.bus_errors,
        'failures': stats.failures,
        'recoveries': stats.recoveries,
        'late': stats.late,
        'queued': stats.queued,
        'scheduling': stats.scheduling,
        **({'wire_recording': stats.tape} if stats.tape else {}),
        **{f'error.{name}': count for name, count in stats.errors.items()},
        **{f'counter.{name}': count for name, count in stats.counters.items()},
    }
