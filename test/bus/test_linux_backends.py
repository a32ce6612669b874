# SPDX-License-Identifier: Apache-2.0
"""I²C, SPI and serial backends: what the libraries are asked, and what their errors become."""

import errno
import os
import sys
from types import SimpleNamespace

from imu_bench.bus.clock import SystemClock
from imu_bench.bus.i2c import I2cBus
from imu_bench.bus.opening import kind_of, open_bus
from imu_bench.bus.scripted import ScriptedFrames
from imu_bench.bus.serial_port import SerialPort
from imu_bench.bus.spi import SpiFrameBus, SpiRegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.errors import BusBusy, BusError, ConfigError, NoAnswer, PermissionDenied
import pytest


class FakeMessage:
    """What smbus2.i2c_msg is, as far as it is used."""

    def __init__(self, address, data=b'', length=None):
        self.address, self.data, self.length = address, bytes(data), length

    @staticmethod
    def write(address, data):
        return FakeMessage(address, data)

    @staticmethod
    def read(address, length):
        return FakeMessage(address, bytes(range(length % 256)), length)

    def __bytes__(self):
        return self.data


@pytest.fixture
def device_file(tmp_path):
    """Give what opens a file that stands for the device: it can be locked."""
    return lambda: os.open(tmp_path / 'device', os.O_RDWR | os.O_CREAT)


@pytest.fixture
def smbus2(monkeypatch, device_file):
    """Record every I2C_RDWR call; raise `error` if one is set, or when the file is opened."""
    calls = SimpleNamespace(transfers=[], error=None, denied=None, closed=False, opened=0)

    class FakeBus:
        def __init__(self, path):
            if calls.denied is not None:
                raise calls.denied
            calls.path = path
            calls.opened += 1
            self.fd = device_file()

        def i2c_rdwr(self, *messages):
            if calls.error is not None:
                raise calls.error
            calls.transfers.append([(m.address, m.length or m.data) for m in messages])

        def close(self):
            os.close(self.fd)
            calls.closed = True

    fake = SimpleNamespace(SMBus=FakeBus, i2c_msg=FakeMessage)
    monkeypatch.setitem(sys.modules, 'smbus2', fake)
    return calls


def test_a_read_is_one_combined_transaction_of_any_length(smbus2):
    bus = I2cBus('/dev/i2c-1', 0x68, Wiring())
    assert len(bus.read(0x74, 252)) == 252
    bus.write(0x6B, b'\x80')
    bus.close()
    assert bus.name == '/dev/i2c-1 0x68'
    assert smbus2.path == '/dev/i2c-1'
    assert smbus2.transfers == [[(0x68, b'\x74'), (0x68, 252)], [(0x68, b'\x6b\x80')]]
    assert smbus2.closed


def test_only_a_burst_sets_the_increment_bit(smbus2):
    bus = I2cBus('/dev/i2c-1', 0x19, Wiring(i2c_increment=0x80))
    bus.read(0x28, 6)
    bus.read(0x0F, 1)
    bus.write(0x20, b'\x97\x00')
    assert [transfer[0][1] for transfer in smbus2.transfers] == [b'\xa8', b'\x0f', b'\xa0\x97\x00']


@pytest.mark.parametrize(
    ('number', 'kind', 'text'),
    [
        (errno.ENXIO, NoAnswer, 'check power, wiring and address'),
        (errno.EREMOTEIO, NoAnswer, 'check power, wiring and address'),
        (errno.EIO, NoAnswer, 'broke off'),
        (errno.EAGAIN, BusBusy, 'another master'),
        (errno.ETIMEDOUT, BusBusy, 'stuck'),
        (errno.EBUSY, BusBusy, 'kernel driver'),
        (errno.EACCES, PermissionDenied, 'usermod -aG i2c'),
        (errno.EINVAL, BusError, 'failed'),
    ],
)
def test_errno_becomes_a_named_error_with_device_address_and_advice(smbus2, number, kind, text):
    bus = I2cBus('/dev/i2c-1', 0x68, Wiring())
    smbus2.error = OSError(number, os.strerror(number))
    with pytest.raises(kind, match=f'/dev/i2c-1 0x68 reading 0x75: .*{text}') as caught:
        bus.read(0x75, 1)
    assert caught.value.__cause__ is smbus2.error
    with pytest.raises(kind, match='writing 0x6B'):
        bus.write(0x6B, b'\x00')


