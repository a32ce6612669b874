# SPDX-License-Identifier: Apache-2.0
"""A serial line that fails and comes back, with the real library on pseudo-terminals."""

import os
import termios

from imu_bench.bus.interface import ByteStream
from imu_bench.bus.serial_port import SerialPort
from imu_bench.errors import BusError, NoAnswer
import pytest


class Plug:
    """A name under which a pseudo-terminal is plugged in, pulled, and plugged in again."""

    def __init__(self, path):
        self.path = path
        self.handles = ()
        self.put_in()

    def put_in(self):
        self.master, slave = self.handles = os.openpty()
        self.path.symlink_to(os.ttyname(slave))

    def pull(self):
        self.path.unlink()
        for handle in self.handles:
            os.close(handle)
        self.handles = ()


@pytest.fixture
def plug(tmp_path):
    made = Plug(tmp_path / 'ttyUSB0')
    yield made
    if made.handles:
        made.pull()


def test_a_line_that_is_not_there_is_said_once_with_what_to_do(tmp_path):
    with pytest.raises(BusError) as caught:
        SerialPort(str(tmp_path / 'ttyAMA0'), 115200)
    said = str(caught.value)
    assert said.count('ttyAMA0') == 1
    assert said.count('No such file') == 1
    assert 'enable_uart=1 into /boot/firmware/config.txt' in said


def test_a_plug_that_was_pulled_and_put_back_works_without_being_told(plug):
    port = SerialPort(str(plug.path), 115200)
    port.write(b'before')
    assert os.read(plug.master, 100) == b'before'
    plug.pull()
    for _ in range(3):
        with pytest.raises(NoAnswer, match=r'ttyUSB0: .*check the plug'):
            port.read(0.0)
        with pytest.raises(NoAnswer, match='ttyUSB0'):
            port.write(b'x')
    plug.put_in()
    port.write(b'after')
    assert os.read(plug.master, 100) == b'after'
    os.write(plug.master, b'\x00\x11\xff')
    assert port.read(5.0) == b'\x00\x11\xff'
    port.close()
    port.close()


def test_the_speed_can_be_changed_and_outlives_the_plug(plug):
    port = SerialPort(str(plug.path), 115200)
    assert isinstance(port, ByteStream)
    port.baud = 921600
    assert port.baud == 921600
    assert termios.tcgetattr(plug.master)[4] == termios.B921600
    plug.pull()
    with pytest.raises(NoAnswer):
        port.read(0.0)
    plug.put_in()
    port.read(0.0)
    assert termios.tcgetattr(plug.master)[4] == termios.B921600
    port.close()


def test_a_speed_cannot_be_set_on_what_is_gone(plug):
    port = SerialPort(str(plug.path), 115200)
    plug.pull()
    with pytest.raises(NoAnswer):
        port.read(0.0)
    with pytest.raises(BusError, match='ttyUSB0'):
        port.baud = 9600
    assert port.baud == 115200
    port.close()
