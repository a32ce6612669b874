# SPDX-License-Identifier: Apache-2.0
"""Recordings made of numbers, for tests of what comes after reading."""

from imu_bench.offline.recordings import Recording
from imu_bench.samples import Samples
import numpy as np
import pytest

START_NS = 1_700_000_000_000_000_000
GRAVITY = np.array([0.0, 0.0, 9.80665])


def recording_of(samples, **changes):
    """Return samples as they come out of a healthy bag."""
    fields = {
        'source': 'night.mcap',
        'topic': '/bench/chip/imu/data_raw',
        'samples': samples,
        'receive_ns': None,
        'frame_id': 'imu_link',
        'announced': len(samples),
        'stored': len(samples),
        'left_out': 0,
        'notes': (),
        'stamp_source': 'header',
        'stamp_reason': 'they increase as a time of measurement does',
    }
    return Recording(**(fields | changes))


def noise(seed=1, *, n=60_000, rate=100.0, acceleration=2e-3, angular_velocity=1e-4, jitter_s=0.0):
    """Return a still IMU with white noise of these densities N, in unit/√Hz."""
    rng = np.random.default_rng(seed)
    stamps = START_NS + np.round(np.arange(n) * 1e9 / rate).astype(np.int64)
    if jitter_s:
        stamps = stamps + np.round(rng.normal(0.0, jitter_s * 1e9, n)).astype(np.int64)
    root = np.sqrt(rate)
    return Samples(
        stamps,
        acceleration=GRAVITY + rng.normal(0.0, acceleration * root, (n, 3)),
        angular_velocity=rng.normal(0.0, angular_velocity * root, (n, 3)),
    )


@pytest.fixture(name='recording_of', scope='session')
def recording_of_fixture():
    """Return the function from samples to a recording."""
    return recording_of


@pytest.fixture(name='noise', scope='session')
def noise_fixture():
    """Return the function that makes a still, noisy IMU."""
    return noise
