# SPDX-License-Identifier: Apache-2.0
"""A machine and a bench together."""

import json

from imu_bench import bench
from imu_bench.config import BenchConfig, sensor_from_parameters
from imu_bench.doctor import checkup, machine, probing
from imu_bench.doctor.machine import Bus
from imu_bench.errors import ConfigError, NoAnswer
from imu_bench.simulation.clock import SimulatedClock
import pytest


def sensor(name, driver, **settings):
    given = {'driver': driver, **settings}
    return sensor_from_parameters(name, given, settings_of=bench.settings_of)


def hardware(name, driver, bus, **settings):
    return sensor(name, driver, backend='hardware', bus=bus, **settings)


@pytest.fixture
def pi(monkeypatch):
    """Give a Raspberry Pi with a bus at 400 kHz, on which everything answers."""
    bus = Bus('/dev/i2c-1', 'i2c', 'bcm2835', 'i2c', True, 400e3)
    monkeypatch.setattr(machine, 'buses', lambda: [bus])
    monkeypatch.setattr(machine, 'model', lambda: 'Raspberry Pi 4 Model B')
    monkeypatch.setattr(probing, 'scan', lambda bus: [])
    monkeypatch.setattr(probing, 'check', lambda sensor: f'a {sensor.driver}')


@pytest.mark.slow
def test_sensors_of_one_bus_share_it_at_the_speed_of_the_device_tree(pi):
    config = BenchConfig(
        'two',
        sensors=(hardware('a', 'mpu9250', 'i2c-1'), hardware('b', 'lsm303dlhc', '/dev/i2c-1')),
    )
    found = checkup.examine(config)
    (load,) = found.loads
    assert (load.name, load.speed_hz, load.speed_source) == ('i2c-1', 400e3, 'device tree')
    assert [share.name for share in load.shares] == ['a', 'b']
    assert load.busy == pytest.approx(sum(share.busy for share in load.shares))
    assert all(share.keeps_rate for share in load.shares)
    assert found.ok


@pytest.mark.slow
def test_a_sensor_that_stretches_the_clock_is_warned_about_on_a_pi(pi, monkeypatch):
    config = BenchConfig('one', sensors=(hardware('b', 'bno055', 'i2c-1'),))
    (found,) = checkup.examine(config).sensors
    assert 'stretches the clock' in found.warnings[0]
    monkeypatch.setattr(machine, 'model', lambda: 'a PC')
    (found,) = checkup.examine(config).sensors
    assert found.warnings == ()


def test_what_is_missing_makes_the_bench_not_ok(pi, monkeypatch):
    def nobody(sensor):
        raise NoAnswer(f'{sensor.bus}: nothing answers')

    monkeypatch.setattr(probing, 'check', nobody)
    config = BenchConfig('one', sensors=(hardware('b', 'bno055', 'i2c-1'),))
    found = checkup.examine(config)
    assert not found.ok
    assert found.sensors[0].found == 'i2c-1: nothing answers'


@pytest.mark.slow
def test_two_sensors_at_one_place_are_one_too_many(pi):
    config = BenchConfig(
        'two',
        sensors=(
            hardware('a', 'mpu9250', 'i2c-1', address=0x68),
            hardware('b', 'iim42652', '/dev/i2c-1'),
            hardware('c', 'iim42652', 'i2c-1', address=0x69),
        ),
    )
    found = {check.name: check for check in checkup.examine(config).sensors}
    assert [name for name, check in found.items() if not check.ok] == ['b']
    assert found['b'].found.startswith('a is at the same place')


