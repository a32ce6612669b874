# SPDX-License-Identifier: Apache-2.0
"""
Sensors that the kernel reads, on a tree of files as the kernel makes one.

What is in the buffer is encoded here, bit by bit from text, and not by the code that decodes it.
"""

import itertools
import math
import os
import struct
import time
from types import SimpleNamespace

from imu_bench import bench
from imu_bench.acquisition import Acquisition
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.iio.records import Element, Layout
from imu_bench.bus.iio.sensor import IioSensor, SETTINGS
from imu_bench.bus.iio.tree import devices, IioDevice
from imu_bench.config import sensor_from_parameters, SensorConfig
from imu_bench.doctor import checkup
from imu_bench.errors import BusError, ConfigError, NoAnswer, NotReady
import numpy as np
import pytest

START_NS = 1_000_000_000_000


# --- an encoder of its own: a value as a text of bits ------------------------------------
def encoded(type_, *values):
    """Return the bytes of one element: every bit is placed by hand."""
    order, rest = type_.split(':')
    kind, rest = rest[0], rest[1:]
    rest, _, shift = rest.partition('>>')
    bits, _, storage = rest.partition('/')
    storage, _, repeat = storage.partition('X')
    out = b''
    for value in values:
        if kind == 'f':
            text = struct.pack({'16': '>e', '32': '>f', '64': '>d'}[storage], value)
            cell = ''.join(f'{byte:08b}' for byte in text)
        else:
            # two's complement, with ones where nobody should look
            digits = f'{value % 2 ** int(bits):0{bits}b}'
            above = int(storage) - int(bits) - int(shift or 0)
            cell = '1' * above + digits + '1' * int(shift or 0)
        data = bytes(int(cell[k : k + 8], 2) for k in range(0, len(cell), 8))
        out += data if order == 'be' else data[::-1]
    assert len(values) == int(repeat or 1)
    return out


def padded(*parts):
    """Return a scan: each part at a multiple of its size, the whole at one of the largest."""
    out = b''
    for part in parts:
        while len(out) % len(part):
            out += b'\xee'
        out += part
    while len(out) % max(map(len, parts)):
        out += b'\xee'
    return out


INTEGERS = [
    f'{order}:{kind}{bits}/{storage}>>{shift}'
    for order, kind, (bits, storage, shift) in itertools.product(
        ('be', 'le'), ('s', 'u'),
        [(8, 8, 0), (12, 16, 4), (12, 16, 0), (16, 16, 0), (20, 24, 4), (24, 24, 0), (20, 32, 12),
         (24, 32, 8), (32, 32, 0), (48, 64, 2), (64, 64, 0), (1, 8, 7)],
    )
]  # fmt: skip


