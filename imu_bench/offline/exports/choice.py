# SPDX-License-Identifier: Apache-2.0
"""Which exports there are, and which recording of a result is meant."""

from __future__ import annotations

from collections.abc import Callable

from imu_bench.errors import RecordingError
from imu_bench.offline.comparison import labels
from imu_bench.offline.exports import ros, simulation, table, vio
from imu_bench.offline.exports.numbers import Numbers
from imu_bench.offline.results import Analysis, RecordingResult

_WRITERS: dict[str, Callable[[Numbers], str]] = {
    'kalibr': vio.kalibr,
    'openvins': vio.openvins,
    'orb-slam3': vio.orb_slam3,
    'vins': vio.vins,
    'gtsam': vio.gtsam,
    'robot_localization': ros.robot_localization,
    'sensor_msgs': ros.sensor_msgs,
    'gz-sim': simulation.gz_sim,
    'kalman': simulation.kalman,
}

FORMATS = (*_WRITERS, 'csv')
"""Names of the exports."""


def render(analysis: Analysis, to: str, topic: str = '', *, conservative: bool = False) -> str:
    """
    Return an export as text.

    Parameters
    ----------
    analysis : Analysis
        A result, in memory or read from its JSON document.
    to : str
        One of `FORMATS`.
    topic : str
        Topic or label of the sensor; not needed where there is one only.  The table 'csv' holds
        all of them if none is named.
    conservative : bool
        Upper ends of intervals instead of values; 'csv' holds both in any case.

    Raises
    ------
    RecordingError
        If the format or the sensor is not known, or the result lacks what the format needs.
    """
    if to == 'csv':
        chosen = analysis.recordings if not topic else (choose(analysis, topic),)
        return table.table(chosen)
    if to not in _WRITERS:
        raise RecordingError(f'unknown export {to!r}; known are {", ".join(FORMATS)}')
    return _WRITERS[to](Numbers(choose(analysis, topic), conservative))


def choose(analysis: Analysis, topic: str = '') -> RecordingResult:
    """
    Return the recording of a topic or label.

    Raises
    ------
    RecordingError
        If there is none or more than one.
    """
    names = labels(analysis.recordings)
    rows = list(zip(names, analysis.recordings, strict=True))
    found = [r for name, r in rows if topic in ('', name, r.topic)]
    if len(found) == 1:
        return found[0]
    known = ', '.join(
        name if name == recording.topic else f'{name} (topic {recording.topic})'
        for name, recording in rows
    )
    if not found:
        raise RecordingError(f'no sensor {topic!r} in this result; there are: {known or "none"}')
    problem = f'{topic!r} names several sensors' if topic else 'the result has several sensors'
    raise RecordingError(f'{problem}: choose one with --topic: {known}')
