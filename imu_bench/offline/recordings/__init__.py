# SPDX-License-Identifier: Apache-2.0
"""
Reading recordings: bags of ROS 1 and ROS 2, CSV and text, arrays of NumPy and MATLAB.

>>> from imu_bench.offline.recordings import ReadOptions
>>> ReadOptions(topics=('/imu/data',)).topics
('/imu/data',)
"""

from imu_bench.offline.recordings.discovery import find_recordings
from imu_bench.offline.recordings.loading import load, load_all, Recording
from imu_bench.offline.recordings.opening import open_source
from imu_bench.offline.recordings.source import ReadOptions, Source
from imu_bench.offline.recordings.text import grouped

__all__ = [
    'ReadOptions',
    'Recording',
    'Source',
    'find_recordings',
    'grouped',
    'load',
    'load_all',
    'open_source',
]
