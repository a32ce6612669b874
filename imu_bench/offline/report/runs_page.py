# SPDX-License-Identifier: Apache-2.0
"""The page that holds runs against one another."""

from __future__ import annotations

import os
from typing import Any

from imu_bench import __version__
from imu_bench.offline import across_text
from imu_bench.offline.across import Across
from imu_bench.offline.plotted import drawable
from imu_bench.offline.report import figures, text
from imu_bench.offline.report.document import page, Places
from imu_bench.offline.whole_files import write_text
from imu_bench.samples import IMU_QUANTITIES


def render(across: Across) -> str:
    """Return the comparison as one HTML document without any reference to the outside."""
    collected = Places()
    return page(
        'runs.html',
        collected,
        title=f'{len(across.runs)} runs compared',
        version=__version__,
        summary=across_text.summary(across),
        reference=across.runs[0].name,
        sensors=[_sensor(across, name, collected) for name in across.sensors],
    )


def write(across: Across, path: str | os.PathLike[str]) -> None:
    """
    Write the page.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_text(path, render(across))


def _sensor(across: Across, name: str, collected: Places) -> dict[str, Any]:
    recordings = across.sensors[name]
    places = []
    for quantity in IMU_QUANTITIES:
        axes = [axis for recording in recordings.values() for axis in recording.of(quantity.name)]
        title = text.SIGNAL_NAMES[quantity.name]
        arguments = (list(recordings.values()), list(recordings), quantity.name)
        if any(map(drawable, axes)):
            curves = figures.compare_allan(*arguments)
            places.append(collected.add(curves, f'{title}: Allan deviation'))
        if any(axis.psd for axis in axes):
            spectra = figures.compare_spectrum(*arguments)
            places.append(collected.add(spectra, f'{title}: noise spectrum'))
    lines = [line for line in across.lines if line.sensor == name]
    runs = dict.fromkeys(line.run for line in lines)
    tables = [
        {'run': run, 'rows': [across_text.row(line) for line in lines if line.run == run]}
        for run in runs
    ]
    return {'name': name, 'figures': places, 'tables': tables}
