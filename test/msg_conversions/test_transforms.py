# SPDX-License-Identifier: Apache-2.0
"""Static transforms, against rosbags and scipy, which share no line with us."""

from itertools import pairwise

from msg_conversions.transforms import Mounting, static_transform, TF_TYPE
import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores
from scipy.spatial.transform import Rotation

ANGLES = [(0.0, 0.0, 0.0), (0.3, -1.2, 2.9), (np.pi, 0.0, 0.0), (-3.0, 1.5, -0.1)]


@pytest.mark.parametrize('rpy', ANGLES)
def test_roll_pitch_yaw_are_about_fixed_axes(rpy):
    expected = Rotation.from_euler('xyz', rpy)  # small letters: fixed axes
    place = Mounting('base_link', rpy=rpy)
    assert Rotation.from_quat(place.quaternion).approx_equal(expected, atol=1e-12)
    assert place.up == pytest.approx(expected.as_matrix()[2], abs=1e-12)


@pytest.mark.parametrize('length', range(9))
@pytest.mark.parametrize('other', range(4))
def test_the_bytes_are_those_of_a_message_with_one_transform(length, other):
    store = get_typestore(Stores.ROS2_JAZZY)
    place = Mounting('b' * other, (0.1, -0.2, 0.3), (0.1, 0.2, 0.3))
    blob = static_transform(1_700_000_000_123_456_789, 'f' * length, place)
    (found,) = store.deserialize_cdr(blob, TF_TYPE).transforms
    assert (found.header.frame_id, found.child_frame_id) == ('b' * other, 'f' * length)
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    moved, turned = found.transform.translation, found.transform.rotation
    assert (moved.x, moved.y, moved.z) == place.xyz
    assert (turned.x, turned.y, turned.z, turned.w) == place.quaternion
    assert bytes(store.serialize_cdr(store.deserialize_cdr(blob, TF_TYPE), TF_TYPE)) == blob


def test_stamps_of_any_time_are_kept():
    blobs = [
        static_transform(stamp, 'f', Mounting('b')) for stamp in (0, 10**9, 2**31 * 10**9 - 1)
    ]
    assert all(a != b for a, b in pairwise(blobs))
