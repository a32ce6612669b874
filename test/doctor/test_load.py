# SPDX-License-Identifier: Apache-2.0
"""What the doctor predicts, held against the emulated bench and against arithmetic."""

import heapq
from pathlib import Path

from imu_bench import bench, drivers, wires
from imu_bench.acquisition import Acquisition
from imu_bench.cli.doctor import FULL
from imu_bench.config import sensor_from_parameters
from imu_bench.config.location import config_file
from imu_bench.doctor import checkup, machine, probing
from imu_bench.doctor.demand import demand_of, seconds
from imu_bench.doctor.load import BenchBus, predict
from imu_bench.doctor.machine import Bus
from imu_bench.emulators.line import Line, Timing
from imu_bench.simulation.clock import SimulatedClock
import pytest

SECOND = 1_000_000_000
WITHIN = 0.05
ROOT = Path(__file__).parents[2]


def sensor(name, driver, **settings):
    given = {'driver': driver, 'backend': 'emulated', 'simulation.seed': 5, **settings}
    return sensor_from_parameters(name, given, settings_of=bench.settings_of)


def voltage(name, rate_hz):
    """Return a sensor that is asked for each sample, through an ADS1115."""
    return sensor(name, 'mtn1100', bus='i2c-1', converter='ads1115', rate_hz=rate_hz)


LIGHT = (
    sensor('still', 'iim42652', rate_hz=200.0),
    sensor('slow', 'lsm303dlhc', rate_hz=100.0, magnetometer_rate_hz=15.0),
)
FUSED = (sensor('still', 'iim42652', rate_hz=200.0), sensor('fused', 'bno055'))
USUAL = (sensor('left', 'mpu9250'), sensor('right', 'lsm303dlhc'))
POLLED = (
    voltage('one', 400.0), voltage('two', 400.0),
    sensor('still', 'iim42652', bus='i2c', rate_hz=200.0),
)  # fmt: skip
MIXED = (
    voltage('one', 400.0), sensor('fused', 'bno055', bus='i2c'),
    sensor('slow', 'lsm9ds1', bus='i2c', rate_hz=119.0, accelerometer_bandwidth=50.0),
)  # fmt: skip


def wire_of(sensors, timing):
    named = {one.name: one for one in sensors}
    return BenchBus('i2c-1', 'i2c', 9e9 / timing.byte_ns, '', named, dict.fromkeys(named, timing))


def emulated_bench(sensors, timing, settling_s=3, measured_s=8):
    """Return rates and share of bus time of chips on one line that takes its time."""
    clock = SimulatedClock()
    line = Line(clock, timing)
    busy_ns = 0
    transfer = line._transfer

    def counted(before, after, answer):
        nonlocal busy_ns
        busy_ns += before + after
        return transfer(before, after, answer)

    line._transfer = counted
    running = []
    for one in sensors:
        buses = bench.emulated_buses(one, clock, line)
        driver = drivers.load(one.driver)
        clock.sleep(driver.start_up_s)
        running.append(Acquisition(driver(buses, clock, one.settings), clock, name=one.name))
    for acquisition in running:
        acquisition.prepare()
    due = [(clock.now_ns(), k) for k in range(len(running))]
    for acquisition in running:
        acquisition.advance(clock.now_ns())
    taken = dict.fromkeys(range(len(running)), 0)

    def run(until_ns):
        while due[0][0] < until_ns:
            at, k = heapq.heappop(due)
            clock.sleep_until(at)
            heapq.heappush(due, (running[k].step(), k))
            runs = running[k].drain()
            taken[k] += sum(len(run) for run in runs if run.acceleration is not None)

    run(clock.now_ns() + settling_s * SECOND)
    taken, busy_ns, start_ns = dict.fromkeys(taken, 0), 0, clock.now_ns()
    run(start_ns + measured_s * SECOND)
    passed_s = (clock.now_ns() - start_ns) * 1e-9
    rates = {running[k].name: n / passed_s for k, n in taken.items()}
    return rates, busy_ns * 1e-9 / passed_s


@pytest.mark.slow
@pytest.mark.parametrize(
    ('sensors', 'speed_hz'),
    [
        (LIGHT, 400e3),
        (FUSED, 400e3),
        (USUAL, 400e3),
        (USUAL, 100e3),
        (POLLED, 100e3),
        (MIXED, 100e3),
    ],
    ids=['light', 'stretched', 'usual', 'FIFOs run over', 'polled rates fall', 'all of it'],
)
def test_the_prediction_agrees_with_the_emulated_bench(sensors, speed_hz):
    timing = Timing.i2c(speed_hz)
    load = predict(wire_of(sensors, timing))
    rates, busy = emulated_bench(sensors, timing)
    for share in load.shares:
        assert share.predicted_hz == pytest.approx(rates[share.name], rel=WITHIN), share
        assert share.keeps_rate == (rates[share.name] > 0.98 * share.nominal_hz)
    if load.busy < 0.9:
        assert busy == pytest.approx(load.busy, rel=WITHIN)
    else:
        assert busy > 0.9
        assert not all(share.keeps_rate for share in load.shares)


@pytest.mark.slow
def test_polled_sensors_on_a_full_bus_get_what_arithmetic_gives_them():
    timing = Timing.i2c(50e3)
    sensors = [sensor(name, 'bno055') for name in 'abcd']
    load = predict(wire_of(sensors, timing))
    # one look is 32 bytes, each stretched: one after the other, each gets its turn in four of them
    round_s = 4 * (timing.read_ns(32) * 1e-9 + 32 * 180e-6)
    assert load.busy > 1.0
    rates, _ = emulated_bench(sensors, timing, settling_s=2, measured_s=5)
    for share in load.shares:
        assert share.predicted_hz == pytest.approx(1 / round_s, rel=WITHIN)
        assert rates[share.name] == pytest.approx(1 / round_s, rel=WITHIN)


