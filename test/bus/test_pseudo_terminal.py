# SPDX-License-Identifier: Apache-2.0
"""
Serial sensors through unmodified pyserial, at the other end of a pseudo-terminal.

The devices are the emulated ones; what is proven here is the way to them: a program that opens
a serial line, loses it and finds it again.
"""

import json
import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import threading
import tty

from imu_bench import bench
from imu_bench.acquisition import Acquisition
from imu_bench.bus.clock import SystemClock
from imu_bench.bus.opening import open_bus
from imu_bench.config import sensor_from_parameters
from imu_bench.drivers import load
from imu_bench.emulators import create
from imu_bench.simulation.world import sensor_source
import numpy as np
import pytest

pytestmark = [pytest.mark.slow]

CLIENT = Path(__file__).resolve().parents[1] / 'umockdev' / 'client.py'
PARTS = {'mti300': 'MTI-300', 'bno055': 'Bosch BNO055', 'serial_bridge': 'Microcontroller'}
every_sensor = pytest.mark.parametrize('name', PARTS)


class Cable:
    """An emulated device that can be plugged in under a name, and pulled."""

    def __init__(self, path, name):
        self.path, self.clock = path, SystemClock()
        driver = load(name)
        config = sensor_from_parameters(name, {'driver': name, 'backend': 'emulated'})
        now = self.clock.now_ns()
        source = sensor_source(config, driver.typical, 1.0, now, on_wire=True)
        self.line = create(name, 'serial', source, self.clock)['']
        self.pulled = threading.Event()
        self.thread = None
        self.plug_in()

    def plug_in(self):
        """Switch the device on, behind a new pseudo-terminal under the old name."""
        self.line.chip.power_up(self.clock.now_ns())
        self.pulled.clear()
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.path.symlink_to(os.ttyname(slave))
        self.thread = threading.Thread(target=self.serve, args=(master, slave))
        self.thread.start()

    def pull(self):
        """Take the name away and hang up."""
        self.path.unlink()
        self.pulled.set()
        self.thread.join()

    def serve(self, master, slave):
        """Carry bytes both ways until pulled."""
        waiting = b''
        while not self.pulled.is_set():
            asked, room, _ = select.select([master], [master] if waiting else [], [], 0.001)
            if asked:
                self.line.write(os.read(master, 4096))
            waiting += self.line.read(0.0)
            if room:
                # a terminal takes what it has room for; a reader that is late loses nothing
                waiting = waiting[os.write(master, waiting) :]
        for handle in (master, slave):
            os.close(handle)


@pytest.fixture
def cable(tmp_path):
    """Return what lays a cable to a device."""
    laid = []

    def lay(name):
        laid.append(Cable(tmp_path / 'ttyUSB0', name))
        return laid[-1]

    yield lay
    for each in laid:
        if not each.pulled.is_set():
            each.pull()


@every_sensor
def test_a_program_with_the_real_library_reads_it(cable, name):
    made = cable(name)
    path = made.path
    # not a program's first question: the device has to have started
    made.clock.sleep(load(name).start_up_s)
    result = subprocess.run(
        [sys.executable, CLIENT, name, path, '0x0', '300'],
        capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout.splitlines()[-1])
    assert found['libraries'] == ['serial']
    assert found['part'].startswith(PARTS[name])
    assert found['samples'] >= 300
    assert found['rising']
    assert found['error'] == ''
    assert found['acceleration'] == pytest.approx(9.8, abs=1.5)
    assert found['counters'].get('checksum_errors', 0) == 0
    assert found['counters']['brown_outs'] == 0


