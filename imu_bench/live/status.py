# SPDX-License-Identifier: Apache-2.0
"""What a sensor says of itself on /diagnostics, wherever it is read."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, TYPE_CHECKING

from imu_bench.account import RATE_TOLERANCE

if TYPE_CHECKING:
    # who says how a number is told needs none of these
    from imu_bench.acquisition import AcquisitionStats
    from imu_bench.config import SensorConfig
    from imu_bench.metrology.estimate import Estimate


class Status(NamedTuple):
    """What diagnostic_msgs/DiagnosticStatus holds."""

    name: str
    level: str
    message: str  # one line for people
    hardware_id: str
    values: Mapping[str, object]


class Health:
    """
    Judges one sensor again and again: what has grown since the last time is a fault of now.

    Parameters
    ----------
    hardware_id : str
        What stands behind it: `imu_bench.bench.label`.
    """

    def __init__(self, config: SensorConfig, hardware_id: str) -> None:
        self._config, self._hardware_id = config, hardware_id
        self._before = Losses()

    def absent(self, level: str, message: str, values: Mapping[str, object]) -> Status:
        """Return the status of a sensor that is not read."""
        return self._status(level, message, values)

    def status(
        self,
        stats: AcquisitionStats,
        published: Mapping[str, tuple[int, int]],
        values: Mapping[str, object] = MappingProxyType({}),
    ) -> Status:
        """
        Return the status of a sensor that should be running.

        Parameters
        ----------
        published : mapping of str to (int, int)
            By topic how many messages went out, and the stamp of the last.
        values : mapping of str to object
            What else is to be said.
        """
        level, message = judge(stats, self._before)
        self._before = Losses.of(stats)
        counts: dict[str, int] = {}
        for topic, (count, until_ns) in published.items():
            counts |= {f'published.{topic}': count, f'published_until_ns.{topic}': until_ns}
        return self._status(level, message, {**values, **acquisition_values(stats), **counts})

    def _status(self, level: str, message: str, values: Mapping[str, object]) -> Status:
        own = {
            'backend': self._config.backend,
            'driver': self._config.driver,
            'calibration': ', '.join(self._config.calibration) or 'none',
        }
        name = f'{self._config.name}: acquisition'
        return Status(name, level, message, self._hardware_id, {**own, **values})


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
    >>> from imu_bench.metrology.estimate import Estimate
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
    """Return level and one line about an acquisition that should be running."""
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
        **number('stamp_uncertainty_s', stats.stamp_uncertainty),
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
