# SPDX-License-Identifier: Apache-2.0
"""Whether samples were measured: what a bag and the truth beside a recording say."""

from __future__ import annotations

from pathlib import Path

from imu_bench.config.json_file import read_json

EMULATED = 'emulated'
"""In the hardware id of a sensor whose chip is emulated (`imu_bench.bench.label`)."""

_TRUTH, _SCHEMA = 'truth.json', 'imu_bench.truth/1'
"""What `imu_bench.simulation.recording` writes beside what it simulates."""

_LEVELS = 3
"""A recording is its own folder, a file in it, or the folder of one of its sensors."""


def beside(path: Path, topic: str) -> str:
    """Return what the truth beside a recording says of a stream; empty where there is none."""
    for folder in (path, *path.parents)[:_LEVELS]:
        file = folder / _TRUTH
        if not file.is_file():
            continue
        try:
            truth = read_json(file)
        except (OSError, ValueError):
            return ''  # somebody else's, or damaged: the samples are read all the same
        if not isinstance(truth, dict) or truth.get('schema') != _SCHEMA:
            return ''
        sensors = truth.get('sensors')
        names = {*topic.split('/'), path.stem}
        return 'imu-bench simulate' if isinstance(sensors, dict) and names & sensors.keys() else ''
    return ''
