# SPDX-License-Identifier: Apache-2.0
"""
Somebody on another host, who looks at what he can reach, and may publish.

``python visitor.py rmw|cyclone CONTROL [TOPIC [LINE]]`` waits for `CONTROLS` messages on CONTROL,
a topic that everybody can see ('' waits for none), and prints every topic that somebody publishes,
as JSON.  With TOPIC he waits for that as well, however long it takes; with LINE he publishes
messages of 1e6 m/s² on it until /diagnostics says this, and that some of his were kept out.
"""

import json
import os
import sys
import time

CONTROLS = 40
"""
Messages of the control, ten a second, after which what is open would have been found as well:
Fast DDS announces a participant every 3 s (``leaseDuration_announcementperiod``).
"""


def with_rmw(control, topic='', line=''):
    """Return the topics that a node of ROS 2 sees."""
    from diagnostic_msgs.msg import DiagnosticArray
    import rclpy
    from sensor_msgs.msg import Imu

    rclpy.init()
    node = rclpy.create_node('visitor')
    heard, named = [], []
    if control:
        node.create_subscription(Imu, control, heard.append, 10)

    def listen(message):
        for status in message.status:
            foreign = any(pair.key == f'foreign.{topic}' for pair in status.values)
            if status.message == line and foreign:
                named.append(status.name)

    publisher = node.create_publisher(Imu, topic, 10) if line else None
    if line:
        node.create_subscription(DiagnosticArray, '/diagnostics', listen, 100)
    own = 0 if publisher is None else 1
    wrong = Imu()
    wrong.linear_acceleration.x = 1e6
    wrong.header.frame_id = 'elsewhere'
    while (
        len(heard) < (CONTROLS if control else 0)
        or (line and not named)
        or (topic and node.count_publishers(topic) <= own)
    ):
        rclpy.spin_once(node, timeout_sec=0.02)
        if publisher is not None:
            publisher.publish(wrong)
    names = [name for name, _ in node.get_topic_names_and_types()]
    return [name for name in names if node.count_publishers(name)]


def with_cyclone(control, topic=''):
    """Return the topics that a program without ROS 2 sees."""
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
    from cyclonedds.domain import DomainParticipant

    participant = DomainParticipant(int(os.environ['ROS_DOMAIN_ID']))
    reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    seen = set()

    def names():
        # of a publisher that has ended only the key is given
        return {each.topic_name for each in reader.take(100)} - {None}

    while not {f'rt{name}' for name in (control, topic) if name} <= seen:
        seen.update(names())
        time.sleep(0.1)  # the pace of looking
    for _ in range(CONTROLS):
        seen.update(names())
        time.sleep(0.1)
    return [name.removeprefix('rt') for name in seen]


def publish_with_cyclone(*topics):
    """Publish, as a bench on Cyclone DDS would."""
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic
    from foreign_client import Imu

    participant = DomainParticipant(int(os.environ['ROS_DOMAIN_ID']))
    writers = [DataWriter(participant, Topic(participant, f'rt{name}', Imu)) for name in topics]
    print('up', flush=True)
    sys.stdin.read()
    del writers


def publish_with_rmw(topic):
    """Publish ten messages a second until the standard input ends."""
    import select

    import rclpy
    from sensor_msgs.msg import Imu

    rclpy.init()
    node = rclpy.create_node('control')
    publisher = node.create_publisher(Imu, topic, 10)
    print('up', flush=True)
    while not select.select([sys.stdin], [], [], 0.1)[0]:
        publisher.publish(Imu())


if __name__ == '__main__':
    kind, *arguments = sys.argv[1:]
    if kind.startswith('publish'):
        globals()[f'{kind}_with_{arguments[0]}'](*arguments[1:])
    else:
        looks = {'rmw': with_rmw, 'cyclone': with_cyclone}
        print(json.dumps(sorted(looks[kind](*arguments))))
