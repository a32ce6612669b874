# SPDX-License-Identifier: Apache-2.0
"""
Reading recordings: bags of ROS 1 and ROS 2, CSV and text, arrays of NumPy and MATLAB.

>>> from imu_bench.offline.recordings import ReadOptions
>>> ReadOptions(topics=('/imu/data',)).topics
('/imu/data',)
"""

from imu_bench.offline.recordings.discovery import find_recordings
from imu_bench.offline.recordings.joining import grouped
from imu_bench.offline.recordings.loading import load, load_all, read_chunks, Recording
from imu_bench.offline.recordings.opening import open_source
from imu_bench.offline.recordings.options import ReadOptions
from imu_bench.offline.recordings.source import Chunk, Source, Topic

__all__ = [
    'Chunk',
    'ReadOptions',
    'Recording',
    'Source',
    'Topic',
    'find_recordings',
    'grouped',
    'load',
    'load_all',
    'open_source',
    'read_chunks',
]
