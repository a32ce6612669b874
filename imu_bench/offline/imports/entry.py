# SPDX-License-Identifier: Apache-2.0
"""One line on each stream that was imported: how much it is, what was left out, what was kept."""

from __future__ import annotations

from dataclasses import dataclass

from imu_bench.errors import DataError
from imu_bench.metrology.stamps import timing
from imu_bench.offline.imports.naming import is_from_bag
from imu_bench.offline.imports.tracks import received, reported
from imu_bench.offline.notation import count, duration, number
from imu_bench.offline.recordings import Recording
from msg_conversions.quantities import AXES, IMU_QUANTITIES
import numpy as np

_LOOKED_AT = 1 << 20
"""Samples of which the rate is told."""

_DATES_NS = 1_000_000_000_000_000_000
"""In 2001: a clock that shows less does not count from 1970."""

_QUANTITIES = ('orientation', 'angular velocity', 'acceleration')


@dataclass(frozen=True)
class Entry:
    """One stream that was written."""

    name: str  # of the topic, file or folder
    samples: int
    words: str  # what the user must know of it

    def __str__(self) -> str:
        return f'{self.name}: {self.words}'


def entry(name: str, recording: Recording, remarks: list[str], lost: int = 0) -> Entry:
    """Return the entry of a recording written under a name."""
    stamps = recording.samples.stamps
    size = count(len(recording) - lost, 'sample')
    long = duration((int(stamps.max()) - int(stamps.min())) * 1e-9)
    words = [f'{size}, {long}{_rate(recording)}', _left_out(recording, lost)]
    if recording.stamp_source == 'rate':
        words.append('stamps count from 0 s at the given rate, since the source has no clock')
    elif int(stamps.max()) < _DATES_NS:
        words.append('stamps are those of a clock of its own, not dates')
    words += [remark for remark in remarks if remark]
    return Entry(name, len(recording) - lost, '; '.join(words))


def kept_in_bag(recording: Recording) -> list[str]:
    """Return remarks on what a bag has of a recording besides its values."""
    samples = recording.samples
    missing = [
        f'{quantity.name}.{axis}'
        for quantity in IMU_QUANTITIES
        if (values := getattr(samples, quantity.field)) is not None
        for axis, column in zip(AXES, values.T, strict=True)
        if np.isnan(column[:1]).any()
    ]
    absent = [q.name for q in IMU_QUANTITIES if getattr(samples, q.field) is None]
    remarks = [f'{", ".join(missing)} not measured: NaN'] if missing else []
    remarks += [f'{", ".join(absent)} not measured: covariance -1'] if absent else []
    if not is_from_bag(recording):
        return remarks
    turns = reported(recording)
    arrived = received(recording) is recording.receive_ns
    known = zip(_QUANTITIES, recording.covariances, strict=True)
    changing = [
        name for name, values in known if values is None and (turns or name != 'orientation')
    ]
    kept = {
        'receive times': arrived,
        'frame_id': True,
        'covariances': len(changing) < len(recording.covariances),
        'orientation': turns,
    }
    remarks.append(f'kept: {", ".join(name for name, there in kept.items() if there)}')
    if not arrived:
        remarks.append('not kept: receive times, which a bag cannot hold or nobody could use')
    if changing:
        remarks.append(f'not kept: covariance of {" and ".join(changing)}, which changes: now 0')
    return remarks


def lost_outside_bags(recording: Recording, form: str) -> list[str]:
    """Return a remark on what a table or columns have no place for."""
    if not is_from_bag(recording):
        return []
    return [f'{form} has no place for receive times, frame_id and covariances']


def _rate(recording: Recording) -> str:
    stamps = np.array(recording.samples.stamps[:_LOOKED_AT])
    try:
        return f' at {number(1.0 / timing.grid(stamps).period_s, 4)} Hz'
    except (DataError, ZeroDivisionError):
        return ''  # no rate in so few stamps, or such ones


def _left_out(recording: Recording, without_room: int) -> str:
    words = []
    if recording.left_out:
        words.append(f'{count(recording.left_out, "sample")} with values that are no numbers')
    if without_room:
        words.append(f'{count(without_room, "sample")} with stamps that a message cannot hold')
    lost = (recording.announced or 0) - recording.stored
    if lost > 0:
        words.append(f'{count(lost, "announced message")} that could not be read')
    return f'left out: {", ".join(words)}' if words else 'nothing left out'