@pytest.mark.parametrize(
    ('driver', 'settings', 'depth_ms', 'has_fifo'),
    [
        # 512 bytes in frames of 14: PS-MPU-9250A-01 section 4.17
        # 22 bytes a sample, with those of the magnetometer that its own master reads
        ('mpu9250', {}, 512 / 22 / 1.004, True),
        # behind the auxiliary master of SPI 8 bytes more
        ('mpu9250', {'bus': 'spi'}, 23.3, True),
        # 32 slots, of which the last may be overwritten while it is read
        ('lsm9ds1', {}, 32.5, True),
        ('lsm303dlhc', {}, 23.3, True),
        # 2048 bytes in packets of 20: DS-000401 section 6
        ('iim42652', {'rate_hz': 500.0, 'fifo_bits': 20}, 203.0, True),
        ('scl3300', {'rate_hz': 200.0}, 5.0, False),
        # 4095 bytes of the tty
        ('mti300', {'rate_hz': 400.0, 'baud': 0}, 135.0, True),
    ],
)
def test_depths_are_those_of_the_documents(driver, settings, depth_ms, has_fifo):
    demand = demand_of(sensor('any', driver, **settings))
    assert 1e3 * demand.depth_s == pytest.approx(depth_ms, rel=0.05)
    assert demand.has_fifo is has_fifo


def test_a_board_that_buffers_for_long_says_so():
    demand = demand_of(sensor('axis', 'mtn1100'))
    assert demand.depth_s > 2.0
    assert demand.per_second.tolist() == [0.0] * 4


def test_what_is_read_costs_what_the_document_of_the_bus_says():
    demand = demand_of(sensor('tilt', 'scl3300', rate_hz=200.0))
    # ten frames of 32 bits for each of 200 samples
    assert demand.per_second.tolist() == pytest.approx([2000.0, 8000.0, 0.0, 0.0])
    assert seconds(demand.per_second, Timing.frames(2e6)) == pytest.approx(
        2000 * (16e-6 + 10e-6), rel=0.05
    )


def test_a_generic_source_asks_for_nothing():
    assert demand_of(sensor('mine', 'generic', rate_hz=100.0)) is None


@pytest.mark.slow
def test_a_slower_bus_is_never_faster_and_gives_what_arithmetic_does():
    rates = []
    for speed_hz in (400e3, 150e3, 100e3, 80e3, 50e3, 30e3):
        timing = Timing.i2c(speed_hz)
        (share,) = predict(wire_of([sensor('fused', 'bno055')], timing)).shares
        # 32 bytes, 180 µs of stretching each: alone on its bus it is read without a pause
        look_s = timing.read_ns(32) * 1e-9 + 32 * 180e-6
        assert share.busy > 32 * 180e-6 / 6.5e-3
        assert share.predicted_hz == pytest.approx(min(100.0, 1 / look_s), rel=WITHIN)
        rates.append(share.predicted_hz)
    assert rates == sorted(rates, reverse=True)


@pytest.mark.slow
def test_on_a_serial_line_nobody_stretches_a_clock():
    line = predict(wire_of([sensor('fused', 'bno055', bus='serial')], Timing.serial()))
    assert line.busy < 1.0


@pytest.mark.slow
@pytest.mark.parametrize('name', ['machine_vibration', 'mast_inclination', 'vehicle_vibration'])
@pytest.mark.parametrize('suffix', ['', '_hardware'])
def test_on_the_buses_of_the_documents_every_sensor_keeps_its_rate(name, suffix, monkeypatch):
    config = bench.load_bench(config_file(f'benches/{name}{suffix}.yaml'))
    fast = [Bus(f'/dev/i2c-{n}', 'i2c', '', 'i2c', True, 400e3) for n in (1, 6)]
    monkeypatch.setattr(machine, 'buses', lambda: fast)
    monkeypatch.setattr(probing, 'check', lambda sensor: '')
    loads = {load.name: load for load in checkup.examine(config, probe=False).loads}
    assert all(share.keeps_rate for load in loads.values() for share in load.shares), loads
    assert all(load.busy < FULL for load in loads.values())
    if suffix:  # what the page says
        page = (ROOT / 'docs' / 'raspberry_pi.md').read_text()
        rows = [line.split('|') for line in page.splitlines() if f'| `{name}' in line]
        said = {row[2].strip(' `'): float(row[4].strip(' %')) for row in rows}
        assert said == pytest.approx({k: 100 * v.busy for k, v in loads.items()}, abs=1.0)
    shared = {name for name, load in loads.items() if len(load.shares) > 1}
    assert shared == {'mast_inclination': {'spidev0'}}.get(name, {'i2c-1'})


def test_the_wires_of_a_bench_are_those_of_its_hardware():
    for name in ('machine_vibration', 'mast_inclination', 'vehicle_vibration'):
        here, there = (
            bench.load_bench(config_file(f'benches/{name}{suffix}.yaml'))
            for suffix in ('', '_hardware')
        )
        assert here.tests == there.tests != ()
        for emulated, real in zip(here.sensors, there.sensors, strict=True):
            assert real.backend == 'hardware'
            assert (emulated.name, emulated.driver) == (real.name, real.driver)
            assert emulated.settings == real.settings
            if emulated.bus not in ('', *drivers.load(emulated.driver).bus_kinds):
                assert wires.wire_of(emulated) == wires.wire_of(real)
