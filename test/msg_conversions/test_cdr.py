# SPDX-License-Identifier: Apache-2.0
"""Bytes of whole blocks against two independent implementations: rosbags and rclpy."""

from hypothesis import given, settings
from hypothesis import strategies as st
from msg_conversions import cdr, covariance, reading
from msg_conversions.encoding import ImuTemplate, Template
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import get_typestore, Stores
import sensor_msgs.msg

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
T0 = 1_790_000_000_123_456_789


def rosbags_imu(stamp_ns, frame_id, acceleration, angular_velocity, first=(0.0, 0.0)):
    """Build an Imu of rosbags; `first` are elements 0 of the two covariances."""
    vector = TYPES['geometry_msgs/msg/Vector3']
    covariances = np.zeros((2, 9))
    covariances[:, 0] = first
    return TYPES['sensor_msgs/msg/Imu'](
        header=TYPES['std_msgs/msg/Header'](
            stamp=TYPES['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9)),
            frame_id=frame_id,
        ),
        orientation=TYPES['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        orientation_covariance=np.array(covariance.NOT_REPORTED),
        angular_velocity=vector(*angular_velocity),
        angular_velocity_covariance=covariances[1],
        linear_acceleration=vector(*acceleration),
        linear_acceleration_covariance=covariances[0],
    )


def rosbags_bytes(message, little_endian=True):
    return bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=little_endian))


def rclpy_bytes(message, numbers):
    """Serialise with rclpy; Fast CDR leaves what was in memory in the padding, so clear it."""
    blob = bytearray(serialize_message(message))
    end_of_text = 16 + int.from_bytes(blob[12:16], 'little')
    start_of_numbers = len(blob) - 8 * numbers
    blob[end_of_text:start_of_numbers] = bytes(start_of_numbers - end_of_text)
    return bytes(blob)


def block(n, frame_id='imu_link', seed=1):
    rng = np.random.default_rng(seed)
    stamps = T0 + np.cumsum(rng.integers(1, 10**7, n))
    return stamps, rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), frame_id


def rosbags_blobs(stamps, acceleration, angular_velocity, frame_id, **options):
    return [
        rosbags_bytes(rosbags_imu(int(s), frame_id, a, w), **options)
        for s, a, w in zip(stamps, acceleration, angular_velocity, strict=True)
    ]


FRAMES = st.text(
    st.characters(min_codepoint=1, exclude_categories=['Cs']), min_size=0, max_size=20
)


@given(FRAMES)
@settings(max_examples=40)
def test_template_gives_the_bytes_of_rosbags_for_any_frame_id(frame_id):
    stamps, acceleration, angular_velocity, _ = block(3)
    template = ImuTemplate(
        frame_id,
        acceleration_covariance=covariance.UNKNOWN,
        angular_velocity_covariance=covariance.UNKNOWN,
    )
    ours = template.encode_imu(stamps, acceleration, angular_velocity)
    theirs = rosbags_blobs(stamps, acceleration, angular_velocity, frame_id)
    assert ours == theirs
    assert cdr.decode_imu(theirs).frame_ids == (frame_id,)


@given(st.text(st.characters(codec='ascii', min_codepoint=32), max_size=20))
@settings(max_examples=20)
def test_template_gives_the_bytes_of_rclpy(frame_id):
    message = sensor_msgs.msg.Imu()
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(T0, 10**9)
    message.orientation_covariance[0] = -1.0
    message.linear_acceleration_covariance = covariance.diagonal(0.02)
    message.angular_velocity_covariance = covariance.diagonal(0.001)
    message.linear_acceleration.x, message.linear_acceleration.z = 0.25, 9.81
    message.angular_velocity.y = -3.5
    template = ImuTemplate(
        frame_id,
        acceleration_covariance=covariance.diagonal(0.02),
        angular_velocity_covariance=covariance.diagonal(0.001),
    )
    ours = template.encode_imu([T0], [[0.25, 0.0, 9.81]], [[0.0, -3.5, 0.0]])
    assert ours == [rclpy_bytes(message, 37)]
    assert deserialize_message(ours[0], sensor_msgs.msg.Imu) == message