@pytest.mark.parametrize('type_', INTEGERS)
def test_integers_of_every_type(type_):
    element = Element.parse(type_)
    low, high = (
        (-(2 ** (element.bits - 1)), 2 ** (element.bits - 1) - 1)
        if element.kind == 's'
        else (0, 2**element.bits - 1)
    )
    values = sorted({low, low // 3, 0, min(1, high), high // 5, high})
    data = np.frombuffer(b''.join(encoded(type_, v) for v in values), np.uint8)
    found = element.decode(data.reshape(len(values), -1))
    assert found[:, 0].tolist() == values


@pytest.mark.parametrize('storage', [16, 32, 64])
@pytest.mark.parametrize('order', ['be', 'le'])
def test_floats(order, storage):
    type_ = f'{order}:f{storage}/{storage}>>0'
    values = [0.0, -1.5, 24.25]
    data = np.frombuffer(b''.join(encoded(type_, v) for v in values), np.uint8)
    assert Element.parse(type_).decode(data.reshape(3, -1))[:, 0].tolist() == values


def test_repetitions():
    type_ = 'le:s16/16X4>>0'
    data = np.frombuffer(encoded(type_, 1, -2, 3, -4), np.uint8).reshape(1, -1)
    assert Element.parse(type_).decode(data).tolist() == [[1, -2, 3, -4]]


@pytest.mark.parametrize(
    'text', ['', 'le:s16', 'me:s16/16>>0', 'le:s17/16>>0', 'le:s16/16>>1', 'le:s64/128>>0',
             'le:f24/24>>0', 'le:s12/12>>0', 'le:s0/8>>0'],
)  # fmt: skip
def test_a_type_that_is_not_known_is_refused(text):
    with pytest.raises(ConfigError, match='no type of a record'):
        Element.parse(text)


def test_elements_are_aligned_to_their_size():
    types = {'a': 'be:s16/16>>0', 'b': 'le:u8/8>>0', 'c': 'le:s32/32>>0', 't': 'le:s64/64>>0'}
    layout = Layout({name: Element.parse(text) for name, text in types.items()})
    scans = [(-2, 7, 70_000, 5), (300, 255, -1, -6)]
    data = b''.join(
        padded(*(encoded(text, v) for text, v in zip(types.values(), scan, strict=True)))
        for scan in scans
    )
    # 2, 1, one free, 4, and 8 at 8
    assert (layout.size, len(data)) == (16, 32)
    found = layout.decode(data)
    assert [tuple(found[name][k, 0] for name in types) for k in (0, 1)] == scans
    # a whole scan is aligned to its largest element, whatever comes last
    last = {'a': Element.parse('le:s64/64>>0'), 'b': Element.parse('le:u8/8>>0')}
    assert Layout(last).size == 16


# --- a tree ------------------------------------------------------------------------------
MPU = {
    'accel_x': 'be:s16/16>>0', 'accel_y': 'be:s16/16>>0', 'accel_z': 'be:s16/16>>0',
    'temp': 'be:s16/16>>0',
    'anglvel_x': 'be:s16/16>>0', 'anglvel_y': 'be:s16/16>>0', 'anglvel_z': 'be:s16/16>>0',
    'magn_x': 'be:s16/16>>0', 'magn_y': 'be:s16/16>>0', 'magn_z': 'be:s16/16>>0',
    'rot_quaternion': 'le:s16/16X4>>0',
    'timestamp': 'le:s64/64>>0',
}  # fmt: skip
FILES = {
    'name': 'mpu9250',
    'sampling_frequency': '200',
    'sampling_frequency_available': '10 20 50 100 200 500',
    'in_accel_scale': '0.000598',
    'in_anglvel_scale': '0.001064724',
    'in_magn_x_scale': '0.0015', 'in_magn_y_scale': '0.0015', 'in_magn_z_scale': '0.003',
    'in_temp_scale': '2.995178', 'in_temp_offset': '7011',
    'in_accel_mount_matrix': '0, 1, 0; -1, 0, 0; 0, 0, 1',
    'current_timestamp_clock': 'realtime',
    'buffer/enable': '0', 'buffer/length': '2',
}  # fmt: skip


class Tree:
    """A folder with sys and dev, and a pipe in the place of the device."""

    def __init__(self, root, files=FILES, channels=MPU, number=0):
        self.root = root
        self.folder = root / f'sys/bus/iio/devices/iio:device{number}'
        for name, text in files.items():
            self.write(name, text)
        for index, (name, type_) in enumerate(channels.items()):
            self.write(f'scan_elements/in_{name}_en', '0')
            self.write(f'scan_elements/in_{name}_index', str(index))
            self.write(f'scan_elements/in_{name}_type', type_)
        self.node = root / f'dev/iio:device{number}'
        self.node.parent.mkdir(parents=True, exist_ok=True)
        os.mkfifo(self.node)
        # both ways, so that nobody has to wait for the other
        self.pipe = os.open(self.node, os.O_RDWR | os.O_NONBLOCK)

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'{text}\n')

    def text(self, name):
        return (self.folder / name).read_text().strip()

    def send(self, data):
        os.write(self.pipe, data)

    def device(self, name='iio:device0'):
        return IioDevice(name, self.root)

    def sensor(self, clock=None, **settings):
        values = {setting.name: setting.default for setting in SETTINGS} | settings
        return IioSensor(self.device(), clock or SystemClock(), values)


@pytest.fixture
def tree(tmp_path):
    made = Tree(tmp_path)
    yield made
    os.close(made.pipe)


def scan(t_ns, accel=(0, 0, 16384), temp=0, anglvel=(0, 0, 0), magn=(0, 0, 0)):
    words = [encoded('be:s16/16', v) for v in (*accel, temp, *anglvel, *magn)]
    return padded(*words, encoded('le:s64/64', t_ns))


def test_what_there_is_is_listed(tree, tmp_path):
    assert devices(tmp_path) == {'iio:device0': 'mpu9250'}
    assert devices(tmp_path / 'nothing') == {}
    with pytest.raises(NoAnswer, match=r'iio:device7: no such device.*iio:device0 \(mpu9250\)'):
        tree.device('iio:device7')
    assert tree.device('mpu9250').name == 'iio:device0'


def test_it_is_set_up(tree):
    sensor = tree.sensor(rate_hz=100.0, buffer_s=2.0)
    assert sensor.identify() == 'mpu9250 (Linux IIO)'
    sensor.configure()
    assert tree.text('sampling_frequency') == '100'
    assert tree.text('current_timestamp_clock') == 'monotonic'
    assert tree.text('buffer/length') == '200'
    on = {name: tree.text(f'scan_elements/in_{name}_en') for name in MPU}
    assert on == {**dict.fromkeys(MPU, '1'), 'rot_quaternion': '0'}
    sensor.start()
    assert tree.text('buffer/enable') == '1'
    sensor.close()
    assert tree.text('buffer/enable') == '0'


def test_records_become_si(tree):
    sensor = tree.sensor()
    sensor.configure()
    sensor.start()
    now = time.monotonic_ns()
    tree.send(scan(now, (16384, -8192, 4096), 1000, (939, 0, -939), (100, 200, 300)))
    (run,) = sensor.read()
    # Documentation/ABI/testing/sysfs-bus-iio: (raw + offset)·scale in m/s², rad/s, G, m°C; the
    # matrix turns x of the chip to -y of the device
    np.testing.assert_allclose(
        run.acceleration, [[-8192 * 0.000598, -16384 * 0.000598, 4096 * 0.000598]]
    )
    np.testing.assert_allclose(run.angular_velocity, [[0.99977584, 0, -0.99977584]], rtol=1e-6)
    np.testing.assert_allclose(run.magnetic_field, [[15e-6, 30e-6, 90e-6]])
    np.testing.assert_allclose(run.temperature, [8011 * 2.995178e-3])
    # stamps are the kernel's, in the time of the bench
    assert abs(int(run.stamps[0]) - time.time_ns()) < 5_000_000_000
    assert sensor.edge == (0, int(run.stamps[-1]))
    assert sensor.read() == []


def test_a_record_that_is_not_whole_waits_for_its_rest(tree):
    sensor = tree.sensor()
    sensor.configure()
    sensor.start()
    data = scan(START_NS) + scan(START_NS + 5_000_000)
    tree.send(data[:40])
    assert [len(run) for run in sensor.read()] == [1]
    tree.send(data[40:])
    assert [len(run) for run in sensor.read()] == [1]


def test_what_the_kernel_lost_is_skipped(tree):
    sensor = tree.sensor()
    sensor.configure()
    sensor.start()
    at = [0, 1, 2, 6, 7, 9]
    tree.send(b''.join(scan(START_NS + 5_000_000 * k) for k in at))
    assert [len(run) for run in sensor.read()] == [3, 2, 1]
    assert sensor.skipped == {1: 3, 2: 1}
    assert sensor.counters['gaps'] == 2
    # and between two readings
    tree.send(scan(START_NS + 5_000_000 * 11))
    assert (len(sensor.read()), sensor.skipped) == (1, {0: 1})


def test_without_a_timestamp_the_time_of_reading_stands(tmp_path):
    channels = {name: MPU[name] for name in ('accel_x', 'accel_y', 'accel_z')}
    tree = Tree(tmp_path, channels=channels)
    sensor = tree.sensor()
    sensor.configure()
    sensor.start()
    before = time.time_ns()
    tree.send(b''.join(encoded('be:s16/16', v) for v in (1, 2, 3, 4, 5, 6)))
    (run,) = sensor.read()
    assert np.diff(run.stamps).tolist() == [5_000_000]
    assert before - 5_000_000_000 < run.stamps[-1] < time.time_ns() + 5_000_000_000
    assert sensor.edge is None
    os.close(tree.pipe)


@pytest.mark.parametrize(
    ('gone', 'settings', 'error', 'says'),
    [
        ('sampling_frequency', {}, NotReady, 'says nothing of its rate.*set rate_hz'),
        ('scan_elements', {}, NoAnswer, 'mpu9250 has no buffer'),
    ],
)
def test_what_it_lacks_is_said(tree, gone, settings, error, says):
    path = tree.folder / gone
    if path.is_dir():
        for file in path.iterdir():
            file.unlink()
    else:
        path.unlink()
    with pytest.raises(error, match=says):
        tree.sensor(**settings).configure()


def test_a_rate_that_is_not_kept_is_said(tree, monkeypatch):
    # the kernel takes the next one that it has
    real = IioDevice.set
    monkeypatch.setattr(
        IioDevice, 'set', lambda self, file, value: real(
            self, file, '200' if file == 'sampling_frequency' else value
        ),
    )  # fmt: skip
    with pytest.raises(BusError, match=r'holds 200 Hz; allowed: 10 20 50 100 200 500'):
        tree.sensor(rate_hz=300.0).configure()


def test_a_trigger_that_is_missing_is_said(tree, monkeypatch):
    tree.write('trigger/current_trigger', '')
    trigger = tree.folder.parent / 'trigger0'
    trigger.mkdir()
    (trigger / 'name').write_text('mpu9250-dev0\n')
    real = IioDevice.set

    def refusing(self, file, value):
        if file == 'buffer/enable' and value and not self.get('trigger/current_trigger'):
            raise BusError('Invalid argument')
        real(self, file, value)

    monkeypatch.setattr(IioDevice, 'set', refusing)
    sensor = tree.sensor()
    sensor.configure()
    with pytest.raises(NotReady, match='needs a trigger; set trigger to one of: mpu9250-dev0'):
        sensor.start()
    sensor = tree.sensor(trigger='mpu9250-dev0')
    sensor.configure()
    sensor.start()
    assert tree.text('trigger/current_trigger') == 'mpu9250-dev0'


def test_a_file_that_may_not_be_written_says_what_to_do(tree, monkeypatch):
    def refused(self, *arguments, **options):
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setattr(type(tree.folder), 'write_text', refused)
    with pytest.raises(BusError, match='udev rule'):
        tree.sensor().configure()


def test_a_device_that_goes_is_named_and_counted(tree):
    sensor = tree.sensor()
    sensor.configure()
    sensor.start()
    os.close(sensor._file)
    with pytest.raises(BusError, match='iio:device0'):
        sensor.read()
    assert sensor.counters['bus_errors'] == 1
    sensor._file = -1


def test_a_matrix_that_is_none_is_refused(tree):
    tree.write('in_accel_mount_matrix', '1, 0; 0, 1')
    with pytest.raises(ConfigError, match=r'in_accel_mount_matrix.*no matrix'):
        tree.sensor().configure()


def test_the_acquisition_keeps_the_time_of_the_kernel(tree):
    clock = SystemClock()
    acquisition = Acquisition(tree.sensor(clock), clock, name='kernel')
    acquisition.prepare()
    acquisition.step()
    start = time.monotonic_ns() - 4_000_000_000
    period = round(5e6 / 1.001)
    true = [start + k * period for k in range(600)]
    for k in range(0, 600, 20):
        late = 40_000 * (k % 7)
        tree.send(b''.join(scan(t + late * (t == true[k])) for t in true[k : k + 20]))
        acquisition.step()
    acquisition.finish()
    stamps = np.concatenate([run.stamps for run in acquisition.drain()])
    shift = clock.now_ns() - time.monotonic_ns()
    off = stamps - np.array(true) - shift
    assert len(stamps) == 600
    assert math.sqrt(np.mean(np.square(off[200:].astype(float)))) < 20e3
    assert acquisition.stats.lost == 0


def test_a_sensor_of_the_kernel_stands_in_a_file(tree, tmp_path, monkeypatch):
    monkeypatch.setattr('imu_bench.bus.iio.tree.ROOT', tmp_path)
    path = tmp_path / 'second.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    driver: iio\n    backend: iio\n    bus: mpu9250\n'
        '    rate_hz: 50.0\n'
    )
    sensor = bench.load_sensor(path)
    assert bench.label(sensor) == 'iio mpu9250'
    acquisition = bench.build(sensor)
    assert acquisition.prepare() == 'mpu9250 (Linux IIO)'
    assert tree.text('sampling_frequency') == '50'
    acquisition.close()


