# SPDX-License-Identifier: Apache-2.0
"""The witness of `./run benchmark survive` finds exactly what is not there."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from benchmarks import _witness
from benchmarks._recorded import lost_as_said

START_NS = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def time_of(ns):
    return TYPES['builtin_interfaces/msg/Time'](sec=int(ns // 10**9), nanosec=int(ns % 10**9))


def header(ns):
    return TYPES['std_msgs/msg/Header'](stamp=time_of(ns), frame_id='a')


def write(path, there, published, *, wander=0.0):
    """Write a bag of one sensor of 100 Hz with rosbags: which samples are there, and statuses."""
    kinds = 'sensor_msgs/msg/Temperature', 'diagnostic_msgs/msg/DiagnosticArray'
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        main = writer.add_connection('/bench/a/imu/data_raw', kinds[0], typestore=STORE)
        says = writer.add_connection('/diagnostics', kinds[1], typestore=STORE)
        for index in there:
            stamp = START_NS + round(index * 1e7 * (1.0 + wander))
            # any message that begins with a header will do
            message = TYPES[kinds[0]](header=header(stamp), temperature=0.0, variance=0.0)
            writer.write(main, int(stamp), STORE.serialize_cdr(message, kinds[0]))
        for count, until in published:
            values = {
                'published.imu/data_raw': count,
                'published_until_ns.imu/data_raw': START_NS + round(until * 1e7 * (1.0 + wander)),
            }
            pairs = [
                TYPES['diagnostic_msgs/msg/KeyValue'](key=key, value=str(value))
                for key, value in values.items()
            ]
            status = TYPES['diagnostic_msgs/msg/DiagnosticStatus'](
                level=0, name='a: acquisition', message='', hardware_id='', values=pairs
            )
            array = TYPES[kinds[1]](header=header(START_NS), status=[status])
            ns = START_NS + round(until * 1e7) + 1
            writer.write(says, ns, STORE.serialize_cdr(array, kinds[1]))


ALL = range(1000)
HOLE = [*range(300), *range(317, 1000)]


@pytest.mark.parametrize(
    ('there', 'published', 'missing', 'gaps', 'on_the_way'),
    [
        (ALL, [(500, 499), (1000, 999)], 0, 0, 0),
        (HOLE, [(500, 499), (1000, 999)], 17, 1, 17),
        (HOLE, [(483, 499), (983, 999)], 17, 1, 0),
        (HOLE, [(490, 499), (990, 999)], 17, 1, 7),
        # lost before the first that came
        (range(5, 1000), [(1000, 999)], 0, 0, 5),
        # started again: counted from 0 behind the hole
        (HOLE, [(300, 299), (100, 416), (683, 999)], 17, 1, 0),
        (HOLE, [(250, 249), (100, 416), (684, 999)], 17, 1, 1),
    ],
)
def test_it_finds_what_was_left_out(tmp_path, there, published, missing, gaps, on_the_way):
    write(tmp_path / 'bag', there, published)
    found = _witness.sensors(tmp_path / 'bag')['a']
    assert (found.messages, found.on_the_way) == (len(there), on_the_way)
    assert (found.missing, found.gaps) == (missing, gaps)


def test_a_sensor_that_is_off_its_rate_misses_nothing(tmp_path):
    write(tmp_path / 'bag', HOLE, [(983, 999)], wander=0.03)
    found = _witness.sensors(tmp_path / 'bag')['a']
    assert (found.missing, found.gaps, found.on_the_way) == (17, 1, 0)


def test_stamps_that_move_to_make_up_for_an_offset_hide_nothing():
    rng = np.random.default_rng(1)
    steps = np.full(20_000, 1_000_000)
    steps[5000:9000] += 1000
    steps[9000:13_000] -= 1000
    lost = rng.choice(20_000, 40, replace=False)
    numbers = rng.integers(1, 90, 40)
    steps[lost] += 1_000_000 * numbers
    assert _witness.missing_in(np.cumsum(steps)) == (numbers.sum(), 40)


def test_what_a_recording_says_is_read_from_its_last_lines():
    text = (
        'recording into bag; 1 GB free\n'
        'mti300: 13 879 messages, kept its rate (400.0 of 400 Hz), nothing lost\n'
        'tilt: 31 311 messages, did NOT keep its rate (9.1 of 10 Hz), 485 lost in the sensor\n'
        'piezo: 1 message, kept its rate, 1 028 lost: 1 003 in the sensor, 20 between reading and '
        'publishing, 4 on the way to the recorder, 1 in front of the disk\n'
        'lost in the sensor: it was not read in time\n'
        'bag: 178 546 messages, 6.4 MB, 10.0 s\n'
    )
    found = lost_as_said(text)
    assert found['mti300'] == {}
    assert found['tilt'] == {'sensor': 485}
    assert found['piezo'] == {'sensor': 1003, 'queue': 20, 'way': 4, 'disk': 1}