def test_an_orientation_has_the_bytes_of_rclpy():
    message = sensor_msgs.msg.Imu()
    message.header.frame_id = 'imu'
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(T0, 10**9)
    message.orientation_covariance = covariance.diagonal(0.01)
    message.angular_velocity_covariance[0] = -1.0
    message.linear_acceleration_covariance[0] = -1.0
    q = message.orientation
    q.x, q.y, q.z, q.w = -0.5, 0.5, 0.1, 0.7
    template = ImuTemplate('imu', orientation_covariance=covariance.diagonal(0.01))
    ours = template.encode_imu([T0], orientation=[[-0.5, 0.5, 0.1, 0.7]])
    assert ours == [rclpy_bytes(message, 37)]


def test_magnetic_field_and_temperature_have_the_bytes_of_rclpy():
    field = sensor_msgs.msg.MagneticField()
    field.header.frame_id, field.header.stamp.sec = 'mag', 7
    field.magnetic_field.x, field.magnetic_field.y = 2e-5, float('nan')
    field.magnetic_field_covariance = covariance.diagonal(1e-6)
    template = Template('mag', (0.0, 0.0, 0.0, *covariance.diagonal(1e-6)))
    part = (cdr.MAGNETIC_FIELD_VECTOR, [[2e-5, float('nan'), 0.0]])
    assert template.encode([7 * 10**9], part) == [rclpy_bytes(field, 12)]

    warm = sensor_msgs.msg.Temperature()
    warm.header.frame_id, warm.temperature, warm.variance = 'imu_link', 31.25, 0.5
    template = Template('imu_link', (0.0, 0.5))
    assert template.encode([0], (cdr.TEMPERATURE_VALUE, [[31.25]])) == [rclpy_bytes(warm, 2)]


@pytest.mark.parametrize('little_endian', [True, False])
def test_a_block_of_rosbags_is_decoded_exactly(little_endian):
    stamps, acceleration, angular_velocity, frame_id = block(50)
    blobs = rosbags_blobs(
        stamps, acceleration, angular_velocity, frame_id, little_endian=little_endian
    )
    decoded = cdr.decode_imu(blobs)
    assert np.array_equal(decoded.stamps, stamps)
    assert np.array_equal(decoded.acceleration, acceleration)
    assert np.array_equal(decoded.angular_velocity, angular_velocity)
    assert decoded.frame_ids == (frame_id,)


def test_layouts_of_every_kind_in_one_block_keep_their_order():
    parts = [
        rosbags_blobs(*block(3, 'imu', seed=1)),
        rosbags_blobs(*block(3, 'imu2', seed=2)),  # another text, the same number of bytes
        rosbags_blobs(*block(3, 'imu', seed=3), little_endian=False),
        rosbags_blobs(*block(3, 'a_much_longer_frame_id', seed=4)),
    ]
    mixed = [blob for row in zip(*parts, strict=True) for blob in row]
    decoded = cdr.decode_imu(mixed)
    for index in range(4):
        stamps, acceleration, _, _ = block(3, seed=index + 1)
        assert np.array_equal(decoded.stamps[index::4], stamps)
        assert np.array_equal(decoded.acceleration[index::4], acceleration)
    assert decoded.frame_ids == ('a_much_longer_frame_id', 'imu', 'imu2')


