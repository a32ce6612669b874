# SPDX-License-Identifier: Apache-2.0
"""
A DDS client that is not ROS: the `cyclonedds` package, an independent implementation.

``python foreign_client.py TYPE TOPIC COUNT`` prints that many messages, one JSON per line.
The types are written down here from the .msg files of ROS 2, not taken from our code.
"""

from dataclasses import asdict, dataclass
import json
import os
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, sequence, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PATIENCE_S = 300.0

UNTYPED = (
    '<CycloneDDS><Domain><Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation>'
    '</Compatibility></Domain></CycloneDDS>'
)
"""
Types are matched by their names with Fast DDS, vendor 1.15: what Fast DDS 3 of Kilted says of them
Cyclone DDS takes for invalid (eclipse-cyclonedds/cyclonedds, pull request 2333).
"""


@dataclass
class Time(IdlStruct, typename='builtin_interfaces::msg::dds_::Time_'):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename='std_msgs::msg::dds_::Header_'):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename='geometry_msgs::msg::dds_::Vector3_'):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename='geometry_msgs::msg::dds_::Quaternion_'):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Imu(IdlStruct, typename='sensor_msgs::msg::dds_::Imu_'):
    header: Header
    orientation: Quaternion
    orientation_covariance: array[float64, 9]
    angular_velocity: Vector3
    angular_velocity_covariance: array[float64, 9]
    linear_acceleration: Vector3
    linear_acceleration_covariance: array[float64, 9]


@dataclass
class Vector3Stamped(IdlStruct, typename='geometry_msgs::msg::dds_::Vector3Stamped_'):
    header: Header
    vector: Vector3


@dataclass
class MultiArrayDimension(IdlStruct, typename='std_msgs::msg::dds_::MultiArrayDimension_'):
    label: str
    size: uint32
    stride: uint32


@dataclass
class MultiArrayLayout(IdlStruct, typename='std_msgs::msg::dds_::MultiArrayLayout_'):
    dim: sequence[MultiArrayDimension]
    data_offset: uint32


@dataclass
class Float64MultiArray(IdlStruct, typename='std_msgs::msg::dds_::Float64MultiArray_'):
    layout: MultiArrayLayout
    data: sequence[float64]


def main(kind: str, topic: str, count: int) -> int:
    """Print messages of a topic."""
    # beside what keeps it to this machine
    settings = filter(None, (os.environ.get('CYCLONEDDS_URI'), UNTYPED))
    os.environ['CYCLONEDDS_URI'] = ','.join(settings)
    participant = DomainParticipant(int(os.environ['ROS_DOMAIN_ID']))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1000))
    # ROS 2 puts 'rt' before the name of every topic
    reader = DataReader(participant, Topic(participant, f'rt{topic}', globals()[kind]), qos=qos)
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        for message in reader.take_iter(timeout=duration(milliseconds=200)):
            print(json.dumps(asdict(message)))
            count -= 1
            if count == 0:
                return 0
    return 1


if __name__ == '__main__':
    sys.exit(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
