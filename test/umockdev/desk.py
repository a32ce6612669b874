# SPDX-License-Identifier: Apache-2.0
"""
The chips on the desk: emulated ones that answer over a socket to devices.py.

    desk.py SOCKET SCENE, where SCENE is JSON: {bus: [{driver, kind, address?}, ...]}
"""

from contextlib import suppress
import errno
import json
from pathlib import Path
import socket
import sys
import threading

from imu_bench.bus.clock import SystemClock
from imu_bench.config import sensor_from_parameters
from imu_bench.drivers import load
from imu_bench.emulators import create
from imu_bench.emulators.register_map import EmulatedBus
from imu_bench.errors import BusError, NoAnswer
from imu_bench.simulation.world import sensor_source

FAST_HZ = 50e6
"""The detour through umockdev takes longer than a wire: the wire itself takes no time."""


class Chip:
    """One sensor of the scene with its dies."""

    def __init__(self, clock, driver, kind, address=None):
        self.driver = load(driver)
        self.kind = kind
        config = sensor_from_parameters(driver, {'driver': driver, 'backend': 'emulated'})
        source = sensor_source(config, self.driver.typical, 1.0, clock.now_ns(), on_wire=True)
        self.buses = dict(create(driver, kind, source, clock, speed_hz=FAST_HZ))
        if kind != 'frame':
            # the increment bit comes over the wire, if it does
            self.buses = {
                part: EmulatedBus(bus.name, bus.line, bus.chip, acknowledges=bus.acknowledges)
                for part, bus in self.buses.items()
            }
        wiring = self.driver.wiring
        strap = wiring[''].i2c_addresses.index(address) if address else 0
        self.addresses = {
            wires.i2c_addresses[min(strap, len(wires.i2c_addresses) - 1)]: part
            for part, wires in wiring.items()
            if part in self.buses and wires.i2c_addresses
        }


class Desk:
    """Every chip by its bus."""

    def __init__(self, scene):
        clock = SystemClock()
        self.chips = {
            bus: [Chip(clock, **entry) for entry in entries] for bus, entries in scene.items()
        }
        # switched on long before anybody asks
        clock.sleep(max(c.driver.start_up_s for chips in self.chips.values() for c in chips))
        self.lock = threading.Lock()

    def answer(self, request):
        """Return errno and what was read, as hexadecimal texts."""
        try:
            with self.lock:
                if 'messages' in request:
                    data = self.combined(request['bus'], request['messages'])
                else:
                    data = [self.exchanged(request)]
        except NoAnswer:
            return {'errno': errno.EREMOTEIO, 'data': []}
        except BusError:
            return {'errno': errno.ETIMEDOUT, 'data': []}
        return {'errno': 0, 'data': [part.hex() for part in data]}

    def combined(self, bus, messages):
        """Do a combined transaction: register and data, or register and then reading."""
        address = messages[0]['address']
        for chip in self.chips[bus]:
            if address in chip.addresses:
                die = chip.buses[chip.addresses[address]]
                break
        else:
            raise NoAnswer(f'0x{address:02X}')
        first, *data = bytes.fromhex(messages[0]['write'])
        if data:
            die.write(first, bytes(data))
        return [die.read(first, message['read']) for message in messages[1:]]

    def exchanged(self, request):
        """Exchange a frame with the chip at a chip select."""
        device, _, select = request['bus'].rpartition('.')
        frame = bytes.fromhex(request['frame'])
        for bus, chips in self.chips.items():
            base, _, first = bus.rpartition('.')
            parts = list(chips[0].buses)
            if base == device and 0 <= int(select) - int(first) < len(parts):
                part = parts[int(select) - int(first)]
                return self.framed(chips[0], part, frame, request)
        return b'\xff' * len(frame)

    @staticmethod
    def framed(chip, part, frame, request):
        """Let a die answer a frame, if mode and clock are those of its document."""
        wiring = chip.driver.wiring[part]
        if request['mode'] != wiring.spi_mode or not 0 < request['speed_hz'] <= wiring.spi_max_hz:
            return b'\xff' * len(frame)
        die = chip.buses[part]
        if chip.kind == 'frame':
            return die.transfer(frame)
        register = (frame[0] & ~wiring.spi_read) >> wiring.spi_shift
        if frame[0] & wiring.spi_read:
            return b'\xff' + die.read(register, len(frame) - 1)
        die.write(register, frame[1:])
        return b'\xff' * len(frame)


def serve(desk, connection):
    """Answer one device file until it goes away."""
    with connection, connection.makefile('rw') as lines, suppress(ConnectionError):
        for line in lines:
            lines.write(json.dumps(desk.answer(json.loads(line))) + '\n')
            lines.flush()


def main(path, scene):
    """Serve until killed."""
    desk = Desk(json.loads(scene))
    Path(path).unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen()
        print('ready', flush=True)
        while True:
            connection, _ = server.accept()
            threading.Thread(target=serve, args=(desk, connection), daemon=True).start()


if __name__ == '__main__':
    main(*sys.argv[1:])
