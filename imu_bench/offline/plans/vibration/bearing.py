# SPDX-License-Identifier: Apache-2.0
"""What repeats in the envelope of a vibration, and the verdict on faults of a bearing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from imu_bench.config.schema import parse_quantity, Setting
from imu_bench.errors import ConfigError, DataError
from imu_bench.metrology.trials.envelope import (
    Band,
    bearing_frequencies,
    Envelope,
    Fault,
    faults,
)
from imu_bench.offline.notation import number, text
from imu_bench.offline.presentation.figure import Figure, Series
from imu_bench.offline.presentation.tables import Cell, Column, Table
import numpy as np

SETTINGS = (
    Setting('envelope', (), "Band of the envelope, '2 kHz, 4 kHz'; by default the clearest."),
    Setting('faults', (), "Fault frequencies to look for, 'outer 107.4 Hz, inner 162.2 Hz'."),
    Setting(
        'bearing', (),
        "Elements, their diameter, pitch diameter and contact angle, '9, 7.94 mm, 39.04 mm, 0 °'.",
    ),
    Setting('speed', None, 'Revolutions of its shaft.', (), (1e-3, 1e6), 'Hz', 'quantity'),
)  # fmt: skip

LISTED = 3
"""Lines of an envelope in the table; all are in the JSON document."""

Named = tuple[str, Envelope]
"""Sensor and axis, and its envelope."""


def band(settings: Mapping[str, Any]) -> Band | None:
    """Return the band that was asked for, None if none was."""
    given = settings['envelope']
    if not given:
        return None
    if len(given) != 2:
        raise ConfigError("--set envelope: give two frequencies, such as '2 kHz, 4 kHz'")
    low, high = (_quantity('envelope', one, 'Hz') for one in given)
    if not 0.0 < low < high:
        raise ConfigError(f'--set envelope: {low:g} Hz to {high:g} Hz is no band')
    return low, high


def expected(settings: Mapping[str, Any]) -> dict[str, float]:
    """
    Return the fault frequencies to look for in Hz, by name.

    Raises
    ------
    ConfigError
        If they make no sense.

    Examples
    --------
    >>> expected({'faults': ('outer 107.4 Hz',), 'bearing': (), 'speed': None})
    {'outer': 107.4}
    """
    found: dict[str, float] = {}
    for one in settings['faults']:
        name, _, frequency = one.partition(' ')
        found[name] = _quantity('faults', frequency, 'Hz')
        if not found[name] > 0.0:
            raise ConfigError(f'--set faults: {one}: a frequency is above 0 Hz')
    return found | _of_geometry(settings)


def _of_geometry(settings: Mapping[str, Any]) -> dict[str, float]:
    given, speed = settings['bearing'], settings['speed']
    if not given:
        return {}
    if speed is None:
        raise ConfigError("--set bearing needs the speed of the shaft too: --set speed='1797 rpm'")
    if len(given) not in (3, 4) or not given[0].isdigit():
        raise ConfigError(
            '--set bearing: give the number of elements, their diameter, the pitch diameter and, '
            "if it is not 0, the contact angle, such as '9, 7.94 mm, 39.04 mm'"
        )
    diameter, pitch = (_quantity('bearing', one, 'm') for one in given[1:3])
    angle = _quantity('bearing', given[3], 'rad') if len(given) == 4 else 0.0
    try:
        return bearing_frequencies(speed[0], int(given[0]), diameter, pitch, angle)
    except DataError as error:
        raise ConfigError(f'--set bearing: {error}') from error


def _quantity(name: str, given: str, unit: str) -> float:
    try:
        return parse_quantity(given, unit)
    except ConfigError as error:
        raise ConfigError(f'--set {name}: {error}') from error


def verdicts(
    named: Sequence[Named], settings: Mapping[str, Any], tolerance_hz: float
) -> list[tuple[str, Fault]]:
    """Return what every envelope says about every fault."""
    wanted = expected(settings)
    return [(name, one) for name, found in named for one in faults(found, wanted, tolerance_hz)]


def sentences(named: Sequence[Named], judged: Sequence[tuple[str, Fault]]) -> Iterator[str]:
    """Yield what to say first."""
    best: dict[str, tuple[str, Fault]] = {}
    for name, fault in judged:
        if fault.seen and (fault.name not in best or fault.chance < best[fault.name][1].chance):
            best[fault.name] = (name, fault)
    for name, fault in best.values():
        yield (
            f'Fault seen: {fault.name}, every {text(fault.frequency)} on {name} (expected '
            f'{number(fault.expected_hz)} Hz), harmonics {_listed(fault)}.'
        )
    if judged and not best:
        yield 'None of the faults looked for is seen in the envelope.'
    if not judged:
        lines = [(n, e, e.tones[0]) for n, e in named if e.tones]
        if lines:
            name, found, tone = max(lines, key=lambda line: line[2].above_floor)
            yield (
                f'{name} between {number(found.band[0])} and {number(found.band[1])} Hz comes '
                f'and goes at {text(tone.frequency)}.'
            )


def _listed(fault: Fault) -> str:
    return ', '.join(str(order) for order in fault.orders)


def tables(named: Sequence[Named], judged: Sequence[tuple[str, Fault]]) -> Iterator[Table]:
    """Yield the lines of the envelopes, and the verdicts."""
    rows: list[tuple[Cell, ...]] = []
    for name, found in named:
        where = f'{number(found.band[0])} to {number(found.band[1])}'
        rows += [(name, where, tone.frequency, found.depth(tone)) for tone in found.tones[:LISTED]]
    if rows:
        columns = (
            Column('sensor, axis'), Column('band', 'Hz'), Column('line', 'Hz'), Column('depth'),
        )  # fmt: skip
        note = (
            'Lines of the spectrum of the squared envelope of a band: how often what is in it '
            'comes and goes, such as the ringing after each blow. Depth is the part of its mean '
            'by which the power varies. The band is the one of the three highest octaves with the '
            'clearest line, unless --set envelope= names one. Noise alone shows a line in one '
            'axis of a hundred.'
        )
        yield Table(f'Envelope, the {LISTED} strongest lines', columns, tuple(rows), note)
    if judged:
        heads = (
            Column('sensor, axis'), Column('fault'), Column('expected', 'Hz'), Column('verdict'),
            Column('found', 'Hz'), Column('depth'), Column('harmonics seen'), Column('by chance'),
        )  # fmt: skip
        note = (
            'Seen if its lines, within 2 % of what was expected for the slip of the elements, are '
            'more than lines without relation would put there in one axis of a hundred; by chance '
            'is that probability.'
        )
        yield Table('Faults', heads, tuple(_row(name, fault) for name, fault in judged), note)


def _row(name: str, fault: Fault) -> tuple[Cell, ...]:
    seen = 'seen' if fault.seen else 'not seen'
    found = (fault.frequency, fault.depth) if fault.seen else (None, None)
    return (
        name, fault.name, round(fault.expected_hz, 3), seen, *found, _listed(fault),
        f'{fault.chance:.1g}',
    )  # fmt: skip


def figures(named: Sequence[Named]) -> Iterator[Figure]:
    """Yield the envelope spectra that have a line."""
    for name, found in named:
        if found.tones:
            spectrum = found.spectrum
            density = np.sqrt(spectrum.density) / found.mean
            where = f'{number(found.band[0])} to {number(found.band[1])} Hz'
            yield Figure(
                f'{name}: envelope of {where}', 'frequency in Hz', 'depth in 1/√Hz',
                (Series(name, spectrum.frequency, density),), log_y=True,
            )  # fmt: skip


def document(found: Envelope | None, judged: Sequence[Fault]) -> dict[str, Any] | None:
    """Return one envelope and the verdicts for programs."""
    if found is None:
        return None
    return {
        'band_hz': list(found.band),
        'lines': [
            {'frequency': tone.frequency.to_json(), 'depth': found.depth(tone).to_json()}
            for tone in found.tones
        ],
        'faults': {
            fault.name: {
                'expected_hz': fault.expected_hz,
                'seen': fault.seen,
                'frequency': fault.frequency.to_json(),
                'depth': fault.depth.to_json(),
                'harmonics': list(fault.orders),
                'chance': fault.chance,
            }
            for fault in judged
        },
    }
