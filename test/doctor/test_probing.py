# SPDX-License-Identifier: Apache-2.0
"""Who is asked what, and that nobody is ever written to."""

from imu_bench.config import SensorConfig
from imu_bench.doctor import probing
from imu_bench.doctor.machine import Bus
from imu_bench.errors import BusBusy, IdentityError, NoAnswer, NotReady
import pytest

I2C = Bus('/dev/i2c-1', 'i2c', '', 'i2c', True, 0.0)
SPI = Bus('/dev/spidev0.0', 'spi', '', 'spi', True, 0.0)
SERIAL = Bus('/dev/ttyUSB0', 'serial', '', 'dialout', True, 0.0)


@pytest.fixture
def desk(monkeypatch):
    """Give a desk whose chips are {(address, register): bytes}; what was asked is kept."""

    class Desk:
        error = None

    class Wire:
        def __init__(self, address):
            self.name, self.address = f'/dev/i2c-1 0x{address:02X}', address

        def read(self, register, length):
            Desk.asked.append((self.address, register))
            if Desk.error is not None:
                raise Desk.error
            held = {at: data for (where, at), data in Desk.chips.items() if where == self.address}
            if not held and self.address:
                raise NoAnswer('nobody')
            return held.get(register, bytes(length) if self.address else b'\xff' * length)

        def write(self, register, data):
            raise AssertionError(f'0x{register:02X} is written')

        def close(self):
            pass

    Desk.chips, Desk.asked = {}, []
    monkeypatch.setattr(
        probing, 'I2cBus', lambda device, address, wiring, patience_s: Wire(address)
    )
    monkeypatch.setattr(probing, 'SpiFrameBus', lambda device, wiring, patience_s: None)
    monkeypatch.setattr(probing, 'SpiRegisterBus', lambda frames, wiring: Wire(0))
    monkeypatch.setattr(
        probing, 'open_bus', lambda *_, **__: {'': Wire(0x68), 'magnetometer': Wire(0x0C)}
    )
    monkeypatch.setattr(probing, 'kernel_driver', lambda device, address: '')
    return Desk


def test_chips_are_known_by_the_identities_of_their_drivers(desk):
    desk.chips = {(0x69, 0x75): b'\x71', (0x28, 0x00): b'\xa0', (0x1E, 0x0A): b'H43'}
    found = {answer.address: answer for answer in probing.scan(I2C)}
    assert sorted(found) == [0x1E, 0x28, 0x69]
    assert found[0x69].what == 'MPU-9250'
    assert found[0x69].drivers == ('mpu9250',)
    assert found[0x28].drivers == ('bno055',)
    assert found[0x1E].drivers == ('lsm303dlhc',)
    assert {answer.state for answer in found.values()} == {'known'}


def test_nobody_is_asked_at_an_address_that_no_driver_has(desk):
    assert probing.scan(I2C) == []
    asked = {address for address, _ in desk.asked}
    assert {0x68, 0x69, 0x28, 0x19} <= asked
    assert asked.isdisjoint(range(0x50, 0x58))  # memories
    assert asked.isdisjoint(range(0x30, 0x38))


def test_a_relative_and_a_stranger_are_named_as_such(desk):
    desk.chips = {(0x68, 0x75): b'\x70', (0x6A, 0x0F): b'\x33', (0x48, 0x00): b'\x12\x34'}
    found = {answer.address: answer for answer in probing.scan(I2C)}
    assert 'MPU-6500, often sold as MPU-9250, without a magnetometer' in found[0x68].what
    assert found[0x6A].what == '0x0F holds 0x33, which is not ST LSM9DS1'
    assert 'without an identity register: mtn1100' in found[0x48].what
    assert {answer.state for answer in found.values()} == {'unknown'}


def test_what_the_kernel_has_is_left_alone(desk, monkeypatch):
    monkeypatch.setattr(
        probing, 'kernel_driver', lambda device, address: 'st_imu' if address == 0x6A else ''
    )
    (answer,) = probing.scan(I2C)
    assert (answer.address, answer.state) == (0x6A, 'kernel driver')
    assert 0x6A not in {address for address, _ in desk.asked}


def test_a_stuck_bus_is_asked_once(desk):
    desk.error = BusBusy('/dev/i2c-1: a line is stuck')
    (answer,) = probing.scan(I2C)
    assert (answer.address, answer.state, answer.what) == (None, 'failed', str(desk.error))
    assert len(desk.asked) == 1


def test_on_spi_an_open_line_is_nobody_and_a_chip_is_known(desk):
    assert probing.scan(SPI) == []
    assert len(desk.asked) > 1
    desk.chips = {(0, 0x75): b'\x6f'}
    (answer,) = probing.scan(SPI)
    assert (answer.state, answer.drivers) == ('known', ('iim42652',))


def test_on_spi_a_stranger_may_be_one_that_talks_in_frames(desk):
    desk.chips = {(0, 0x75): b'\x12'}
    (answer,) = probing.scan(SPI)
    assert answer.state == 'unknown'
    assert 'asked only where a bench says so: adxl355, mtn1100, scl3300' in answer.what


def test_nobody_is_asked_on_a_serial_line(desk):
    assert probing.scan(SERIAL) == []
    assert desk.asked == []


def test_a_sensor_of_a_bench_is_asked_without_a_write(desk):
    sensor = SensorConfig('left', 'mpu9250', 'hardware', bus='i2c-1')
    with pytest.raises(NoAnswer):
        probing.check(sensor)
    desk.chips = {(0x68, 0x75): b'\x71'}
    assert probing.check(sensor) == 'MPU-9250'
    desk.chips = {(0x68, 0x75): b'\x6f'}
    with pytest.raises(IdentityError, match=r'0x6F.*; TDK .* answers there, driver: iim42652$'):
        probing.check(sensor)
    desk.chips = {(0x68, 0x75): b'\x6e'}
    with pytest.raises(IdentityError, match=r'the part itself$'):
        probing.check(sensor)


def test_banks_are_not_selected(desk):
    desk.chips = {(0x68, 0x00): b'\xa0', (0x68, 0x01): b'\xfb\x32\x0f'}
    sensor = SensorConfig('fused', 'bno055', 'hardware', bus='i2c-1')
    assert probing.check(sensor) == 'Bosch BNO055'
    assert {register for _, register in desk.asked} == {0x00, 0x01}


def test_who_cannot_be_asked_without_disturbing_it_is_not_asked(desk, monkeypatch):
    class Line:
        name, baud = '/dev/ttyUSB0', 115200

        def write(self, data):
            raise AssertionError('something is sent')

        read = write

        def close(self):
            pass

    monkeypatch.setattr(probing, 'open_bus', lambda *_, **__: {'': Line()})
    with pytest.raises(NotReady, match='cannot be asked who it is without changing'):
        probing.check(SensorConfig('xsens', 'mti300', 'hardware', bus='ttyUSB0'))
