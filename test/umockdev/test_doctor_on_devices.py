# SPDX-License-Identifier: Apache-2.0
"""The doctor, the claim of a chip and missing permissions, on device files of umockdev."""

import json
import os
from pathlib import Path
import shutil
import signal
import struct
import time

from imu_bench.drivers import load, names
import pytest
import yaml

pytestmark = [pytest.mark.slow]

DOCTOR = ('-m', 'imu_bench.cli.main', 'doctor')


def run(desk, *arguments):
    """Return exit code and output of a program that sees the device files."""
    process = desk.start(*arguments)
    output, _ = process.communicate()
    return process.returncode, output


def bench_of(folder, **sensors):
    """Write a bench of hardware; return its file."""
    for name, (driver, bus, settings) in sensors.items():
        parameters = {'driver': driver, 'backend': 'hardware', 'bus': bus, **settings}
        document = {'/**': {'ros__parameters': parameters}}
        (folder / f'{name}.yaml').write_text(yaml.safe_dump(document))
    entries = [{'file': f'{name}.yaml'} for name in sensors]
    (folder / 'bench.yaml').write_text(yaml.safe_dump({'name': 'desk', 'sensors': entries}))
    return folder / 'bench.yaml'


@pytest.fixture(scope='module')
def scanned(desk):
    """Give what the doctor finds on the desk."""
    code, output = run(desk, *DOCTOR, '--json')
    assert code == 0, output
    return json.loads(output)


@pytest.mark.parametrize('name', [n for n in names() if {'i2c', 'spi'} & set(load(n).bus_kinds)])
def test_every_driver_is_found_on_its_bus_without_a_line_for_it(desk, scanned, name, tmp_path):
    driver = load(name)
    devices = {bus['device'] for bus in scanned['buses']}
    number = sorted(names()).index(name) + 10
    if 'i2c' in driver.bus_kinds:
        assert f'/dev/i2c-{number}' in devices
        first = [a for a in scanned['answers'] if a['device'] == f'/dev/i2c-{number}']
        assert {name} <= {who for answer in first for who in answer['drivers']}
        addresses = {a['address'] for a in first}
        assert driver.wiring[''].i2c_addresses[0] in addresses
    if 'spi' in driver.bus_kinds and driver.wiring[''].spi_read != 0x80:
        # others would take the question for a write: asked where a bench says so
        bench = bench_of(tmp_path, it=(name, f'spidev{number}.0', {}))
        code, output = run(desk, *DOCTOR, bench, '--json', '--no-probe')
        assert (code, json.loads(output)['sensors'][0]['found']) == (0, driver.title), output
        assert not [a for a in scanned['answers'] if a['device'] == f'/dev/spidev{number}.0']
    elif 'spi' in driver.bus_kinds:
        (answer,) = (a for a in scanned['answers'] if a['device'] == f'/dev/spidev{number}.0')
        assert (answer['state'], answer['drivers']) == ('known', [name])


def test_two_chips_of_one_bus_are_told_apart(scanned):
    found = {
        a['address']: (a['what'], a['drivers'])
        for a in scanned['answers']
        if a['device'] == '/dev/i2c-1' and a['state'] == 'known'
    }
    assert found[0x68] == ('MPU-9250', ['mpu9250'])
    assert found[0x69] == ('TDK InvenSense IIM-42652', ['iim42652'])


def test_a_bench_that_is_complete_and_one_that_is_not(desk, tmp_path):
    tilt = desk.device_of('scl3300')
    good = {'left': ('mpu9250', 'i2c-1', {}), 'tilt': ('scl3300', tilt, {'rate_hz': 100.0})}
    code, output = run(desk, *DOCTOR, bench_of(tmp_path, **good), '--json', '--no-probe')
    found = json.loads(output)
    assert (code, found['ok']) == (0, True), output
    assert {s['name']: s['found'] for s in found['sensors']} == {
        'left': 'MPU-9250', 'tilt': 'Murata SCL3300-D01',
    }  # fmt: skip
    assert {load['name']: load['speed_source'] for load in found['loads']} == {
        'i2c-1': 'assumed; give --i2c-hz', tilt.partition('.')[0]: 'usual',
    }  # fmt: skip
    bad = good | {
        'right': ('mpu9250', 'i2c-1', {'address': 0x69}), 'far': ('lsm9ds1', 'i2c-99', {}),
        'gone': ('bno055', 'i2c-1', {}),
    }  # fmt: skip
    code, output = run(desk, *DOCTOR, bench_of(tmp_path, **bad))
    assert code == 1
    for text in ('MISSING', 'holds 0x6F', 'there is no such device', 'nothing answers', 'i2c_arm'):
        assert text in ' '.join(output.split()) or text in output


def test_a_chip_belongs_to_one_program_until_that_dies(desk):
    first = desk.client('mpu9250', 'i2c-1', 0x68, 10**9)
    try:
        for _ in range(50):
            found = desk.read('mpu9250', 'i2c-1', 0x68, 10)
            if found.get('kind'):
                break
        assert found['kind'] == 'ChipInUse'
        assert f'/dev/i2c-1 0x68: process {first.pid} (' in found['text']
        assert desk.read('iim42652', 'i2c-1', 0x69, 100)['samples'] >= 100
        _, output = run(desk, *DOCTOR, '--json')
        states = {(a['device'], a['address']): a['state'] for a in json.loads(output)['answers']}
        assert states['/dev/i2c-1', 0x68] == 'in use'
    finally:
        first.kill()
        first.communicate()
    assert desk.read('mpu9250', 'i2c-1', 0x68, 10)['samples'] >= 10


