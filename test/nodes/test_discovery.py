# SPDX-License-Identifier: Apache-2.0
"""Which topics are taken for those of a sensor."""

from imu_bench.nodes.discovery import matching
from imu_bench.nodes.topic_names import IMU_TYPE
import pytest

GRAPH = [
    ('/bench/b/imu/data_raw', [IMU_TYPE]),
    ('/bench/a/imu/data_raw', [IMU_TYPE]),
    ('/imu/data_raw', [IMU_TYPE]),
    ('/bench/a/imu/data', [IMU_TYPE]),
    ('/bench/quimu/data_raw', [IMU_TYPE]),
    ('/bench/c/imu/data_raw', ['std_msgs/msg/String']),
    ('/bench/d/imu/data_raw', ['std_msgs/msg/String', IMU_TYPE]),
]


def test_the_type_must_fit():
    found = matching(GRAPH, IMU_TYPE)
    assert list(found) == sorted({name for name, kinds in GRAPH if IMU_TYPE in kinds})
    assert set(found.values()) == {IMU_TYPE}


def test_a_topic_of_two_types_is_nobodys_unless_one_is_known():
    name = '/bench/d/imu/data_raw'
    assert name not in matching(GRAPH)
    assert len(matching(GRAPH)) == len(GRAPH) - 1
    assert matching(GRAPH, known={name: IMU_TYPE})[name] == IMU_TYPE
    # somebody else was there first
    assert '/bench/c/imu/data_raw' not in matching(
        GRAPH, known={'/bench/c/imu/data_raw': IMU_TYPE}
    )


@pytest.mark.parametrize(
    'name',
    ['/1a/imu', '/x-y/imu', '/a//imu', '/x.y/imu', '/a\x1b]0;owned\x07/imu', '/' + 'n' * 300, ''],
)
def test_names_that_ros_does_not_have_are_left_out(name):
    assert matching([*GRAPH, (name, [IMU_TYPE])]) == matching(GRAPH)


def test_types_that_ros_does_not_have_are_left_out():
    foreign = ['Evil', '', 'a/b', 'a/msg/b/c', '../msg/x', 'os.path/msg/x']
    assert matching([('/odd', [kind]) for kind in foreign]) == {}
    assert matching([('/odd', [*foreign, IMU_TYPE])]) == {'/odd': IMU_TYPE}
