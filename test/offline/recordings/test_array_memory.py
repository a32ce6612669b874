# SPDX-License-Identifier: Apache-2.0
"""A long array, or one compressed a thousandfold, takes no more memory than a short one."""

from __future__ import annotations

import subprocess
import sys

from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import array_files, open_source, ReadOptions
import numpy as np
import pytest
from scipy.io import savemat

SHORT, LONG = 150_000, 4_000_000
AXES = ('ax', 'ay', 'az', 'gx', 'gy', 'gz')

READ = """
import resource, sys
from pathlib import Path
from imu_bench.offline.running.mapped import MappedLimit
from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.recordings.cache import columns
import scipy.io  # before: its size is not that of a recording
with MappedLimit(16 << 20):
    for path in map(Path, sys.argv[1:]):
        given = {'columns': 'stamp,ax,ay,az,gx,gy,gz'} if path.suffix == '.npy' else {}
        with columns(path, ReadOptions(units='SI', **given)) as read:
            print(len(read.recordings[0]), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""

BETWEEN = 'import subprocess, sys; sys.exit(subprocess.run(sys.argv[1:]).returncode)'
# a process inherits the peak of whoever starts it: not that of the tests


def write(path, size, values):
    table = np.column_stack([np.arange(size) / 1000, values])
    named = {'stamp_s': table[:, 0]} | dict(zip(AXES, table[:, 1:].T, strict=True))
    if path.suffix == '.npy':
        np.save(path, table)
    elif path.suffix == '.mat':
        savemat(path, named)
    else:
        np.savez(path, **named)


@pytest.mark.slow
@pytest.mark.parametrize('form', ['npy', 'npz', 'mat'])
def test_memory_does_not_grow_with_the_file(tmp_path, form):
    rng = np.random.default_rng(1)
    files = [tmp_path / f'short.{form}', tmp_path / f'long.{form}']
    for file, size in zip(files, (SHORT, LONG), strict=True):
        write(file, size, rng.normal(size=(size, 6)))
    short, long = peaks(files)
    assert long < 2.5 * short  # as a whole it would be twice that


@pytest.mark.slow
def test_what_is_compressed_a_thousandfold_does_not_come_back_in_memory(tmp_path):
    files = [tmp_path / 'short.npz', tmp_path / 'long.npz']
    for file, size in zip(files, (SHORT, LONG), strict=True):
        named = {'stamp_s': np.arange(size), **{axis: np.zeros(size) for axis in AXES[:3]}}
        np.savez_compressed(file, **named)
    short, long = peaks(files)
    assert files[1].stat().st_size < 8 << 20
    assert long < 2.5 * short


def peaks(files):
    """Return the peak memory of reading each of the files, in KiB."""
    command = [sys.executable, '-c', BETWEEN, sys.executable, '-c', READ, *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = [list(map(int, line.split())) for line in done.stdout.splitlines()]
    assert [size for size, _ in lines] == [SHORT, LONG]
    return [peak for _, peak in lines]


@pytest.mark.parametrize('compress', [False, True])
def test_a_variable_of_matlab_that_is_too_large_is_refused(tmp_path, monkeypatch, compress):
    monkeypatch.setattr(array_files, 'MATLAB_BYTES', 2 << 20)
    path = tmp_path / 'a.mat'
    log = {'gyro': np.arange(360_000.0).reshape(-1, 3)}
    savemat(path, {'fs': 100.0, 'log': log}, do_compression=compress)
    with pytest.raises(
        RecordingError, match=r'variable log may take 21 MiB, and .* as CSV or \.npy'
    ):
        open_source(path, ReadOptions(units='SI', rate_hz=100.0))
