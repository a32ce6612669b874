# SPDX-License-Identifier: Apache-2.0
"""The MTN/1100 driver behind each converter: bytes, order of the start-up, every flag."""

import math

from imu_bench.bus.interface import Scan
from imu_bench.bus.scripted import ScriptedFrames, ScriptedRegisters
from imu_bench.drivers.mtn1100 import Mtn1100
from imu_bench.errors import BusError, ChecksumError, ConfigError, NoAnswer, NotReady
from imu_bench.registers import Register
from imu_bench.simulation.clock import SimulatedClock
import numpy as np
import pytest


class Board:
    """A board that notes what it is asked."""

    name = 'board'

    def __init__(self, fed=False, rate=1024.0, synchronous_after=2):
        self.fed, self.rate, self.waits = fed, rate, synchronous_after
        self.calls, self.scans, self.waited = [], [], []

    def identity(self):
        return 'MCC 172, serial number 1, firmware 1'

    def set_supply(self, channel, on):
        self.calls.append(('set_supply', channel, on))
        self.fed = on

    def supply(self, channel):
        return self.fed

    def set_rate(self, rate_hz):
        self.calls.append(('set_rate', rate_hz))

    def clock(self):
        self.waits -= 1
        return self.rate, self.waits < 0

    def start(self, channel):
        self.calls.append(('start', channel))

    def scan(self, wait_s):
        self.waited.append(wait_s)
        return self.scans.pop(0)

    def stop(self):
        self.calls.append(('stop',))

    def close(self):
        self.calls.append(('close',))


def driver(wire, **settings):
    return Mtn1100(wire, SimulatedClock(), settings)


def on_board(board=None, **settings):
    return driver(board or Board(), **{'rate_hz': 1024.0, **settings})


def on_i2c(*steps, **settings):
    return driver(ScriptedRegisters(steps), **settings)


def on_spi(*steps, **settings):
    return driver(ScriptedFrames(steps), **settings)


def test_every_register_of_the_ads1115_is_there():
    declared = {
        r.address: r.reset for r in Mtn1100.declared(Register).values() if r.part == 'ads1115'
    }
    assert declared == {0: 0x0000, 1: 0x8583, 2: 0x8000, 3: 0x7FFF}


# --- settings ----------------------------------------------------------------------------
def test_the_wire_decides_on_the_converter():
    for made, rate, paced in ((on_board(rate_hz=0.0), 51200 / 51, False),
                              (on_i2c(), 500.0, True), (on_spi(), 1000.0, True)):  # fmt: skip
        assert (made.rate_hz, made.paced) == (rate, paced)


@pytest.mark.parametrize(
    ('make', 'settings', 'text'),
    [
        (on_board, {'rate_hz': 1000.0}, r'mtn1100\.rate_hz: 1000 .*mcc172.*nearest 1003\.9216'),
        (on_board, {'rate_hz': 150.0}, 'rate_hz: 150 .*nearest 200 Hz'),
        (on_board, {'input': 2}, 'input: 2 .*mcc172; allowed: 0, 1'),
        (on_board, {'converter': 'ads1115'}, 'ads1115 cannot be on board, where a mcc172'),
        (on_i2c, {'rate_hz': 700.0}, 'rate_hz: 700 .*ads1115; allowed: up to 554 Hz'),
        (on_i2c, {'converter': 'mcp3208'}, 'mcp3208 cannot be on script'),
        (on_i2c, {'ads1115_range': 5.0}, r'ads1115_range.*6\.144, 4\.096'),
        (on_spi, {'rate_hz': 20_000.0}, 'rate_hz: 20000 .*mcp3208; allowed: up to 10000 Hz'),
        (on_spi, {'input': 8}, 'input.*0 to 7'),
        (on_spi, {'sensitivity': 0.1}, 'sensitivity.*1 to 1000 mV/g'),
    ],
)
def test_what_a_converter_does_not_have_is_refused(make, settings, text):
    with pytest.raises(ConfigError, match=text):
        make(**settings)


@pytest.mark.parametrize('rate', [51200.0, 25600.0, 10240.0, 2048.0, 1003.92, 1024.0, 200.0])
def test_rates_of_the_mcc172(rate):
    assert on_board(rate_hz=rate).rate_hz == pytest.approx(rate, rel=1e-5)


