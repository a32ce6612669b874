# SPDX-License-Identifier: Apache-2.0
"""Writes the figures of an analysis into a folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import os
from pathlib import Path

from imu_bench.offline.comparison import labels
from imu_bench.offline.figure_files import draw
from imu_bench.offline.figure_files.style import file_names, look, save
from imu_bench.offline.plotted import drawable
from imu_bench.offline.results import Analysis, RecordingResult
from imu_bench.samples import IMU_QUANTITIES
from matplotlib.figure import Figure

_COMPARISON = 'comparison'


def write(analysis: Analysis, folder: str | os.PathLike[str]) -> list[Path]:
    """
    Write every figure as SVG, PDF and PNG, and return the files.

    Named after sensor, quantity and what is drawn: ``chip-linear_acceleration-allan.svg``; with
    several sensors also ``comparison-linear_acceleration-allan.svg``.

    Raises
    ------
    OSError
        If the folder cannot be made or a file not be written.
    """
    target = Path(folder)
    target.mkdir(exist_ok=True)
    names = labels(analysis.recordings)
    stems = file_names([*names, _COMPARISON])
    written: list[Path] = []
    with look():
        for recording, stem in zip(analysis.recordings, stems, strict=False):
            for part, figure in _sensor(recording):
                written += save(figure, target, f'{stem}-{part}')
        if len(analysis.recordings) > 1:
            for part, figure in _together(analysis.recordings, names):
                written += save(figure, target, f'{stems[-1]}-{part}')
    return written


def _sensor(recording: RecordingResult) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of a recording that it has data for."""
    for quantity in IMU_QUANTITIES:
        axes = recording.of(quantity.name)
        if any(map(drawable, axes)):
            yield f'{quantity.name}-allan', draw.allan(axes)
        if any(axis.psd for axis in axes):
            yield f'{quantity.name}-spectrum', draw.spectrum(axes)
        if any(axis.envelope for axis in axes):
            yield f'{quantity.name}-time', draw.time_series(axes, recording)
        if any(axis.histogram for axis in axes):
            yield f'{quantity.name}-histogram', draw.histogram(axes)


def _together(
    recordings: Sequence[RecordingResult], names: Sequence[str]
) -> Iterator[tuple[str, Figure]]:
    for quantity in IMU_QUANTITIES:
        axes = [axis for recording in recordings for axis in recording.of(quantity.name)]
        if any(map(drawable, axes)):
            curves = draw.compare_allan(recordings, names, quantity.name)
            yield f'{quantity.name}-allan', curves
        if any(axis.psd for axis in axes):
            yield (
                f'{quantity.name}-spectrum',
                draw.compare_spectrum(recordings, names, quantity.name),
            )