@pytest.mark.parametrize(
    'given',
    [
        {'driver': 'mpu9250', 'backend': 'iio'},
        {'driver': 'iio', 'backend': 'hardware'},
        {'driver': 'iio', 'backend': 'emulated'},
    ],
)
def test_backend_and_driver_go_together(given):
    with pytest.raises(ConfigError, match='the kernel reads it: backend: iio, driver: iio'):
        sensor_from_parameters('a', {**given, 'bus': 'x'}, settings_of=bench.settings_of)


def test_its_device_has_to_be_named():
    with pytest.raises(ConfigError, match=r'bus: missing; a iio sensor needs one.*iio:device0'):
        sensor_from_parameters(
            'a', {'driver': 'iio', 'backend': 'iio'}, settings_of=bench.settings_of
        )


def test_the_doctor_says_what_the_kernel_has(tree, tmp_path, monkeypatch):
    monkeypatch.setattr('imu_bench.bus.iio.tree.ROOT', tmp_path)
    sensors = tuple(
        SensorConfig(name, 'iio', 'iio', bus) for name, bus in (('a', 'mpu9250'), ('b', 'bno055'))
    )
    checks = checkup._checks(sensors)
    assert [check.ok for check in checks] == [True, False]
    assert checks[0].found.startswith('iio:device0 mpu9250: accel_x, accel_y')
    assert 'there are: iio:device0 (mpu9250)' in checks[1].found
    assert checkup.examine(probe=False).kernel == {'iio:device0': 'mpu9250'}
    assert checkup._bench_buses(SimpleNamespace(sensors=sensors), (), 400e3) == []