@every_sensor
def test_a_plug_that_is_pulled_is_named_and_survived(cable, name):
    made = cable(name)
    driver = load(name)
    wires = open_bus(str(made.path), driver.wiring, driver.bus_kinds)
    acquisition = Acquisition(driver(wires, made.clock, {}), made.clock, name=name)
    runs, errors = [], set()

    def until(happened, patience_s=300.0):
        deadline = made.clock.now_ns() + round(patience_s * 1e9)
        while not happened() and made.clock.now_ns() < deadline:
            made.clock.sleep(0.02)
            runs.extend(run for run in acquisition.drain() if run.acceleration is not None)
            if acquisition.error is not None:
                errors.add(type(acquisition.error).__name__)
        assert happened()

    try:
        acquisition.start()
        until(lambda: sum(map(len, runs)) > 100)
        made.pull()
        # a plug that is back before the last retry needs no recovery
        until(lambda: acquisition.stats.state == 'recovering')
        made.plug_in()
        plugged_ns = made.clock.now_ns()
        until(lambda: runs[-1].stamps[-1] > plugged_ns + 10**9)
    finally:
        acquisition.close()
    assert 'NoAnswer' in errors
    assert acquisition.stats.recoveries >= 1
    stamps = np.concatenate([run.stamps for run in runs])
    assert (np.diff(stamps) > 0).all()
    for run in runs:
        assert np.abs(run.acceleration[:, 2] - 9.8).max() < 1.5


def test_what_happened_on_the_line_is_played_to_the_bit(cable, tmp_path):
    made = cable('mti300')
    given = {'driver': 'mti300', 'backend': 'hardware', 'bus': str(made.path)}
    given['wire_recording'] = str(tmp_path / 'mine.wire')
    sensor = sensor_from_parameters('mine', given, settings_of=bench.settings_of)
    made.clock.sleep(load('mti300').start_up_s)
    acquisition = bench.build(sensor, made.clock)
    runs = []

    def until(happened):
        deadline = made.clock.now_ns() + 300 * 10**9
        while not happened() and made.clock.now_ns() < deadline:
            made.clock.sleep(0.02)
            runs.extend(acquisition.drain())
        assert happened()

    try:
        acquisition.prepare()
        acquisition.start()
        until(lambda: runs)
        made.pull()
        until(lambda: acquisition.stats.failures)
        made.plug_in()
        until(lambda: acquisition.stats.state == 'running' and not acquisition.stats.error)
        failed = len(runs)
        until(lambda: len(runs) > failed + 5)
    finally:
        acquisition.stop()
        runs.extend(acquisition.drain())
        stats = acquisition.stats
        acquisition.close()
    again, played = bench.play(tmp_path / 'mine.wire')
    assert played.over.endswith('events')
    for name in ('samples', 'lost', 'counters', 'errors', 'last_error', 'recoveries', 'late'):
        assert getattr(played, name) == getattr(stats, name), name
    assert stats.errors['NoAnswer'] >= 1
    assert [run.stamps.tolist() for run in again] == [run.stamps.tolist() for run in runs]
    for run, other in zip(runs, again, strict=True):
        if run.acceleration is not None:
            np.testing.assert_array_equal(run.acceleration, other.acceleration)


@pytest.mark.ros
@every_sensor
def test_the_node_runs_on_a_serial_line(cable, name, tmp_path):
    path = cable(name).path
    command = [
        sys.executable, '-m', 'imu_bench.nodes.sensor_node', '--ros-args',
        '-p', f'driver:={name}', '-p', 'backend:=hardware', '-p', f'bus:={path}',
    ]  # fmt: skip
    environment = {**os.environ, 'PYTHONUNBUFFERED': '1', 'ROS_LOG_DIR': str(tmp_path)}
    said = 'no acknowledge'
    while 'no acknowledge' in said:  # on a busy machine what answers for the sensor may be late
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
        ) as process:
            said = ''
            for line in process.stdout:
                said += line
                if f'hardware {name} {path}' in line:
                    break
            process.send_signal(signal.SIGINT)
            output = process.stdout.read()
    assert PARTS[name] in said.splitlines()[-1], said
    assert 'these are not measurements' not in said
    assert process.returncode == 0, output
