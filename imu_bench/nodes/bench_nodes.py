# SPDX-License-Identifier: Apache-2.0
"""The nodes of a bench as processes: which executable, which parameters, which environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
import os
from pathlib import Path
from typing import Any

from imu_bench.config import BenchConfig
from imu_bench.nodes.processes import BenchProcesses
import yaml

RECORDER, ANALYSIS = 'recorder', 'analysis'


def environment(logs: Path, defaults: Mapping[str, str]) -> dict[str, str]:
    """
    Return the environment of the nodes, and put this process's ROS 2 into the same.

    Parameters
    ----------
    logs : Path
        Folder of what ROS 2 logs, where the user names none.
    defaults : mapping of str to str
        Variables of ROS 2 that are set where the user has not.
    """
    own = {**defaults, 'ROS_LOG_DIR': str(logs.resolve())}
    for name, value in own.items():
        os.environ.setdefault(name, value)
    # one thread each: the sensors share the cores, and numpy's pools would only fight
    return {**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}


def start_recorder(
    processes: BenchProcesses, bag: Path, storage: str, topics: Sequence[str] = ()
) -> None:
    """Start the recorder; without topics it records those of every bench there is."""
    flags = _flags({'output': str(bag.resolve()), 'storage': storage})
    if topics:
        flags += _flags({'topics': json.dumps(list(topics))})
    processes.start(RECORDER, 'imu_bench.nodes.recorder_node', ['--ros-args', *flags])


def start_analysis(processes: BenchProcesses, bench: BenchConfig, file: Path) -> None:
    """Start the analysis as a bench has it, with the parameters of a file for the rest."""
    analysis = bench.analysis
    flags = _flags({'window_s': analysis.window_s, 'confidence': analysis.confidence})
    arguments = ['--ros-args', '--params-file', str(file), *flags]
    processes.start(ANALYSIS, 'imu_bench.nodes.analysis_node', arguments)


def start_sensors(
    processes: BenchProcesses, bench: BenchConfig, folder: Path, more: Mapping[str, Any]
) -> None:
    """
    Start a node per sensor.

    Parameters
    ----------
    processes : BenchProcesses
    bench : BenchConfig
    folder : Path
        Gets a parameter file for each sensor.
    more : mapping of str to object
        Parameters of all of them.
    """
    for sensor in bench.sensors:
        own = {**bench.overrides[sensor.name], **more}
        file = folder / f'{sensor.name}.yaml'
        file.write_text(yaml.safe_dump({'/**': {'ros__parameters': own}}), encoding='utf-8')
        files = ['--params-file', str(bench.files[sensor.name])]
        if own:
            files += ['--params-file', str(file)]
        processes.start(
            sensor.name,
            'imu_bench.nodes.sensor_node',
            ['--ros-args', *files, '-r', f'__ns:={sensor.namespace}'],
        )


def _flags(settings: Mapping[str, object]) -> list[str]:
    return [flag for name, value in settings.items() for flag in ('-p', f'{name}:={value}')]
