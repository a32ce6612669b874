# SPDX-License-Identifier: Apache-2.0
"""
Configuration: what a file may say, checked all at once.

A sensor's file is a ROS parameter file, so that ``--params-file`` and
`load_sensor` read the same; a bench's file lists sensors.
"""

from imu_bench.config.bench import (
    ANALYSIS_SETTINGS,
    AnalysisConfig,
    as_tested,
    BenchConfig,
    load_analysis,
    load_bench,
    RECORDER_SETTINGS,
    RecorderConfig,
)
from imu_bench.config.calibration import Affine, CALIBRATION_SETTINGS
from imu_bench.config.schema import parse_quantity, REQUIRED, Setting, suggestion
from imu_bench.config.sensor import (
    BACKENDS,
    load_sensor,
    sensor_from_parameters,
    SENSOR_SETTINGS,
    SensorConfig,
)
from imu_bench.config.simulated import SIMULATION_SETTINGS

__all__ = [
    'ANALYSIS_SETTINGS',
    'BACKENDS',
    'CALIBRATION_SETTINGS',
    'RECORDER_SETTINGS',
    'REQUIRED',
    'SENSOR_SETTINGS',
    'SIMULATION_SETTINGS',
    'Affine',
    'AnalysisConfig',
    'BenchConfig',
    'RecorderConfig',
    'SensorConfig',
    'Setting',
    'as_tested',
    'load_analysis',
    'load_bench',
    'load_sensor',
    'parse_quantity',
    'sensor_from_parameters',
    'suggestion',
]
