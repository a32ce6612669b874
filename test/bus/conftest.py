# SPDX-License-Identifier: Apache-2.0
"""A wire recording, what makes one, and what plays it."""

from imu_bench.bus.recording import Player, Recorder
from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.errors import RecordingError
from imu_bench.simulation.clock import SimulatedClock
import pytest

START_NS = 1_700_000_000_000_000_000
WORD = ('read', 0x75, 1), b'\x71'


def _recorder_of(path, steps, clock=None):
    wires = {'': ScriptedRegisters(steps)}
    return Recorder(path, wires, clock or SimulatedClock(START_NS), 'mpu9250', {}, 'hardware x')


@pytest.fixture
def recorder_of():
    """Return a function that gives a recorder of scripted transfers."""
    return _recorder_of


@pytest.fixture
def path(tmp_path):
    """Give a recording of 40 readings, 100 ms apart."""
    clock = SimulatedClock(START_NS)
    recorder = _recorder_of(tmp_path / 'mine.wire', [WORD] * 40, clock)
    for _ in range(40):
        recorder.now_ns()
        recorder.wires[''].read(0x75, 1)
        recorder.sleep(0.1)
    recorder.finish()
    return tmp_path / 'mine.wire'


def _play(path, pace=None):
    """Return how many readings came and why there were no more."""
    readings = 0
    try:
        player = Player(path, pace or SimulatedClock())
        while True:
            player.now_ns()
            assert player.wires[''].read(0x75, 1) == b'\x71'
            readings += 1
    except RecordingError as error:
        return readings, error


@pytest.fixture
def play():
    """Return a function that plays a recording to its end."""
    return _play
