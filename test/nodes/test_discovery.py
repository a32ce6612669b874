# SPDX-License-Identifier: Apache-2.0
"""Which topics are taken for those of a sensor."""

from imu_bench.nodes.discovery import matching
from imu_bench.nodes.topic_names import IMU_TYPE
from msg_conversions.quantities import IMU

GRAPH = [
    ('/bench/b/imu/data_raw', [IMU_TYPE]),
    ('/bench/a/imu/data_raw', [IMU_TYPE]),
    ('/imu/data_raw', [IMU_TYPE]),
    ('/bench/a/imu/data', [IMU_TYPE]),
    ('/bench/quimu/data_raw', [IMU_TYPE]),
    ('/bench/c/imu/data_raw', ['std_msgs/msg/String']),
    ('/bench/d/imu/data_raw', ['std_msgs/msg/String', IMU_TYPE]),
]


def test_name_and_type_must_both_fit():
    found = matching(GRAPH, IMU_TYPE, IMU)
    assert list(found) == ['/bench/a/imu/data_raw', '/bench/b/imu/data_raw', '/imu/data_raw']


def test_a_topic_of_two_types_is_nobodys():
    assert '/bench/d/imu/data_raw' not in matching(GRAPH)
    assert len(matching(GRAPH)) == len(GRAPH) - 1