def test_a_device_that_is_another_one_now_is_opened_again(smbus2):
    bus = I2cBus('/dev/i2c-1', 0x68, Wiring())
    smbus2.error = OSError(errno.ENODEV, 'No such device')
    with pytest.raises(NoAnswer, match='is gone'):
        bus.read(0x75, 1)
    smbus2.denied = PermissionError(errno.EACCES, 'Permission denied')
    with pytest.raises(PermissionDenied, match='usermod -aG i2c'):
        bus.read(0x75, 1)
    smbus2.error = smbus2.denied = None
    assert bus.read(0x75, 1) == b'\x00'
    assert smbus2.opened == 2
    bus.close()


def test_a_chip_has_one_owner_and_its_neighbour_another(smbus2):
    first = I2cBus('/dev/i2c-1', 0x68, Wiring())
    second = I2cBus('/dev/i2c-1', 0x68, Wiring(), patience_s=0.0)
    neighbour = I2cBus('/dev/i2c-1', 0x69, Wiring(), patience_s=0.0)
    first.read(0x75, 1)
    neighbour.read(0x75, 1)
    with pytest.raises(BusBusy, match=r'/dev/i2c-1 0x68: process .* uses this chip'):
        second.read(0x75, 1)
    first.close()
    assert second.read(0x75, 1) == b'\x00'
    second.close()
    neighbour.close()


@pytest.mark.parametrize(
    ('open_one', 'where'),
    [
        (lambda: I2cBus('/dev/i2c-251', 0x68, Wiring()), '/dev/i2c-251 0x68.*i2c_arm'),
        (lambda: SpiFrameBus('/dev/spidev9.9', Wiring(spi_max_hz=1)), '/dev/spidev9.9.*spi=on'),
        (lambda: SerialPort('/dev/ttyUSB251', 115200), '/dev/ttyUSB251.*plug'),
    ],
)
def test_the_real_libraries_say_when_there_is_no_such_device(open_one, where):
    with pytest.raises(BusError, match=where):
        open_one()


@pytest.mark.parametrize(
    ('module', 'open_one'),
    [
        ('smbus2', lambda: I2cBus('/dev/i2c-1', 0x68, Wiring())),
        ('periphery', lambda: SpiFrameBus('/dev/spidev0.0', Wiring(spi_max_hz=1))),
        ('serial', lambda: SerialPort('/dev/ttyUSB0', 115200)),
    ],
)
def test_a_missing_library_is_a_clear_error(monkeypatch, module, open_one):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError, match='pip install'):
        open_one()


# --- SPI ---------------------------------------------------------------------------------
def test_spi_registers_carry_read_and_burst_bits():
    wiring = Wiring(spi_max_hz=1_000_000, spi_increment=0x40)
    script = [
        (b'\xe8' + bytes(6), b'\xff123456'),
        (b'\x8f\x00', b'\xff\x3d'),
        (b'\x20\x7c', b'\x00\x00'),
        (b'\x60\x01\x02', b'\x00\x00\x00'),
    ]
    with ScriptedFrames(script) as frames:
        bus = SpiRegisterBus(frames, wiring)
        assert bus.read(0x28, 6) == b'123456'
        assert bus.read(0x0F, 1) == b'\x3d'
        bus.write(0x20, b'\x7c')
        bus.write(0x20, b'\x01\x02')
        bus.close()
    assert frames.closed