@pytest.mark.parametrize(
    ('rate', 'data_rate'), [(500.0, 860), (300.0, 475), (100.0, 128), (50.0, 64), (7.0, 8)]
)
def test_the_ads1115_takes_the_slowest_conversion_that_is_over_in_time(rate, data_rate):
    made = on_i2c(rate_hz=rate)
    codes = {field.name: value for field, value in made.assignments().items()}
    assert codes['ads1115_rate'] == pytest.approx(data_rate)


# --- MCC 172 -----------------------------------------------------------------------------
def test_the_start_up_of_the_mcc172():
    board = Board()
    made = on_board(board, input=1)
    before = made.clock.now_ns()
    made.configure()
    made.start()
    assert board.calls == [
        ('stop',), ('set_supply', 1, True), ('set_rate', 1024.0), ('start', 1),
    ]  # fmt: skip
    # polled until synchronised, then ten time constants of 0.204 s
    assert made.clock.now_ns() - before == 10_000_000 + 2_040_000_000
    assert made.identify() == 'Monitran MTN/1100, MCC 172, serial number 1, firmware 1'
    made.close()
    assert board.calls[-2:] == [('set_supply', 1, False), ('close',)]


def test_a_sensor_that_is_fed_already_has_settled():
    made = on_board(Board(fed=True))
    before = made.clock.now_ns()
    made.configure()
    assert made.clock.now_ns() - before == 10_000_000


@pytest.mark.parametrize(
    ('board', 'settings', 'error', 'text'),
    [
        (Board(rate=51200.0), {}, BusError, 'holds True and 51200 Hz'),
        (Board(synchronous_after=1000), {}, NotReady, 'not synchronised after 5 s'),
    ],
)
def test_what_the_board_does_not_take_is_noticed(board, settings, error, text):
    with pytest.raises(error, match=text):
        on_board(board, **settings).configure()


def test_a_block_is_waited_for_when_it_is_due():
    board = Board(fed=True)
    made = on_board(board)
    made.configure()
    made.start()
    board.scans = [Scan(np.zeros(n)) for n in (0, 0, 102, 0, 0)]
    for after_s in (0.05, 0.03, 0.0, 0.05, 0.03):
        made.clock.sleep(after_s)
        made.read()
    assert board.waited == [0.0, 0.025, 0.025, 0.0, 0.025]


def test_codes_become_acceleration_along_z():
    board = Board(fed=True)
    made = on_board(board, sensitivity=50.0)
    made.configure()
    board.scans = [Scan(np.array([0.0, 838861.0, 2.0**23 - 1]))]
    (run,) = made.read()
    now = made.clock.now_ns()
    # half a volt, at 50 mV/g
    np.testing.assert_allclose(run.acceleration[1], [math.nan, math.nan, 98.0665], rtol=1e-6)
    assert made.counters['saturated'] == 1
    # 39 samples and 4.5 µs of filter
    newest = now - round(39e9 / 1024 + 4500)
    np.testing.assert_allclose(newest - run.stamps, [2e9 / 1024, 1e9 / 1024, 0], atol=1)
    assert run.angular_velocity is None
    assert run.temperature is None


def test_nothing_new_from_the_board():
    board = Board(fed=True)
    made = on_board(board)
    made.configure()
    board.scans = [Scan(np.empty(0))]
    assert made.read() == []


@pytest.mark.parametrize(
    ('scan', 'counter'),
    [
        (Scan(np.zeros(3), hardware_overrun=True), 'hardware_overruns'),
        (Scan(np.zeros(3), buffer_overrun=True), 'buffer_overruns'),
        (Scan(np.zeros(3), running=False), None),
    ],
)
def test_after_an_overrun_the_scan_starts_anew(scan, counter):
    board = Board(fed=True)
    made = on_board(board)
    made.configure()
    made.start()
    board.calls.clear()
    board.scans = [scan]
    assert made.read() == []
    assert board.calls == [('stop',), ('start', 0)]
    assert made.continuity == 2
    assert {name for name, n in made.counters.items() if n} == {'restarts', counter} - {None}


def test_errors_of_the_board_are_counted(monkeypatch):
    board = Board(fed=True)
    made = on_board(board)
    made.configure()

    def fail(*arguments):
        raise NoAnswer('gone')

    monkeypatch.setattr(board, 'scan', fail)
    with pytest.raises(NoAnswer):
        made.read()
    assert made.counters['bus_errors'] == 1
    monkeypatch.setattr(board, 'set_supply', lambda *a: fail())
    made.close()
    assert board.calls[-1] == ('close',)


