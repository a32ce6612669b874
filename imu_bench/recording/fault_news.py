# SPDX-License-Identifier: Apache-2.0
"""Scripted faults while they happen: a line when one begins, is named or is over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from imu_bench.counting import count

if TYPE_CHECKING:
    from imu_bench.live.views import SensorView

RECOVERED = 'recovered'
QUIET = ('failures', 'recoveries', 'bus_errors', 'uncalibrated', 'repeated', 'saturated')
"""Counts that say nothing about which fault it was, in a table that has errors and losses."""


class FaultNews:
    """What has happened to the faults of a bench since it was asked last."""

    def __init__(self, sensors: Mapping[str, SensorView]) -> None:
        self._sensors = sensors
        self._told: dict[tuple[str, int], tuple[str, str]] = {}

    def lines(self) -> Iterator[str]:
        """Yield a line for every fault that has begun, was named, or is over."""
        # copies: the monitor's thread goes on meanwhile
        for sensor, view in list(self._sensors.items()):
            for number, fault in sorted(view.faults.copy().items()):
                yield from self._lines_of(sensor, number, dict(fault))

    def _lines_of(self, sensor: str, number: int, fault: Mapping[str, str]) -> Iterator[str]:
        told, said = self._told.get((sensor, number), ('planned', ''))
        state, name = fault.get('state', told), fault.get('error', '').partition(':')[0]
        start = f'{sensor:<11} {fault.get("kind", ""):<17}'
        if told == 'planned' and state != told:
            lasts = fault.get('for_s', '0')
            yield f'{start} begins' + ('' if lasts == '0' else f', for {lasts} s')
        if name and name != said:
            yield f'{start} {fault["error"]}'
        if state == RECOVERED != told:
            yield f'{start} over: {_recovery(fault)}'
        self._told[sensor, number] = state, name


def _recovery(fault: Mapping[str, str]) -> str:
    counted = telling(fault.get('counted', ''))
    lost = count(int(fault.get('lost', '0')), 'sample')
    said = f'data again after {float(fault["recovery_s"]):.2f} s, {lost} lost'
    return f'{said} ({counted})' if counted else said


def telling(counted: str) -> str:
    """
    Return the counts that tell which fault it was.

    Examples
    --------
    >>> telling('failures 3, recoveries 1, bus_errors 3, brown_outs 1')
    'brown_outs 1'
    """
    parts = counted.split(', ') if counted else []
    return ', '.join(part for part in parts if part.rpartition(' ')[0] not in QUIET)
