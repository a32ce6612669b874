# SPDX-License-Identifier: Apache-2.0
"""Recordings as files, for tests of the command."""

from imu_bench.cli.main import main
import numpy as np
import pytest

HEADER = 'stamp_s,' + ','.join(
    f'{quantity}.{letter}'
    for quantity in ('linear_acceleration', 'angular_velocity')
    for letter in 'xyz'
)


@pytest.fixture(scope='session')
def write_csv(tmp_path_factory):
    """Return a function that writes a still, noisy IMU as CSV with the native header."""

    def write(name='chip.csv', *, seed=1, n=6000, rate=100.0, scale=1.0, change=None):
        rng = np.random.default_rng(seed)
        rows = np.empty((n, 7))
        rows[:, 0] = 1000.0 + np.arange(n) / rate
        rows[:, 1:4] = rng.normal([0.0, 0.0, 9.80665], 0.02 * scale, (n, 3))
        rows[:, 4:] = rng.normal(0.0, 1e-3 * scale, (n, 3))
        if change is not None:
            change(rows)
        path = tmp_path_factory.mktemp('recording') / name
        np.savetxt(path, rows, fmt='%.9g', delimiter=',', header=HEADER, comments='')
        return path

    return write


@pytest.fixture
def imu_bench(capsys):
    """Return a function that runs the command and returns exit code, stdout and stderr."""

    def run(*arguments):
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as leave:  # argparse leaves this way
            code = leave.code
        shown = capsys.readouterr()
        return code, shown.out, shown.err

    return run


@pytest.fixture
def only_svg(monkeypatch):
    """Write figures in one format, where it is not the formats that are looked at."""
    monkeypatch.setattr('imu_bench.offline.presentation.figure_files.SUFFIXES', ('svg',))
