# SPDX-License-Identifier: Apache-2.0
"""The exports of one sensor as blocks to paste, for the page."""

from __future__ import annotations

from imu_bench.errors import RecordingError
from imu_bench.offline import exports
from imu_bench.offline.results import Analysis, RecordingResult

_NAMES = (
    'kalibr', 'openvins', 'orb-slam3', 'vins', 'gtsam', 'robot_localization', 'sensor_msgs',
    'gz-sim', 'kalman',
)  # fmt: skip


def blocks(recording: RecordingResult) -> list[tuple[str, str]]:
    """Return name and text of every export that the recording has the numbers for."""
    found = [(name, _block(recording, name)) for name in _NAMES]
    return [(name, text) for name, text in found if text]


def _block(recording: RecordingResult, name: str) -> str:
    try:
        return exports.render(Analysis((recording,)), name)
    except RecordingError:
        # one sensor of the two, or no bound: what the export needs is not there
        return ''