# --- ADS1115 -----------------------------------------------------------------------------
# single, A0-A1, 2.048 V, 860 per second, comparator off: SBAS444D table 8
REST, GO = b'\x05\xe3', b'\x85\xe3'


def config(answer):
    return ('read', 1, 2), answer


def write(word):
    return ('write', 1, word), b''


def test_the_start_up_of_the_ads1115():
    reset = config(b'\x85\x83')
    made = on_i2c(reset, reset, write(REST), config(GO), write(GO))
    assert made.identify() == 'Monitran MTN/1100, ADS1115 on script'
    made.configure()
    made.start()
    made._wires[''].finish()


def test_each_conversion_has_its_time():
    made = on_i2c(write(GO), config(GO), (('read', 0, 2), b'\x06\x40'), write(GO))
    made.configured = True
    made.start()
    begun = made.clock.now_ns()
    made.clock.sleep(0.002)
    (run,) = made.read()
    np.testing.assert_allclose(run.acceleration, [[math.nan, math.nan, 9.80665]])
    # 25 µs to wake, then the middle of 1/860 s
    assert run.stamps.tolist() == [begun + round(25e3 + 0.5e9 / 860)]
    made._wires[''].finish()


def test_a_conversion_that_is_not_over_is_waited_for():
    made = on_i2c(write(GO), config(REST), config(GO), (('read', 0, 2), b'\x7f\xff'), write(GO))
    made.configured = True
    made.start()
    assert made.read() == []
    assert made.counters['late_conversions'] == 1
    assert len(made.read()) == 1
    assert made.counters['saturated'] == 1


def test_an_ads1115_back_at_its_reset_value_is_configured_again():
    reset = config(b'\x85\x83')
    # found by the stream, found by the restart, answered to the identity check
    made = on_i2c(write(GO), reset, reset, reset, write(REST), config(GO), write(GO))
    made.configured = True
    made.start()
    assert made.read() == []
    assert made.counters['brown_outs'] == 1
    assert made.continuity == 2
    made._wires[''].finish()


# --- MCP3208 -----------------------------------------------------------------------------
def frames(*answers):
    return [(bytes.fromhex('06c0000000'), bytes.fromhex(answer)) for answer in answers]


def test_a_conversion_of_the_mcp3208():
    made = on_spi(*frames('ffe87c7c20', 'ffe87c7c20', 'ffe87c7c20'), input=3)
    made.configure()
    assert made.identify() == 'Monitran MTN/1100, MCP3208 on script'
    (run,) = made.read()
    # code 2172 of 4096 at 3.3 V
    np.testing.assert_allclose(run.acceleration, [[math.nan, math.nan, 9.7971]], rtol=1e-4)
    assert run.stamps.tolist() == [made.clock.now_ns()]


def test_reference_and_sensitivity_scale_alike():
    made = on_spi(*frames('ffe87c7c20'), input=3, mcp3208_reference=4.096, sensitivity=50.0)
    made.configured = True
    # 124 mV at 50 mV/g
    assert made.read()[0].acceleration[0, 2] == pytest.approx(2.48 * 9.80665)


def test_an_open_line_is_named_and_counted():
    made = on_spi(*frames('ffffffffff', 'ffe8000020'), input=3)
    made.configured = True
    with pytest.raises(NoAnswer, match='script: ffffffffff: nothing drives the line'):
        made.read()
    assert made.counters['bus_errors'] == 1
    assert len(made.read()) == 1


@pytest.mark.parametrize('broken', ['ffe97c7c20', 'ffe87c7c60', 'ffe87c7c21', 'ffe87c5c20'])
def test_a_broken_bit_is_named_and_counted_and_its_sample_dropped(broken):
    made = on_spi(*frames(broken, 'ffe87c7c20'), input=3)
    made.configured = True
    with pytest.raises(ChecksumError, match='forwards and backwards differ'):
        made.read()
    assert made.counters['checksum_errors'] == 1
    assert len(made.read()) == 1


@pytest.mark.parametrize('rail', ['0000000000', '000fffffe0'])
def test_an_input_that_stays_at_a_rail_is_no_measurement(rail):
    made = on_spi(*frames(rail, rail, 'ffe8000020', rail, rail, rail), input=3)
    made.configured = True
    for _ in range(5):
        assert len(made.read()) == 1
        made.clock.sleep(0.3)
    with pytest.raises(NoAnswer, match=r'script: code \d+ for 0\.5 s; check the sensor'):
        made.read()
    assert made.counters['saturated'] == 4
