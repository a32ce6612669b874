#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Device files that behave as those of i2c-dev and spidev, for unmodified programs.

Runs on the system's Python, which has the bindings of umockdev; the chips are those of desk.py,
asked over a socket.  Prints the folder for UMOCKDEV_DIR and ends with its standard input.

    devices.py SOCKET i2c-1 spidev0.0 ...
"""

import errno
import json
import socket
import struct
import sys

import gi

gi.require_version('UMockdev', '1.0')
from gi.repository import GLib, UMockdev  # noqa: E402, the version comes first

# linux/i2c-dev.h, linux/i2c.h
I2C_FUNCS, I2C_RDWR, I2C_SLAVE, I2C_SMBUS = 0x0705, 0x0707, 0x0703, 0x0720
I2C_M_RD = 0x0001
I2C_FUNC_I2C, I2C_FUNC_SMBUS_EMUL = 0x1, 0x0EFF0008
RDWR, MESSAGE = struct.Struct('@PI'), struct.Struct('@HHHP')
# linux/i2c.h: byte, size, and a union of up to 34 bytes
SMBUS = struct.Struct('@BBIP')
SMBUS_BYTE_DATA = 2
# linux/spi/spidev.h: 'k' is the type, the number of a message is 0
SPI_TYPE, SPI_MESSAGE, SPI_MODE, SPI_BITS, SPI_SPEED = ord('k'), 0, (1, 5), 3, 4
TRANSFER = struct.Struct('@QQIIHBBBBBB')


class Desk:
    """The chips, on the other side of a socket."""

    def __init__(self, path):
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(path)
        self._file = connection.makefile('rw')

    def ask(self, **request):
        """Return (errno, list of bytes) of a transfer."""
        self._file.write(json.dumps(request) + '\n')
        self._file.flush()
        answer = json.loads(self._file.readline())
        return answer['errno'], [bytes.fromhex(text) for text in answer['data']]


class Device(UMockdev.IoctlBase):
    """A device file; each subclass knows the calls of its kernel driver."""

    def __init__(self, desk, name):
        super().__init__()
        self.desk, self.name = desk, name
        self.connect('handle-ioctl', self.on_ioctl)

    def on_ioctl(self, _, client):
        """Answer a call, or say that it is not known."""
        client.complete(*self.answer(client.get_request(), client.get_arg()))
        return True


def content(data):
    """Return the bytes that umockdev has fetched from the client."""
    return bytes(data.retrieve())


class I2cDevice(Device):
    """What i2c-dev answers."""

    slave = 0

    def answer(self, request, argument):
        """Return result and errno of a call."""
        if request == I2C_FUNCS:
            functions = struct.pack('@L', I2C_FUNC_I2C | I2C_FUNC_SMBUS_EMUL)
            argument.resolve(0, len(functions)).update(0, functions)
            return 0, 0
        if request == I2C_RDWR:
            return self.transfer(argument)
        if request == I2C_SMBUS:
            return self.smbus(argument)
        if request == I2C_SLAVE:
            (self.slave,) = struct.unpack('@L', content(argument))
            return 0, 0
        return -1, errno.ENOTTY

    def transfer(self, argument):
        """Do messages of one combined transaction."""
        head = argument.resolve(0, RDWR.size)
        _, count = RDWR.unpack(content(head))
        messages = head.resolve(0, MESSAGE.size * count)
        asked, buffers = [], []
        for k in range(count):
            start = MESSAGE.size * k
            address, flags, length, _ = MESSAGE.unpack(
                content(messages)[start : start + MESSAGE.size]
            )
            buffer = messages.resolve(start + MESSAGE.size - 8, length)
            if flags & I2C_M_RD:
                asked.append({'address': address, 'read': length})
                buffers.append(buffer)
            else:
                asked.append({'address': address, 'write': content(buffer).hex()})
        error, data = self.desk.ask(bus=self.name, messages=asked)
        if error:
            return -1, error
        for buffer, answer in zip(buffers, data, strict=True):
            buffer.update(0, answer)
        return count, 0

    def smbus(self, argument):
        """Read or write one byte of a register."""
        head = argument.resolve(0, SMBUS.size)
        reading, command, size, _ = SMBUS.unpack(content(head))
        if size != SMBUS_BYTE_DATA:
            return -1, errno.EOPNOTSUPP
        union = head.resolve(SMBUS.size - 8, 34)
        asked = [{'address': self.slave, 'write': bytes([command]).hex()}]
        if reading:
            asked.append({'address': self.slave, 'read': 1})
        else:
            asked[0]['write'] = bytes([command, content(union)[0]]).hex()
        error, data = self.desk.ask(bus=self.name, messages=asked)
        if error:
            return -1, error
        if reading:
            union.update(0, data[0])
        return 0, 0


class SpiDevice(Device):
    """What spidev answers."""

    def __init__(self, desk, name):
        super().__init__(desk, name)
        self.settings = {}

    def answer(self, request, argument):
        """Return result and errno of a call."""
        kind, number = request >> 8 & 0xFF, request & 0xFF
        size, writes = request >> 16 & 0x3FFF, bool(request >> 30 & 1)
        if kind != SPI_TYPE:
            return -1, errno.ENOTTY
        if number == SPI_MESSAGE:
            return self.transfer(argument, size)
        if writes:
            self.settings[number] = content(argument.resolve(0, size))
        else:
            stored = self.settings.get(number, bytes(size))
            argument.resolve(0, size).update(0, stored.ljust(size, b'\0')[:size])
        return 0, 0

    def transfer(self, argument, size):
        """Exchange one frame for each transfer."""
        head = argument.resolve(0, size)
        total = 0
        for start in range(0, size, TRANSFER.size):
            part = TRANSFER.unpack(content(head)[start : start + TRANSFER.size])
            length = part[2]
            sent = content(head.resolve(start, length)) if part[0] else bytes(length)
            speed = self.settings.get(SPI_SPEED, bytes(4))
            mode = next((self.settings[n] for n in SPI_MODE if n in self.settings), b'\0')
            error, data = self.desk.ask(
                bus=self.name, frame=sent.hex(), mode=mode[0] & 3,
                speed_hz=int.from_bytes(speed, sys.byteorder),
            )  # fmt: skip
            if error:
                return -1, error
            if part[1]:
                head.resolve(start + 8, length).update(0, data[0])
            total += length
        return total, 0


def main(path, *names):
    """Serve device files until standard input ends."""
    testbed = UMockdev.Testbed.new()
    held = []
    for name in names:
        subsystem = 'i2c-dev' if name.startswith('i2c') else 'spidev'
        testbed.add_from_string(
            f'P: /devices/{name}\nN: {name}\nE: SUBSYSTEM={subsystem}\nE: DEVNAME=/dev/{name}\n'
        )
        device = (I2cDevice if subsystem == 'i2c-dev' else SpiDevice)(Desk(path), name)
        testbed.attach_ioctl(f'/dev/{name}', device)
        held.append(device)
    print(testbed.get_root_dir(), flush=True)
    loop = GLib.MainLoop()
    GLib.io_add_watch(0, GLib.PRIORITY_DEFAULT, GLib.IO_HUP | GLib.IO_IN, lambda *_: loop.quit())
    loop.run()


if __name__ == '__main__':
    main(*sys.argv[1:])