@pytest.mark.slow
def test_emulated_sensors_that_share_a_wire_need_places_of_their_own_too():
    shared = {'backend': 'emulated', 'bus': 'i2c-1'}
    two = (sensor('a', 'mpu9250', **shared), sensor('b', 'mpu9250', **shared))
    found = checkup.examine(BenchConfig('two', sensors=two), probe=False).sensors
    assert [one.name for one in found if not one.ok] == ['b']
    wrong = hardware('c', 'mpu9250', 'i2c-1', address=0x30)
    with pytest.raises(ConfigError, match='c: address 0x30 is not one of this chip'):
        checkup.examine(BenchConfig('one', sensors=(wrong,)), probe=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('first', 'second', 'clash'),
    [
        (('lsm303dlhc', {}), ('lsm9ds1', {'address': 0x6B}), True),  # both at 0x1E
        (('lsm303dlhc', {}), ('lsm9ds1', {'address': 0x6B, 'second_address': 0x1C}), False),
        (('mpu9250', {}), ('mpu9250', {'address': 0x69}), False),
        *(
            (
                ('mpu9250', {'magnetometer_bypass': True}),
                ('mpu9250', {'address': 0x69, 'magnetometer_bypass': bypass}),
                bypass,  # both at 0x0C
            )
            for bypass in (False, True)
        ),
    ],
)
def test_second_dies_need_places_of_their_own_where_they_are_on_the_bus(pi, first, second, clash):
    two = [
        hardware(name, driver, 'i2c-1', **settings)
        for name, (driver, settings) in zip('ab', (first, second), strict=True)
    ]
    found = checkup.examine(BenchConfig('two', sensors=tuple(two))).sensors
    assert [one.name for one in found if not one.ok] == ['b'] * clash


@pytest.mark.slow
def test_wires_are_those_of_the_sensors_and_their_speeds_are_said_to_be_known_or_not():
    config = BenchConfig(
        'many',
        sensors=(
            hardware('tilt', 'scl3300', 'spidev0.0', rate_hz=100.0),
            hardware('next', 'scl3300', 'spidev0.1', rate_hz=100.0),
            hardware('slow', 'bno055', 'i2c-7'),
            sensor('own', 'bno055', backend='emulated'),
            sensor('usb', 'mti300', backend='emulated', baud=0),
            sensor('mine', 'generic', backend='emulated', rate_hz=100.0),
        ),
    )  # fmt: skip
    loads = {load.name: load for load in checkup.examine(config, probe=False).loads}
    assert {name: (load.speed_hz, load.speed_source) for name, load in loads.items()} == {
        'spidev0': (2e6, 'usual'),
        'i2c-7': (100e3, 'assumed; give --i2c-hz'),
        'emulated i2c of own': (400e3, 'emulated'),
        'emulated serial of usb': (10e6, 'USB'),
    }
    assert len(loads['spidev0'].shares) == 2
    # without hardware nothing is there
    found = checkup.examine(config, probe=False)
    assert [s.name for s in found.sensors if not s.ok] == ['tilt', 'next', 'slow']


def test_everything_is_json(pi):
    config = BenchConfig('one', sensors=(sensor('axis', 'mtn1100', backend='emulated'),))
    document = checkup.examine(config).as_json()
    assert json.loads(json.dumps(document, allow_nan=False))['schema'] == 'imu_bench.doctor/1'
    assert document['buses'][0]['advice'] == ''


def test_a_sensor_that_is_played_needs_no_wire(pi, tmp_path):
    path = tmp_path / 'mine.wire'
    acquisition = bench.build(
        sensor('a', 'mpu9250', backend='emulated', wire_recording=str(path)), SimulatedClock()
    )
    acquisition.prepare()
    acquisition.close()
    (tmp_path / 'a.yaml').write_text(
        '/**:\n  ros__parameters:\n    backend: recorded\n    bus: i2c-1\n'
        f'    wire_recording: {path}\n'
    )
    (tmp_path / 'bench.yaml').write_text('name: one\nsensors:\n  - file: a.yaml\n')
    found = checkup.examine(bench.load_bench(tmp_path / 'bench.yaml'))
    assert found.ok
    assert found.loads == ()
    assert found.sensors[0].found == f'plays {path}'
    assert found.sensors[0].label.startswith('recorded emulated mpu9250, ')