@pytest.mark.parametrize('frame_id', ['', 'a', 'ab', 'abc', 'abcd', 'abcde'])
def test_xcdr2_aligns_numbers_to_four_bytes(frame_id):
    text = frame_id.encode() + b'\0'
    body = (7).to_bytes(4, 'little') + (5).to_bytes(4, 'little')
    body += len(text).to_bytes(4, 'little') + text
    body += bytes(-len(body) % 4) + np.arange(37.0).astype('<f8').tobytes()
    decoded = cdr.decode_stamped([bytes([0, 7, 0, 0]) + body] * 2, cdr.IMU)
    assert decoded.stamps.tolist() == [7_000_000_005] * 2
    assert np.array_equal(decoded.values, [np.arange(37.0)] * 2)
    assert decoded.frame_ids == (frame_id,)


def test_joined_bytes_are_decoded_where_the_offsets_say():
    blobs = [b'before', *rosbags_blobs(*block(5)), b'between!', *rosbags_blobs(*block(4, 'b'))]
    edges = np.concatenate(([0], np.cumsum([len(blob) for blob in blobs])))
    joined = b''.join(blobs)
    first = cdr.decode_imu_joined(joined, edges[1:7])
    second = cdr.decode_imu_joined(joined, edges[7:])
    assert np.array_equal(first.acceleration, block(5)[1])
    assert np.array_equal(second.angular_velocity, block(4)[2])


def test_nothing_decodes_to_nothing():
    decoded = cdr.decode_imu([])
    assert len(decoded) == 0
    assert decoded.acceleration.shape == (0, 3)
    assert not decoded.has_acceleration


def test_what_a_sensor_does_not_report_is_known():
    template = ImuTemplate('acc', acceleration_covariance=covariance.UNKNOWN)
    decoded = cdr.decode_imu(template.encode_imu([1, 2], np.ones((2, 3))))
    assert decoded.has_acceleration
    assert not decoded.has_angular_velocity
    assert decoded.angular_velocity_covariance.tolist() == [-1.0, -1.0]


def test_not_a_number_keeps_its_bits():
    odd = np.array([[np.nan, -0.0, np.inf]])
    odd[0, :1].view(np.uint64)[:] = 0x7FF8_0000_0000_BEEF
    template = ImuTemplate('acc', acceleration_covariance=covariance.UNKNOWN)
    decoded = cdr.decode_imu(template.encode_imu([1], odd))
    assert decoded.acceleration.tobytes() == odd.tobytes()


GOOD = rosbags_blobs(*block(1))[0]


@pytest.mark.parametrize(
    ('broken', 'says'),
    [
        (b'', '0 bytes'),
        (GOOD[:10], '10 bytes'),
        (GOOD[:-1], '323 bytes cannot hold'),
        (b'\x00\x03' + GOOD[2:], 'start with 00 03 00 00'),
        (b'\x01' + GOOD[1:], 'start with 01 01 00 00'),
        (GOOD[:12] + b'\xff\xff\xff\xff' + GOOD[16:], 'frame_id of 4294967295 bytes'),
    ],
)
def test_a_broken_message_is_named_by_its_index(broken, says):
    with pytest.raises(ValueError, match=says) as caught:
        cdr.decode_imu([GOOD, GOOD, broken, GOOD])
    assert str(caught.value).startswith('message 2: ')


def test_a_stamp_that_no_message_can_hold_is_refused():
    with pytest.raises(ValueError, match='do not fit'):
        ImuTemplate('imu').encode_imu([2**62])


def test_reading_objects_and_decoding_bytes_agree():
    stamps, acceleration, angular_velocity, frame_id = block(20)
    messages = [
        rosbags_imu(int(s), frame_id, a, w, first=(-1.0, 0.25))
        for s, a, w in zip(stamps, acceleration, angular_velocity, strict=True)
    ]
    from_objects = reading.imu(messages)
    from_bytes = cdr.decode_imu([rosbags_bytes(message) for message in messages])
    for name, column in vars(from_bytes).items():
        assert np.array_equal(getattr(from_objects, name), column), name
    assert not from_objects.has_acceleration
    assert from_objects.angular_velocity_covariance.tolist() == [0.25] * 20
