# SPDX-License-Identifier: Apache-2.0
"""
What is recorded of a wire is played to the bit, on every driver and bus there is.

A new driver is tested without a line of editing here.
"""

from dataclasses import fields, replace
from pathlib import Path
import threading

from imu_bench import bench
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.recording import read_head
from imu_bench.config import sensor_from_parameters
from imu_bench.drivers import load, names
from imu_bench.errors import ConfigError, RecordingError, RecordingOver
from imu_bench.samples import Samples
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest

CASES = [(name, kind) for name in names() for kind in load(name).bus_kinds]
SECOND = 1_000_000_000
ROOT = Path(__file__).resolve().parent.parent
NOT_OF_THE_WIRE = {'over': '', 'tape': '', 'tape_problem': ''}
"""Statistics that say whether something is recorded or played."""


def sensor(name, **parameters):
    return sensor_from_parameters(
        'mine', {'driver': name, **parameters}, settings_of=bench.settings_of,
        recorded_in=read_head,
    )  # fmt: skip


def captured(path, name, kind, seconds=2.0, **parameters):
    """Record an emulated sensor on simulated time; return its runs and statistics."""
    own = {'converter': 'by bus', 'rate_hz': 0.0} if name == 'mtn1100' else {}
    config = sensor(
        name, backend='emulated', bus=kind, wire_recording=str(path), **(own | parameters)
    )
    clock = SimulatedClock()
    acquisition = bench.build(config, clock)
    runs = []
    for _ in range(round(10 * seconds)):
        acquisition.advance(clock.now_ns() + SECOND // 10)
        runs += acquisition.drain()
    acquisition.finish()
    runs += acquisition.drain()
    stats = acquisition.stats
    acquisition.close()
    return runs, replace(stats, **NOT_OF_THE_WIRE)


def played(path):
    """Play a recording as fast as possible; return runs, statistics and why it ended."""
    runs, stats = bench.play(path)
    return runs, replace(stats, **NOT_OF_THE_WIRE), stats.over


def assert_same(recorded, again):
    assert len(recorded) == len(again) > 0
    for run, other in zip(recorded, again, strict=True):
        for field in fields(Samples):
            one, two = getattr(run, field.name), getattr(other, field.name)
            assert (one is None) == (two is None), field.name
            if one is not None:
                # bytes, so that a NaN equals itself and 0 is not -0
                assert one.tobytes() == two.tobytes(), field.name


@pytest.mark.parametrize(('name', 'kind'), CASES)
def test_every_sensor_is_played_to_the_bit(tmp_path, name, kind):
    path = tmp_path / 'mine.wire'
    runs, stats = captured(path, name, kind, seconds=3.0 if name == 'mtn1100' else 1.5)
    again, stats_again, over = played(path)
    assert_same(runs, again)
    assert stats_again == stats
    assert sum(map(len, runs)) > 20
    assert ' over after ' in over
    assert 'cut off' not in over


FAULTS = [
    ('mpu9250', 'i2c', ['unplugged 1 0.5', 'stuck 2.5 0.3', 'brown_out 3.5']),
    ('mpu9250', 'spi', ['bit_errors 1 0.3', 'stall 2 1']),
    ('mti300', 'serial', ['unplugged 1 1', 'half_frame 3', 'garbage 3.5 0.2']),
    ('bno055', 'serial', ['no_answer 1 0.5', 'dropped_byte 2.5', 'wrong_identity 3 0.5']),
    ('scl3300', 'frame', ['bit_error 1', 'unplugged 2 0.5']),
    ('mtn1100', 'daqhat', ['unplugged 2.5 0.5', 'stall 3.5 2']),
]


@pytest.mark.parametrize(('name', 'kind', 'faults'), FAULTS)
def test_faults_are_played_with_their_errors_and_counters(tmp_path, name, kind, faults):
    path = tmp_path / 'mine.wire'
    runs, stats = captured(path, name, kind, seconds=6.0, **{'simulation.faults': faults})
    assert stats.failures + sum(stats.counters.values()) > 0
    assert stats.errors or kind == 'spi'
    again, stats_again, _ = played(path)
    assert_same(runs, again)
    assert stats_again == stats
    assert stats_again.last_error == stats.last_error


def test_a_recording_that_ends_in_a_fault_ends_in_it_when_played(tmp_path):
    path = tmp_path / 'mine.wire'
    runs, stats = captured(path, 'mpu9250', 'i2c', **{'simulation.faults': ['unplugged 1 5']})
    assert stats.error
    again, stats_again, over = played(path)
    assert_same(runs, again)
    assert stats_again == stats
    assert ' over after ' in over


def test_a_recorder_changes_nothing(tmp_path):
    kinds = {'simulation.faults': ['unplugged 0.5 0.5']}
    taped, stats = captured(tmp_path / 'mine.wire', 'mpu9250', 'i2c', **kinds)
    plain, plain_stats = captured('', 'mpu9250', 'i2c', **kinds)
    assert_same(taped, plain)
    assert stats == plain_stats


def test_settings_come_from_the_recording(tmp_path):
    path = tmp_path / 'mine.wire'
    captured(path, 'mpu9250', 'spi', rate_hz=500.0, accelerometer_range=4.0)
    config = sensor_from_parameters(
        'mine', {'backend': 'recorded', 'wire_recording': str(path)},
        settings_of=bench.settings_of, recorded_in=read_head,
    )  # fmt: skip
    assert config.driver == 'mpu9250'
    assert config.settings['rate_hz'] == 500.0
    assert config.settings['accelerometer_range'] == 4.0
    assert bench.label(config) == 'recorded emulated mpu9250, 2023-11-14T22:13:20+00:00'


def test_the_example_records_and_plays_with_one_word_changed(tmp_path):
    example = ROOT / 'config' / 'wire_recording.yaml'
    assert bench.load_sensor(example).backend == 'hardware'
    path = {'wire_recording': str(tmp_path / 'mpu9250.wire')}
    live = bench.load_sensor(example, overrides=path | {'backend': 'emulated'})
    clock = SimulatedClock()
    acquisition = bench.build(live, clock)
    acquisition.advance(clock.now_ns() + SECOND)
    acquisition.close()
    again = bench.load_sensor(example, overrides=path | {'backend': 'recorded'})
    acquisition = bench.build(again, SimulatedClock())
    acquisition.advance(2**62)
    assert acquisition.stats.samples > 500
    acquisition.close()


def test_calibration_is_not_of_the_wire(tmp_path):
    path = tmp_path / 'mine.wire'
    runs, _ = captured(path, 'mpu9250', 'i2c')
    config = sensor(
        'mpu9250', backend='recorded', wire_recording=str(path),
        **{'calibration.acceleration.bias': ['1.0 m/s²', '0 m/s²', '0 m/s²']},
    )  # fmt: skip
    acquisition = bench.build(config, SimulatedClock())
    acquisition.advance(2**62)
    moved = next(run for run in acquisition.drain() if run.acceleration is not None)
    first = next(run for run in runs if run.acceleration is not None)
    np.testing.assert_allclose(
        moved.acceleration - first.acceleration, [[-1.0, 0.0, 0.0]] * len(first), atol=1e-12
    )
    acquisition.close()


# --- bad input ---------------------------------------------------------------------------
@pytest.fixture
def path(tmp_path):
    """Give a recording of an MPU-9250."""
    captured(tmp_path / 'mine.wire', 'mpu9250', 'i2c')
    return tmp_path / 'mine.wire'


@pytest.mark.parametrize(
    ('given', 'says'),
    [
        ({'driver': 'bno055'}, 'driver: recorded with mpu9250, not with bno055; leave it out'),
        ({'driver': 'generic', 'rate_hz': 100.0}, 'driver: recorded with mpu9250, not with gener'),
        ({'rate_hz': 200.0}, 'rate_hz: recorded with 1000.0, not with 200.0; leave it out'),
        ({'wire_recording': ''}, 'wire_recording: missing; name the file to play'),
        ({'wire_recording': 'no.wire'}, r'wire_recording: no\.wire: No such file or directory'),
        ({'wire_recording': __file__}, r'wire_recording: .*\.py: no wire recording'),
    ],
)
def test_what_cannot_be_played_is_one_line(path, given, says):
    given = {'backend': 'recorded', 'wire_recording': str(path), **given}
    with pytest.raises(ConfigError, match=says) as caught:
        sensor_from_parameters(
            'mine', given, settings_of=bench.settings_of, recorded_in=read_head, source='x.yaml'
        )
    assert '\n' not in str(caught.value)
    assert str(caught.value).startswith('x.yaml.')


def test_a_file_that_was_exchanged_is_noticed_when_it_is_played(path, tmp_path):
    config = sensor('mpu9250', backend='recorded', wire_recording=str(path))
    path.unlink()
    captured(path, 'mpu9250', 'i2c', rate_hz=500.0)
    with pytest.raises(RecordingError, match=r'rate_hz: recorded with 500\.0, not with 1000\.0'):
        bench.build(config)


def test_a_generic_source_has_no_wire(tmp_path):
    config = sensor(
        'generic', backend='emulated', rate_hz=100.0, wire_recording=str(tmp_path / 'a.wire')
    )
    with pytest.raises(ConfigError, match='wire_recording: a generic source has no wire'):
        bench.build(config)


@pytest.fixture
def changed(monkeypatch):
    """Give the driver a request that it did not have when it was recorded."""
    driver = load('mpu9250')
    read, calls = driver.read, []

    def another(self):
        calls.append(1)
        if len(calls) == 20:
            self.registers.burst(self.identities[0].register)
        return read(self)

    monkeypatch.setattr(driver, 'read', another)


def test_a_driver_that_has_changed_is_told_where(path, changed):
    with pytest.raises(RecordingError, match=r'event \d+ at 0\.\d+ s: asked: read 1 bytes from'):
        bench.play(path)


def test_in_a_thread_it_ends_the_acquisition_with_the_error(path, changed):
    config = sensor('mpu9250', backend='recorded', wire_recording=str(path))
    ended = threading.Event()
    acquisition = bench.build(
        config, SimulatedClock(), on_data=lambda: acquisition.over and ended.set()
    )
    acquisition.prepare()
    acquisition.start()
    ended.wait()
    acquisition.stop()
    assert acquisition.drain()
    stats = acquisition.stats
    assert stats.state == 'stopped'
    assert stats.error == stats.over
    assert 'asked: read 1 bytes from' in stats.error
    acquisition.close()


def test_stopped_before_its_end_it_is_not_played_on(path):
    config = sensor('mpu9250', backend='recorded', wire_recording=str(path))
    acquisition = bench.build(config, SystemClock())
    acquisition.prepare()
    acquisition.start()
    acquisition.stop()
    assert acquisition.stats.failures == 0
    with pytest.raises(RecordingOver, match='from its beginning, clean up and configure'):
        acquisition.start()
    assert acquisition.over == ''
    acquisition.close()


def test_one_that_never_sampled_is_closed_and_can_be_played(tmp_path):
    path = tmp_path / 'mine.wire'
    config = sensor('mpu9250', backend='emulated', wire_recording=str(path))
    acquisition = bench.build(config, SimulatedClock())
    acquisition.prepare()
    acquisition.close()
    acquisition = bench.build(
        sensor('mpu9250', backend='recorded', wire_recording=str(path)), SimulatedClock()
    )
    acquisition.prepare()
    acquisition.advance(2**62)
    assert ' over after ' in acquisition.over
    acquisition.close()
