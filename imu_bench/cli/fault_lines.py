# SPDX-License-Identifier: Apache-2.0
"""Scripted faults on the terminal: a line when one begins, is named or is over, and a summary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from imu_bench.offline.notation import count
from rich import box
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from imu_bench.nodes.bench_monitor import SensorView

RECOVERED = 'recovered'
QUIET = ('failures', 'recoveries', 'bus_errors', 'uncalibrated', 'repeated', 'saturated')
"""Counts that say nothing about which fault it was, in a table that has errors and losses."""

IN_FLIGHT = 4
"""So many samples may be lost between the last diagnostics of a sensor and its end."""


class FaultNews:
    """
    What has happened to the faults of a bench since it was asked last.

    Parameters
    ----------
    sensors : mapping of str to SensorView
    """

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
    counted = _telling(fault.get('counted', ''))
    lost = count(int(fault.get('lost', '0')), 'sample')
    said = f'data again after {float(fault["recovery_s"]):.2f} s, {lost} lost'
    return f'{said} ({counted})' if counted else said


def _telling(counted: str) -> str:
    """
    Return the counts that tell which fault it was.

    Examples
    --------
    >>> _telling('failures 3, recoveries 1, bus_errors 3, brown_outs 1')
    'brown_outs 1'
    """
    parts = counted.split(', ') if counted else []
    return ', '.join(part for part in parts if part.rpartition(' ')[0] not in QUIET)


def show_faults(sensors: Mapping[str, SensorView]) -> int:
    """Print what came of every fault; return 1 if one was not played or not recovered from."""
    faults = [
        (sensor, fault) for sensor, view in sensors.items() for fault in view.faults.values()
    ]
    table = Table(
        title='Faults', title_justify='left', box=box.SIMPLE_HEAD, pad_edge=False,
        show_edge=False,
    )  # fmt: skip
    for name in ('sensor', 'fault', 'at s', 'for s', 'named', 'counted', 'lost', 'back after s'):
        right = name in ('at s', 'for s', 'lost', 'back after s')
        table.add_column(name, justify='right' if right else 'left', no_wrap=name != 'counted')
    for sensor, fault in faults:
        table.add_row(
            sensor, fault['kind'], fault['at_s'],
            fault['for_s'] if fault['for_s'] != '0' else 'once',
            fault['errors'] or '-', _telling(fault['counted']) or '-', fault['lost'],
            f'{float(fault["recovery_s"]):.2f}' if fault['recovery_s'] else fault['state'],
        )  # fmt: skip
    Console(width=None if Console().is_terminal else 120).print(table)
    return _summary(faults)


def _summary(faults: list[tuple[str, dict[str, str]]]) -> int:
    failed = [(sensor, fault) for sensor, fault in faults if fault['state'] != RECOVERED]
    lost = count(sum(int(fault['lost']) for _, fault in faults), 'sample')
    print()
    for sensor, fault in failed:
        why = {
            'planned': 'was not played; give a longer --duration',
            'active': 'was not over; give a longer --duration',
        }.get(fault['state'], f'has NOT recovered: {fault["error"] or "no data"}')
        print(f'{sensor}: {fault["kind"]} at {fault["at_s"]} s {why}')
    if not faults:
        print('no fault was reported: does a sensor of this bench have simulation.faults?')
        return 1
    recovered = len(faults) - len(failed)
    print(f'{recovered} of {len(faults)} faults recovered from, {lost} lost and counted')
    return int(bool(failed))


def show_gaps(results: Path, sensors: Mapping[str, SensorView]) -> None:
    """Print, sensor by sensor, what the recording misses beside what was counted as lost."""
    import json

    document = json.loads(results.read_text(encoding='utf-8'))
    for recording in document['recordings']:
        sensor = recording['topic'].split('/')[2]
        if sensor not in sensors or not sensors[sensor].faults:
            continue
        view = sensors[sensor]
        also = f' and {view.lost_otherwise} otherwise' if view.lost_otherwise else ''
        missing = int(recording['health']['missing'])
        said = f'{view.lost_by_faults} lost by faults{also}; {missing} missing in the recording'
        more = missing - int(view.number('lost'))
        if more > IN_FLIGHT:
            said += f', {more} more than the sensor lost: they did not reach the recorder'
        print(f'{sensor}: {said}')
