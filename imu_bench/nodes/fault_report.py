# SPDX-License-Identifier: Apache-2.0
"""The scripted faults of an emulated sensor in its log and on /diagnostics."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from imu_bench import bench
from imu_bench.acquisition import AcquisitionStats, Aftermath, FaultWatch
from imu_bench.bus.interface import Clock
from imu_bench.config import SensorConfig
from imu_bench.samples import Samples
from msg_conversions import building

LATE_S = 2.0
"""A sensor that is not back so long after a fault has not recovered from it."""


class FaultReport:
    """What a script does to one sensor; without a script there is nothing to say."""

    def __init__(self, config: SensorConfig, log: Any, clock: Clock, switched_on_ns: int) -> None:
        self._clock, self._switched_on_ns = clock, switched_on_ns
        self._config = config
        self._log = log
        self._newest_ns = 0
        self._watch = FaultWatch(bench.faults_of(config), self._switched_on_ns)
        if self._watch.aftermaths:
            log.warning(f'{config.name}: faults are scripted: {len(self._watch.aftermaths)}')

    def arrived(self, runs: Iterable[Samples]) -> None:
        """Take note of samples that go out."""
        for run in runs:
            # those beside the main stream are not held back after a loss
            if len(run) and (run.acceleration is not None or run.angular_velocity is not None):
                self._newest_ns = int(run.stamps[-1])

    def look(self, stats: AcquisitionStats) -> bool:
        """Log what has begun or is over; return whether there was something."""
        changed = self._watch.look(self._clock.now_ns(), stats, self._newest_ns)
        for aftermath in changed:
            self._log.warning(f'{self._config.name}: {spoken(aftermath)}')
        return bool(changed)

    @property
    def scripted(self) -> bool:
        """Whether there is something to report at all."""
        return bool(self._watch.aftermaths)

    def status(self) -> DiagnosticStatus:
        """Return level, one line and everything known of each fault."""
        aftermaths = self._watch.aftermaths
        going_on = [a for a in aftermaths if a.state in ('active', 'over')]
        lasting_s = (self._clock.now_ns() - self._switched_on_ns) * 1e-9
        late = [a for a in going_on if lasting_s > a.fault.over_s + LATE_S]
        level = 'error' if late else 'warn' if going_on else 'ok'
        begun = [a for a in aftermaths if a.state != 'planned']
        message = spoken((late or going_on or begun)[-1]) if begun else 'none so far'
        values = {
            f'{number}.{key}': value
            for number, aftermath in enumerate(aftermaths)
            for key, value in entries(aftermath).items()
        }
        name = f'{self._config.name}: faults'
        own = bench.hardware_id(self._config)
        return building.diagnostic_status(name, level, message, own, values)


def spoken(aftermath: Aftermath) -> str:
    """Return a fault and what came of it, in one line."""
    name = f'emulated fault {aftermath.fault.kind}'
    if aftermath.state == 'recovered':
        said = f'{name}: recovered after {aftermath.recovery_s:.2f} s'
        said += f', {aftermath.lost} samples lost'
    elif aftermath.state == 'active':
        said = f'{name} for {aftermath.fault.for_s:g} s'
    else:
        said = f'{name} is over'
    return f'{said}; {aftermath.error}' if aftermath.error else said


def entries(aftermath: Aftermath) -> dict[str, str]:
    """Return everything known of a fault, by key."""
    fault, recovery_s = aftermath.fault, aftermath.recovery_s
    return {
        'kind': fault.kind,
        'at_s': f'{fault.at_s:g}',
        'for_s': f'{fault.over_s - fault.at_s:g}',
        'state': aftermath.state,
        'error': aftermath.error,
        'errors': _listed(aftermath.errors.items()),
        'counted': _listed(aftermath.counted.items()),
        'lost': str(aftermath.lost),
        'recovery_s': '' if recovery_s is None else f'{recovery_s:.3f}',
    }


def _listed(counts: Iterable[tuple[str, int]]) -> str:
    return ', '.join(f'{name} {count}' for name, count in counts)
