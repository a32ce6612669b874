# SPDX-License-Identifier: Apache-2.0
"""A simulated bench on disk: read back by others, the same however it is cut, with its truth."""

import errno
import json
from pathlib import Path

from imu_bench import bench
from imu_bench.bags.columns import ColumnWriter
from imu_bench.bags.writer import BagWriter
from imu_bench.config import sensor_from_parameters
from imu_bench.config.location import named_file
from imu_bench.errors import RecordingError
from imu_bench.samples import Samples
from imu_bench.simulation import recording
from imu_bench.simulation.clock import START_NS
from imu_bench.simulation.recording import TRANSPORT_NS
from imu_bench.simulation.scenario import load_scenario
from msg_conversions import reading
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

SECONDS = 3.0


def generic(name, rate_hz, **simulation):
    simulation = simulation or {'acceleration': {'noise_density': '100 µg/√Hz'}}
    return sensor_from_parameters(
        name,
        {'driver': 'generic', 'backend': 'emulated', 'rate_hz': rate_hz, 'simulation': simulation},
        settings_of=bench.settings_of,
    )


def simulated(*configs, scenario='still', run=0):
    loaded = load_scenario(scenario, seed=run)
    return [bench.simulate(config, loaded, run=run) for config in configs], loaded


@pytest.fixture(params=['mcap', 'sqlite3'])
def bag(request, tmp_path):
    configs = bench.load_bench(named_file('benches', 'machine_vibration')).sensors
    sensors, scenario = simulated(*configs)
    counts = recording.write_bag(
        tmp_path / 'bag', sensors, scenario, SECONDS, storage=request.param
    )
    return tmp_path / 'bag', sensors, counts


@pytest.mark.slow
def test_every_sample_of_every_sensor_is_in_the_bag_with_its_stamp_and_value(bag):
    path, sensors, counts = bag
    anew, _ = simulated(*(sensor.config for sensor in sensors))
    with AnyReader([path]) as reader:
        stored = {connection.topic: [] for connection in reader.connections}
        received = {connection.topic: [] for connection in reader.connections}
        for connection, stamp, data in reader.messages():
            stored[connection.topic].append(reader.deserialize(data, connection.msgtype))
            received[connection.topic].append(stamp)
    assert {topic: len(messages) for topic, messages in stored.items()} == counts
    for sensor in anew:
        run = sensor.sources[0].samples_until(START_NS + round(SECONDS * 1e9))
        topic = f'/bench/{sensor.name}/imu/data_raw'
        block = reading.imu(stored[topic])
        np.testing.assert_array_equal(block.stamps, run.stamps)
        np.testing.assert_array_equal(block.acceleration, run.acceleration)
        assert block.has_angular_velocity == (run.angular_velocity is not None)
        if run.angular_velocity is not None:
            np.testing.assert_array_equal(block.angular_velocity, run.angular_velocity)
        np.testing.assert_array_equal(received[topic], run.stamps + TRANSPORT_NS)
        assert block.frame_ids == (sensor.config.frame_id,)


def test_a_bag_is_interleaved_as_a_recorder_would(bag):
    path, _, _ = bag
    with AnyReader([path]) as reader:
        times = np.array([stamp for _, stamp, _ in reader.messages()])
    assert (np.diff(times) >= 0).all()
    assert abs(times[-1] - times[0] - SECONDS * 1e9) < 2e7


