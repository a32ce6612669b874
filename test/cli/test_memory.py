# SPDX-License-Identifier: Apache-2.0
"""A long recording needs no more memory than a short one."""

import subprocess
import sys

from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from msg_conversions.encoding import ImuTemplate
import numpy as np
import pytest

SLICE, SLICES = 100_000, 30
COLUMNS_MIB = SLICE * SLICES * 8 * 8 >> 20
"""Two stamps and six axes of every message: 183 MiB."""

FEW_MIB = 215
"""What a short recording takes: the interpreter, numpy, scipy, and the pages in use."""

TOPIC = '/imu/data_raw'

MEASURE = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
# between the tests and what is measured: a process inherits the peak of whoever starts it


@pytest.fixture(scope='module')
def long_bag(tmp_path_factory):
    """Return a bag of three million messages."""
    path = tmp_path_factory.mktemp('long') / 'bag'
    rng, template = np.random.default_rng(1), ImuTemplate('imu_link')
    with BagWriter(path, 'mcap', compression='') as bag:
        bag.add_topic(describe(TOPIC, 'sensor_msgs/msg/Imu'))
        for number in range(SLICES):
            stamps = 1_000_000_000 + (number * SLICE + np.arange(SLICE)) * 1_000_000
            values = np.rint(rng.normal(0.0, 100.0, (SLICE, 6))) * 1e-4
            rows = template.imu_rows(stamps, values[:, :3], values[:, 3:])
            bag.write_many(TOPIC, stamps, rows)
    return path


@pytest.mark.slow
def test_columns_do_not_stay_in_memory(long_bag):
    command = [sys.executable, '-m', 'imu_bench.cli.main', 'analyze', str(long_bag)]
    done = subprocess.run(
        [sys.executable, '-c', MEASURE, *command, '--jobs', '1', '--cache', 'none'],
        stdout=subprocess.PIPE, check=True,
    )  # fmt: skip
    assert int(done.stdout.split()[-1]) >> 10 < FEW_MIB + COLUMNS_MIB * 0.6
