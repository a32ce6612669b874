# SPDX-License-Identifier: Apache-2.0
"""A sensor without a file of its own: the declared map run backwards."""

from typing import ClassVar

from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, Driver, Identity
from imu_bench.emulators.generic import create
from imu_bench.emulators.line import Line, Timing
from imu_bench.emulators.socket import Socket
from imu_bench.registers import Codes, Field, Register, Scalar, Vector
from imu_bench.samples import Samples
import numpy as np
import pytest


class TwoDies(Driver):
    """After the LSM303DLHC: one die needs a burst bit, the other has X, Z, Y big endian."""

    name = 'two_dies'
    title = 'Example'
    document = 'none'
    bus_kinds = ('i2c',)
    wiring: ClassVar = {
        '': Wiring(i2c_addresses=(0x19,), i2c_increment=0x80),
        'mag': Wiring(i2c_addresses=(0x1E,)),
    }
    ID = Register(0x0F, access='ro', reset=0x33)
    CTRL = Register(0x23)
    OUT = Register(0x28, access='ro', size=6, reset=None)
    TEMP = Register(0x31, access='ro', size=2, reset=None)
    MAG = Register(0x03, access='ro', size=6, reset=None, part='mag')
    FLAGS = Register(0x09, access='ro', reset=0x81, clear_on_read=True, part='mag')
    accelerometer_range = Field(CTRL, (5, 4), Codes({2.0: 0, 16.0: 3}), 'g')
    identities = (Identity(ID, {0x33: 'Example'}),)
    settings = (choice('accelerometer_range', accelerometer_range, 2.0, 'Full scale.'),)
    acceleration = Vector(
        first=OUT,
        quantity='acceleration',
        unit='m/s²',
        dtype='<i2',
        scaled_by=accelerometer_range,
        si_per_lsb={2.0: 0.01, 16.0: 0.12},
        shift=4,
    )
    temperature = Scalar(
        first=TEMP, quantity='temperature', unit='°C', dtype='>i2', si_per_lsb=0.125
    )
    magnetic_field = Vector(
        first=MAG,
        quantity='magnetic_field',
        unit='T',
        dtype='>i2',
        si_per_lsb=(1e-7, 2e-7, 1e-7),
        axes=((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    )
    rate_hz = 100.0
    poll_period_s = 0.01

    def read(self):
        part = {}
        for channel in (self.acceleration, self.magnetic_field):
            words = np.frombuffer(self.registers.burst(channel.first), channel.dtype)
            range_ = self.values['accelerometer_range'] if channel.scaled_by else None
            part[channel.quantity] = channel.decode(words[np.newaxis], range_)
        return [Samples([self.clock.now_ns()], **part)]


@pytest.fixture
def buses(clock, make_source):
    source = make_source(
        acceleration=(1.0, -2.0, 9.8), magnetic_field=(1e-5, 2e-5, 3e-5), temperature=25.5
    )
    line = Line(clock, Timing.i2c())
    return create(Socket(TwoDies, 'i2c', 'emulated two_dies', source, clock, line))


@pytest.mark.parametrize('range_', [2.0, 16.0])
def test_the_driver_gets_back_what_the_source_gave(clock, buses, range_):
    driver = TwoDies(buses, clock, {'accelerometer_range': range_})
    driver.configure()
    clock.sleep(0.01)
    (run,) = driver.read()
    half = driver.acceleration.resolution(range_) / 2
    assert (np.abs(run.acceleration[0] - [1.0, -2.0, 9.8]) <= half * (1 + 1e-9)).all()
    np.testing.assert_allclose(run.magnetic_field[0], [1e-5, 2e-5, 3e-5], atol=1e-7)


def test_without_its_burst_bit_the_chip_repeats_a_byte(clock, buses):
    clock.sleep(0.01)
    buses[''].read(0x28, 1)
    chip = buses[''].chip
    at = clock.now_ns()
    first = chip.read(0x28, 1, at, 0.0)
    assert chip.read(0x28, 6, at, 0.0) == first * 6
    assert chip.read(0x28 | 0x80, 6, at, 0.0) == np.array([1600, -3200, 15680], '<i2').tobytes()


def test_order_and_byte_order_of_the_other_die(clock, buses):
    clock.sleep(0.01)
    assert buses['mag'].read(0x03, 6) == np.array([100, 150, 200], '>i2').tobytes()


def test_flags_empty_when_read_and_power_brings_them_back(clock, buses):
    assert buses['mag'].read(0x09, 1) == b'\x81'
    assert buses['mag'].read(0x09, 1) == b'\x00'
    buses['mag'].chip.power_up(clock.now_ns())
    assert buses['mag'].read(0x09, 1) == b'\x81'


def test_what_is_not_there_reads_zero_and_takes_nothing(buses):
    buses[''].write(0x7F, b'\x55')
    assert buses[''].read(0x7F, 1) == b'\x00'


def test_a_write_only_register_reads_zero():
    from imu_bench.emulators.register_map import RegisterMemory

    command = Register(0x20, access='wo')
    memory = RegisterMemory([command])
    memory.write(0x20, 5)
    assert memory.read(0x20) == 0
    assert memory.word(command) == 5