def test_spi_passes_mode_clock_and_errors(monkeypatch, device_file):
    made = SimpleNamespace(error=None)

    class FakeSpi:
        def __init__(self, path, mode, speed):
            made.arguments = path, mode, speed
            self.fd = device_file()

        def transfer(self, data):
            if made.error:
                raise made.error
            return bytes(reversed(data))

        def close(self):
            os.close(self.fd)
            made.closed = True

    monkeypatch.setitem(sys.modules, 'periphery', SimpleNamespace(SPI=FakeSpi))
    bus = SpiFrameBus('/dev/spidev0.1', Wiring(spi_mode=3, spi_max_hz=8_000_000, spi_hz=8_000_000))
    assert made.arguments == ('/dev/spidev0.1', 3, 8_000_000)
    assert bus.transfer(b'\x01\x02') == b'\x02\x01'
    made.error = OSError(errno.EACCES, 'Permission denied')
    with pytest.raises(PermissionDenied, match='usermod -aG spi'):
        bus.transfer(b'\x00')
    bus.close()
    assert made.closed


# --- serial: the real library on a pseudo terminal ---------------------------------------
@pytest.fixture
def terminal():
    master, slave = os.openpty()
    yield master, os.ttyname(slave)
    for handle in (master, slave):
        os.close(handle)


def test_a_serial_line_carries_bytes_both_ways(terminal):
    master, path = terminal
    port = SerialPort(path, 115200)
    port.write(b'\xfa\xff\x30\x00\xd1')
    assert os.read(master, 100) == b'\xfa\xff\x30\x00\xd1'
    assert port.read(0.0) == b''
    os.write(master, b'\xfa\xff\x31\x00\xd0')
    assert port.read(5.0) == b'\xfa\xff\x31\x00\xd0'
    port.close()


def test_a_pulled_plug_is_named():
    master, slave = os.openpty()
    port = SerialPort(os.ttyname(slave), 115200)
    os.close(master)
    with pytest.raises(NoAnswer, match=f'{port.name}: .*check'):
        port.read(1.0)
    with pytest.raises(NoAnswer, match=port.name):
        port.write(b'x')
    port.close()
    os.close(slave)


def test_a_line_has_one_owner(terminal):
    port = SerialPort(terminal[1], 115200)
    with pytest.raises(BusBusy, match=f'{terminal[1]}: somebody else holds it'):
        SerialPort(terminal[1], 115200)
    port.close()


# --- opening -----------------------------------------------------------------------------
MPU = {'': Wiring(i2c_addresses=(0x68, 0x69), spi_max_hz=1_000_000), 'mag': Wiring((0x0C,))}
TWO_DIES = {
    '': Wiring((0x6A, 0x6B), spi_mode=3, spi_max_hz=1),
    'mag': Wiring((0x1C, 0x1E), spi_mode=3, spi_max_hz=1),
}


def test_every_die_gets_its_bus(smbus2):
    buses = open_bus('i2c-1', MPU, ('i2c', 'spi'))
    assert {part: bus.name for part, bus in buses.items()} == {
        '': '/dev/i2c-1 0x68',
        'mag': '/dev/i2c-1 0x0C',
    }
    buses = open_bus('/dev/i2c-3', TWO_DIES, ('i2c',), address=0x6B)
    assert [bus.name for bus in buses.values()] == ['/dev/i2c-3 0x6B', '/dev/i2c-3 0x1E']


def test_the_dies_of_a_chip_may_be_strapped_differently(smbus2):
    buses = open_bus('i2c-1', TWO_DIES, ('i2c',), address=0x6B, second_address=0x1C)
    assert [bus.name for bus in buses.values()] == ['/dev/i2c-1 0x6B', '/dev/i2c-1 0x1C']
    with pytest.raises(ConfigError, match=r'mag address 0x30 is not .* it has 0x1C, 0x1E'):
        open_bus('i2c-1', TWO_DIES, ('i2c',), second_address=0x30)
    with pytest.raises(ConfigError, match='second_address: this chip has one address'):
        open_bus('i2c-1', {'': Wiring((0x6A,))}, ('i2c',), second_address=0x1C)


