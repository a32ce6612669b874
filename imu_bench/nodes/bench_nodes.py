# SPDX-License-Identifier: Apache-2.0
"""The nodes of a bench as processes: which executable, which parameters, which environment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import json
import os
from pathlib import Path
from types import MappingProxyType
from typing import Any

from imu_bench.config import BenchConfig, SensorConfig
from imu_bench.nodes import network
from imu_bench.nodes.bench_node import RECORDED
from imu_bench.nodes.processes import BenchProcesses
from imu_bench.nodes.topic_names import MEASURED
import yaml

RECORDER, ANALYSIS, SENSORS = 'recorder', 'analysis', 'sensors'


def enclave(name: str) -> list[str]:
    """Return the arguments of ROS that give a process its keys, where security is turned on."""
    return ['--enclave', f'/imu_bench/{name}']


def environment(
    logs: Path, defaults: Mapping[str, str], chosen: Mapping[str, str] = MappingProxyType({})
) -> dict[str, str]:
    """
    Return the environment of the nodes, and put this process's ROS 2 into the same.

    Parameters
    ----------
    logs : Path
        Folder of what ROS 2 logs, where the user names none.
    defaults : mapping of str to str
        Variables of ROS 2 that are set where the user has not.
    chosen : mapping of str to str
        Variables that are set whatever the user has, as `network.variables` returns them.
    """
    own = {**defaults, 'ROS_LOG_DIR': str(logs.resolve())}
    for name, value in own.items():
        os.environ.setdefault(name, value)
    network.apply(chosen)
    # one thread each: the sensors share the cores, and numpy's pools would only fight
    return {**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}


def start_recorder(
    processes: BenchProcesses,
    bag: Path,
    storage: str,
    topics: Sequence[str] = (),
    sensors: Sequence[str] = (),
) -> None:
    """Start the recorder of some topics, or of every bench; `sensors` are namespaces of ours."""
    flags = _flags({'output': str(bag.resolve()), 'storage': storage})
    for name, several in (('topics', topics), ('sensors', sensors)):
        if several:
            flags += _flags({name: json.dumps(list(several))})
    arguments = ['--ros-args', *enclave(RECORDER), *flags]
    processes.start(RECORDER, 'imu_bench.nodes.recorder_node', arguments)


def start_analysis(processes: BenchProcesses, bench: BenchConfig, file: Path) -> None:
    """Start the analysis as a bench has it, with the parameters of a file for the rest."""
    analysis = bench.analysis
    topics = [f'{sensor.namespace}/{MEASURED[0]}' for sensor in bench.sensors]
    flags = _flags(
        {
            'window_s': analysis.window_s,
            'confidence': analysis.confidence,
            'topics': json.dumps(topics),
        }
    )
    arguments = ['--ros-args', *enclave(ANALYSIS), '--params-file', str(file), *flags]
    processes.start(ANALYSIS, 'imu_bench.nodes.analysis_node', arguments)


def hosts(bench: BenchConfig) -> dict[str, tuple[SensorConfig, ...]]:
    """
    Return the processes of a bench by name, each with the sensors that it runs.

    One for all of them: six would take six times the memory, and talk to one another.
    """
    return {SENSORS: bench.sensors} if bench.sensors else {}


def start_sensors(
    processes: BenchProcesses,
    bench: BenchConfig,
    folder: Path,
    more: Mapping[str, Any],
    names: Iterable[str] | None = None,
    *,
    recorded: bool = False,
) -> None:
    """
    Start the processes that run the sensors of a bench.

    Parameters
    ----------
    folder : Path
        Gets a parameter file for each sensor.
    more : mapping of str to object
        Parameters of all of them.
    names : iterable of str, optional
        Of the processes, as `hosts` returns them; all of them by default.
    recorded : bool
        Whether the sensors wait for a recorder before they start.
    """
    every = hosts(bench)
    for name in every if names is None else names:
        arguments = [RECORDED] if recorded else []
        arguments += sensors_with_files(bench, every[name], folder, more)
        arguments += ['--ros-args', *enclave(SENSORS)]
        processes.start(name, 'imu_bench.nodes.bench_node', arguments)


def sensors_with_files(
    bench: BenchConfig, sensors: Iterable[SensorConfig], folder: Path, more: Mapping[str, Any]
) -> list[str]:
    """Return NAME=FILE[,FILE] of sensors; what the bench overrides becomes a file in a folder."""
    arguments = []
    for sensor in sensors:
        own = {**bench.overrides[sensor.name], **more}
        file = folder / f'{sensor.name}.yaml'
        if own:
            file.write_text(yaml.safe_dump({'/**': {'ros__parameters': own}}), encoding='utf-8')
        files = [bench.files[sensor.name], *([file] if own else [])]
        paths = ','.join(str(path.resolve()) for path in files)
        arguments.append(f'{sensor.name}={paths}')
    return arguments


def _flags(settings: Mapping[str, object]) -> list[str]:
    return [flag for name, value in settings.items() for flag in ('-p', f'{name}:={value}')]
