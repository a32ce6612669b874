# SPDX-License-Identifier: Apache-2.0
"""`imu-bench doctor` as a user sees it."""

import json

from imu_bench.cli.main import main
from imu_bench.doctor import machine
from imu_bench.doctor.machine import Bus
import pytest


@pytest.fixture
def bare(monkeypatch):
    """Give a machine without any bus."""
    monkeypatch.setattr(machine, 'buses', list)


@pytest.fixture
def sensor_file(tmp_path):
    """Give what writes a bench of one sensor."""

    def write(**parameters):
        lines = [f'    {key}: {json.dumps(value)}' for key, value in parameters.items()]
        text = '\n'.join(['/**:', '  ros__parameters:', *lines])
        (tmp_path / 'one.yaml').write_text(text + '\n')
        path = tmp_path / 'bench.yaml'
        path.write_text('name: small\nsensors:\n  - file: one.yaml\n')
        return str(path)

    return write


def test_a_machine_without_buses_gets_one_clear_statement(bare, capsys):
    assert main(['doctor']) == 0
    shown = capsys.readouterr().out
    assert shown.startswith('No I²C, SPI or serial bus on this machine: sensors can only be')
    assert 'Threads that read a sensor' in shown


@pytest.mark.slow
def test_a_bench_of_emulated_sensors_is_complete_and_has_a_load(bare, capsys, sensor_file):
    bench = sensor_file(driver='bno055', backend='emulated', bus='i2c-1')
    assert main(['doctor', bench, '--i2c-hz', '100000']) == 0
    shown = capsys.readouterr().out
    assert 'emulated: needs no hardware' in shown
    assert 'i2c-1, 100 kHz (given): busy 138 %' in shown


@pytest.mark.slow
def test_a_bench_that_lacks_something_is_a_fault_and_says_what_to_do(
    bare, capsys, sensor_file, monkeypatch
):
    monkeypatch.setenv('COLUMNS', '200')
    bench = sensor_file(driver='mpu9250', backend='hardware', bus='i2c-251')
    assert main(['doctor', bench]) == 1
    shown = capsys.readouterr().out
    assert 'MISSING' in shown
    assert 'there is no such device' in shown
    assert 'i2c_arm' in shown


@pytest.mark.slow
def test_a_full_bus_is_said_to_be_full_with_what_helps(bare, capsys, sensor_file):
    bench = sensor_file(driver='mpu9250', backend='emulated', bus='i2c-1')
    assert main(['doctor', bench, '--i2c-hz', '50000']) == 0
    shown = capsys.readouterr().out
    assert 'one does NOT keep its rate on this bus' in shown
    assert 'i2c_arm_baudrate=400000' in shown


def test_json_is_for_machines(bare, capsys, sensor_file):
    file = sensor_file(driver='bno055', backend='emulated', bus='serial')
    assert main(['doctor', file, '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found['schema'], found['ok']) == ('imu_bench.doctor/1', True)
    (share,) = found['loads'][0]['shares']
    assert (share['nominal_hz'], share['predicted_hz'], share['keeps_rate']) == (100, 100, True)


def test_permissions_come_with_what_to_do(monkeypatch, capsys):
    closed = Bus('/dev/i2c-1', 'i2c', 'bcm2835', 'i2c', False, 100e3)
    monkeypatch.setattr(machine, 'buses', lambda: [closed])
    assert main(['doctor']) == 0
    shown = capsys.readouterr().out
    assert 'may NOT open it' in shown
    assert '/dev/i2c-1: sudo usermod -aG i2c $USER' in shown


def pi_with(monkeypatch, *buses, model='Raspberry Pi 4 Model B Rev 1.4'):
    made = [Bus(f'/dev/{name}', kind, '', kind, usable, 0.0) for name, kind, usable in buses]
    monkeypatch.setattr(machine, 'buses', lambda: made)
    monkeypatch.setattr(machine, 'model', lambda: model)


@pytest.mark.parametrize(
    ('buses', 'lacking'),
    [
        ([], {'i2c_arm', 'spi'}),
        ([('ttyAMA0', 'serial', True)], {'i2c_arm', 'spi'}),
        ([('i2c-1', 'i2c', False)], {'spi'}),
        ([('i2c-1', 'i2c', False), ('spidev0.0', 'spi', False)], set()),
    ],
)
def test_a_raspberry_pi_is_told_which_lines_its_config_lacks(monkeypatch, capsys, buses, lacking):
    pi_with(monkeypatch, *buses)
    assert main(['doctor']) == 0
    shown = capsys.readouterr().out
    for line in ('i2c_arm', 'spi'):
        assert (f'dtparam={line}=on into /boot/firmware/config.txt' in shown) == (line in lacking)


@pytest.mark.parametrize('arguments', [['doctor', '--no-probe'], ['doctor']])
def test_of_buses_that_nobody_was_asked_on_nothing_is_said(monkeypatch, capsys, arguments):
    pi_with(monkeypatch, ('i2c-1', 'i2c', '--no-probe' in arguments), ('ttyAMA0', 'serial', True))
    assert main(arguments) == 0
    assert 'Nothing answers' not in capsys.readouterr().out


def test_a_full_bus_is_not_made_faster_for_a_sensor_that_stretches_its_clock(
    monkeypatch, capsys, sensor_file
):
    pi_with(monkeypatch)
    bench = sensor_file(driver='bno055', backend='hardware', bus='i2c-1')
    assert main(['doctor', bench, '--i2c-hz', '50000']) == 1
    shown = capsys.readouterr().out
    assert 'stretches the clock' in shown
    assert 'i2c_arm_baudrate=400000' not in shown
    assert 'Give one its serial line: it holds the clock after every byte' in shown


@pytest.mark.parametrize('speed', ['0', 'fast', '-1'])
def test_an_impossible_clock_is_wrong_usage(speed):
    with pytest.raises(SystemExit) as caught:
        main(['doctor', '--i2c-hz', speed])
    assert caught.value.code == 2


def test_a_wrong_bench_is_an_error_in_one_line(capsys):
    assert main(['doctor', 'no_such_bench']) == 1
    assert 'no_such_bench' in capsys.readouterr().err


def test_a_bench_at_rest_is_a_table_json_and_an_exit_code(capsys, sensor_file):
    file = sensor_file(driver='iim42652', backend='emulated', rate_hz=100.0)
    assert main(['doctor', '--check', file, '--duration', '10s']) == 0
    shown = capsys.readouterr().out
    assert 'gravity' in shown
    assert 'one, mounting: the bench does not say; z points up: give its entry up: z.' in shown
    tilted = {'driver': 'iim42652', 'backend': 'emulated', 'rate_hz': 100.0}
    file = sensor_file(**tilted, **{'simulation.faults': ['unplugged 0 100']})
    assert main(['doctor', '--check', file, '--json', '--duration', '5s']) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found['bench'], found['ok']) == ('small', False)
    assert main(['doctor', '--check']) == 1
    assert 'check what? Give a bench' in capsys.readouterr().err