def test_the_truth_says_every_parameter_of_every_axis_in_si(tmp_path):
    own = generic(
        'own', 400.0, rate_error='10 ppm',
        acceleration={
            'noise_density': '2 m/s²/√Hz', 'random_walk': '3 m/s²/√s',
            'bias': ['0 g', '1 g', '0 g'], 'axes': 'yz',
        },
    )  # fmt: skip
    chip = bench.load_sensor(named_file('sensors', 'mpu9250'))
    sensors, scenario = simulated(own, chip, run=4)
    recording.write_bag(tmp_path / 'bag', sensors, scenario, SECONDS, run=4)
    truth = json.loads((tmp_path / 'bag' / 'truth.json').read_text(encoding='utf-8'))
    assert (truth['schema'], truth['run']) == ('imu_bench.truth/1', 4)
    assert truth['duration'] == {'value': SECONDS, 'unit': 's'}
    assert truth['scenario']['name'] == 'still'
    axes = truth['sensors']['own']['axes']
    assert list(axes) == ['linear_acceleration.y', 'linear_acceleration.z']
    axis = axes['linear_acceleration.y']
    given = axis['parameters']
    assert given['noise_density'] == {'value': 2.0, 'unit': 'm/s²/√Hz'}
    assert given['bias'] == {'value': 9.80665, 'unit': 'm/s²'}
    assert given['cross_axis'] == {'value': [0.0, 0.0, 0.0], 'unit': '1'}
    assert given['low_pass'] == {'value': None, 'unit': 'Hz'}
    assert axis['rate'] == {'value': 400.0 * (1 + 10e-6), 'unit': 'Hz'}
    assert axis['coefficients']['N']['value'] == pytest.approx(np.sqrt(2.0))
    assert axis['coefficients']['K'] == {'value': 3.0, 'unit': 'm/s³/√Hz'}
    assert axis['at_start'] == {'value': 9.80665, 'unit': 'm/s²'}
    turning = truth['sensors']['mpu9250']['axes']['angular_velocity.x']
    # the default filter of the chip's gyroscope, and its step at ±2000 °/s
    assert turning['parameters']['low_pass']['value'] == 184.0
    assert turning['parameters']['resolution']['value'] == pytest.approx(np.pi / 180 / 16.4)


def test_the_bag_says_that_it_is_simulated(bag):
    text = (bag[0] / 'metadata.yaml').read_text(encoding='utf-8')
    assert 'simulated_by: imu_bench' in text
    assert 'scenario: still' in text


def test_the_slices_do_not_show(tmp_path, monkeypatch):
    def written(name, slice_s):
        monkeypatch.setattr(recording, 'SLICE_S', slice_s)
        sensors, scenario = simulated(
            generic('a', 100.0), generic('b', 333.0), scenario='engine_idle'
        )
        recording.write_columns(tmp_path / name, sensors, scenario, 5.0)
        return [np.load(tmp_path / name / s / 'acceleration.npy') for s in 'ab']

    for whole, parts in zip(written('whole', 8.0), written('parts', 0.7), strict=True):
        np.testing.assert_allclose(whole, parts, rtol=0, atol=1e-9)


def test_columns_are_plain_npy_of_every_quantity(tmp_path):
    sensor = generic(
        'a', 50.0,
        acceleration={'noise_density': '1 mg/√Hz'}, temperature={'resolution': '0.1 K'},
    )  # fmt: skip
    sensors, scenario = simulated(sensor)
    counts = recording.write_columns(tmp_path / 'out', sensors, scenario, 20.0)
    folder = tmp_path / 'out' / 'a'
    stamps, force = np.load(folder / 'stamps.npy'), np.load(folder / 'acceleration.npy')
    assert counts == {'a': 1000}
    assert (stamps.shape, stamps.dtype, force.shape) == ((1000,), np.int64, (1000, 3))
    np.testing.assert_array_equal(np.diff(stamps), 20_000_000)
    np.testing.assert_array_equal(np.load(folder / 'temperature.npy'), np.full(1000, 25.0))
    assert force[:, 2].mean() == pytest.approx(9.80665, abs=0.01)
    assert (tmp_path / 'out' / 'truth.json').is_file()


def test_temperature_is_published_ten_times_a_second(tmp_path):
    sensor = generic(
        'a', 130.0,
        acceleration={'noise_density': '1 mg/√Hz'}, temperature={'resolution': '0.1 K'},
    )  # fmt: skip
    sensors, scenario = simulated(sensor)
    counts = recording.write_bag(tmp_path / 'bag', sensors, scenario, 20.0)
    assert counts == {'/bench/a/imu/data_raw': 2600, '/bench/a/temperature': 200}