@pytest.fixture
def closed_device(desk):
    """Give a device that nobody may open, and its file."""
    name = desk.device_of('mpu9250')
    file = Path(desk.environment['UMOCKDEV_DIR']) / 'dev' / name
    mode = file.stat().st_mode
    file.chmod(0)
    yield name, file, mode
    file.chmod(mode)


def without_override():
    """Return what starts a program as somebody whom permissions bind."""
    if os.geteuid() != 0:
        return []
    if shutil.which('setpriv') is None:
        pytest.fail('apt-get install util-linux: setpriv takes from root what root may')
    return ['setpriv', '--bounding-set=-dac_override,-dac_read_search', '--inh-caps=-all']


def test_the_doctor_says_what_to_do_about_a_permission(desk, closed_device, tmp_path):
    name, _, _ = closed_device
    bench = bench_of(tmp_path, left=('mpu9250', name, {}))
    process = desk.start(*DOCTOR, bench, '--no-probe', prefix=without_override())
    output, _ = process.communicate()
    assert process.returncode == 1, output
    assert 'may NOT open it' in output
    assert 'usermod -aG i2c' in output


@pytest.mark.ros
def test_a_node_without_permission_waits_and_comes_up_when_it_is_given(desk, closed_device):
    name, file, mode = closed_device
    process = desk.start(
        '-m', 'imu_bench.nodes.sensor_node', '--ros-args', '-p', 'driver:=mpu9250',
        '-p', 'backend:=hardware', '-p', f'bus:={name}', prefix=without_override(),
    )  # fmt: skip
    try:
        assert 'usermod -aG i2c' in process.stdout.readline()
        assert process.poll() is None
        file.chmod(mode)
        assert f'hardware mpu9250 {name}' in process.stdout.readline()
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate()
    assert process.returncode == 0, output


# Documentation/ABI/testing/sysfs-bus-iio of the kernel: three words of 2 bytes and a stamp
ELEMENTS = {'accel_x': 's16/16', 'accel_y': 's16/16', 'accel_z': 's16/16', 'timestamp': 's64/64'}
KERNELS = {
    'name': 'adxl355', 'sampling_frequency': '100', 'in_accel_scale': '0.001',
    'current_timestamp_clock': 'realtime', 'buffer/enable': '0', 'buffer/length': '2',
    **{f'scan_elements/in_{name}_en': '0' for name in ELEMENTS},
    **{f'scan_elements/in_{name}_index': str(k) for k, name in enumerate(ELEMENTS)},
    **{f'scan_elements/in_{name}_type': f'le:{bits}>>0' for name, bits in ELEMENTS.items()},
}  # fmt: skip
READ = """
import sys
from imu_bench import bench
from imu_bench.bus.clock import SystemClock
acquisition = bench.build(bench.load_sensor(sys.argv[1]))
print(acquisition.prepare(), flush=True)
runs = []
while not runs:
    SystemClock().sleep_until(acquisition.step())
    runs = acquisition.drain()
acquisition.close()
print(runs[0].acceleration[0, 2])
"""


@pytest.fixture
def kernels(desk):
    """Put a device that a driver of the kernel has bound on the desk; give the pipe into it."""
    root = Path(desk.environment['UMOCKDEV_DIR'])
    folder = root / 'sys/bus/iio/devices/iio:device0'
    for name, text in KERNELS.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f'{text}\n')
    os.mkfifo(root / 'dev/iio:device0')
    pipe = os.open(root / 'dev/iio:device0', os.O_RDWR | os.O_NONBLOCK)
    yield pipe
    os.close(pipe)
    (root / 'dev/iio:device0').unlink()
    shutil.rmtree(folder.parents[1])


def test_what_a_driver_of_the_kernel_has_bound_is_found_and_read(desk, kernels, tmp_path):
    parameters = {'driver': 'iio', 'backend': 'iio', 'bus': 'adxl355'}
    sensor = tmp_path / 'second.yaml'
    sensor.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
    (tmp_path / 'bench.yaml').write_text('{name: desk, sensors: [{file: second.yaml}]}')
    code, output = run(desk, *DOCTOR, tmp_path / 'bench.yaml', '--json', '--no-probe')
    found = json.loads(output)
    assert (code, found['kernel']) == (0, {'iio:device0': 'adxl355'})
    assert found['sensors'][0]['found'] == f'iio:device0 adxl355: {", ".join(ELEMENTS)}'
    process = desk.start('-c', READ, sensor)
    assert process.stdout.readline() == 'adxl355 (Linux IIO)\n', process.communicate()[0]
    os.write(kernels, struct.pack('<hhh2xq', 0, 0, -9807, time.monotonic_ns()))
    assert process.communicate()[0] == '-9.807\n'