def test_the_clock_of_spi_is_cautious_until_it_is_set(monkeypatch):
    opened = []
    monkeypatch.setitem(
        sys.modules,
        'periphery',
        SimpleNamespace(SPI=lambda *a: opened.append(a) or SimpleNamespace(close=int)),
    )
    fast = {'': Wiring(spi_max_hz=24_000_000)}
    open_bus('spidev0.0', fast, ('spi',))
    open_bus('spidev0.0', fast, ('spi',), spi_hz=24_000_000)
    open_bus('spidev0.0', {'': Wiring(spi_max_hz=500_000)}, ('spi',))
    assert [clock for _, _, clock in opened] == [1_000_000, 24_000_000, 500_000]
    with pytest.raises(ConfigError, match=r'spi_hz 30000000 is too fast .* can do 24000000'):
        open_bus('spidev0.0', fast, ('spi',), spi_hz=30_000_000)


def test_a_second_die_on_spi_has_the_next_chip_select(monkeypatch):
    monkeypatch.setitem(
        sys.modules, 'periphery', SimpleNamespace(SPI=lambda *a: SimpleNamespace(close=int))
    )
    assert list(open_bus('spidev0.0', MPU, ('i2c', 'spi'))) == ['']
    buses = open_bus('spidev0.0', TWO_DIES, ('i2c', 'spi'))
    assert [bus.name for bus in buses.values()] == ['/dev/spidev0.0', '/dev/spidev0.1']
    assert isinstance(open_bus('spidev0.0', TWO_DIES, ('frame',))[''], SpiFrameBus)


def test_a_serial_sensor_opens_at_its_baud(terminal):
    bus = open_bus(terminal[1], {'': Wiring(serial_baud=115200)}, ('serial',))['']
    assert bus.name == terminal[1]
    bus.close()


@pytest.mark.parametrize(
    ('device', 'address', 'text'),
    [
        ('usb', None, 'like /dev/i2c-1'),
        ('ttyUSB0', None, 'is serial; this sensor can do i2c, spi'),
        ('i2c-1', 0x30, '0x30 is not one of this chip; it has 0x68, 0x69'),
    ],
)
def test_a_bus_the_sensor_cannot_use_is_refused(smbus2, device, address, text):
    with pytest.raises(ConfigError, match=text):
        open_bus(device, MPU, ('i2c', 'spi'), address=address)


def test_what_was_opened_is_closed_when_the_next_fails(monkeypatch):
    closed = []

    def spi(path, mode, speed):
        if path.endswith('.1'):
            raise OSError(errno.ENOENT, 'No such file')
        return SimpleNamespace(close=lambda: closed.append(path))

    monkeypatch.setitem(sys.modules, 'periphery', SimpleNamespace(SPI=spi))
    with pytest.raises(BusError, match=r'spidev0\.1'):
        open_bus('spidev0.0', TWO_DIES, ('spi',))
    assert closed == ['/dev/spidev0.0']


@pytest.mark.parametrize('path', ['/dev/pts/3', '/dev/serial/by-id/usb-Xsens', 'ttyAMA0'])
def test_serial_lines_have_many_names(path):
    assert kind_of(path) == 'serial'


# --- clock -------------------------------------------------------------------------------
def test_the_system_clock_rises_and_refuses_to_go_back():
    clock = SystemClock()
    times = [clock.now_ns() for _ in range(1000)]
    assert times == sorted(times)
    start = clock.now_ns()
    clock.sleep(0.002)
    clock.sleep_until(start)
    assert clock.now_ns() - start >= 2_000_000
    with pytest.raises(ConfigError, match='sleep'):
        clock.sleep(-1.0)