def test_two_sensors_of_a_shaken_bench_feel_the_same_motion(tmp_path):
    sensors, scenario = simulated(
        generic('a', 400.0), generic('b', 1000.0), scenario='engine_idle'
    )
    recording.write_columns(tmp_path / 'out', sensors, scenario, 10.0)
    a, b = (
        (
            np.load(tmp_path / 'out' / n / 'stamps.npy'),
            np.load(tmp_path / 'out' / n / 'acceleration.npy'),
        )
        for n in 'ab'
    )
    both = np.intersect1d(a[0], b[0])
    left = a[1][np.searchsorted(a[0], both), 2]
    right = b[1][np.searchsorted(b[0], both), 2]
    assert both.size > 1000
    assert np.corrcoef(left, right)[0, 1] > 0.99


def test_progress_counts_simulated_seconds(tmp_path):
    sensors, scenario = simulated(generic('a', 10.0))
    seen = []
    recording.write_bag(
        tmp_path / 'bag', sensors, scenario, 20.0, progress=lambda *step: seen.append(step)
    )
    assert seen == [(8, 20), (16, 20), (20, 20)]


@pytest.mark.parametrize('write', [recording.write_bag, recording.write_columns])
def test_a_folder_that_exists_is_left_as_it_is(tmp_path, write):
    sensors, scenario = simulated(generic('a', 10.0))
    (tmp_path / 'mine').write_text('precious')
    with pytest.raises(RecordingError, match='exists already'):
        write(tmp_path, sensors, scenario, 1.0)
    assert [path.name for path in tmp_path.iterdir()] == ['mine']


def full(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, 'No space left on device')


def test_a_full_disk_ends_a_bag_that_can_be_read(tmp_path, monkeypatch):
    sensors, scenario = simulated(generic('a', 100.0))
    flushed = []

    def flush(self, **options):
        if flushed:
            monkeypatch.setattr(type(self._file), '_append', full)
        flushed.append(1)
        return original(self, **options)

    original = BagWriter.flush
    monkeypatch.setattr(BagWriter, 'flush', flush)
    with pytest.raises(RecordingError, match=r'bag: the disk is full; .* 800 messages') as caught:
        recording.write_bag(tmp_path / 'bag', sensors, scenario, 30.0)
    assert '\n' not in str(caught.value)


def test_a_full_disk_ends_columns_with_one_line(tmp_path, monkeypatch):
    sensors, scenario = simulated(generic('a', 100.0))
    monkeypatch.setattr(ColumnWriter, 'write', full)
    with pytest.raises(RecordingError, match='out: the disk is full') as caught:
        recording.write_columns(tmp_path / 'out', sensors, scenario, 30.0)
    assert '\n' not in str(caught.value)


def test_frequencies_above_half_the_rate_are_said(tmp_path):
    folding = {'acceleration': {'noise_density': '1 mg/√Hz', 'low_pass': '20 Hz'}}
    sensors, _ = simulated(
        generic('slow', 100.0), generic('soft', 100.0, **folding), generic('fast', 5000.0),
        scenario='random',
    )  # fmt: skip
    remarks = [sensor.remarks() for sensor in sensors]
    assert '200 to 2000 Hz goes above half its rate (50 Hz); it has no low-pass' in remarks[0][0]
    assert 'what its low-pass leaves' in remarks[1][0]
    assert remarks[2] == []


def test_an_empty_slice_of_a_slow_sensor_is_no_trouble(tmp_path):
    sensors, scenario = simulated(generic('a', 0.2), generic('b', 10.0))
    counts = recording.write_bag(tmp_path / 'bag', sensors, scenario, 20.0)
    assert counts == {'/bench/a/imu/data_raw': 4, '/bench/b/imu/data_raw': 200}
    assert isinstance(sensors[0].sources[0].samples_until(0), Samples)
    assert Path(tmp_path / 'bag' / 'truth.json').is_file()
