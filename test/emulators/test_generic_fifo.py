# SPDX-License-Identifier: Apache-2.0
"""A declared FIFO, run backwards: held against bytes that are written down here."""

from typing import ClassVar

from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import Driver
from imu_bench.emulators.generic import create
from imu_bench.emulators.line import Line, Timing
from imu_bench.emulators.socket import Socket
from imu_bench.errors import ConfigError
from imu_bench.registers import Codes, Field, Fifo, Frame, Register, Vector, Write
from imu_bench.samples import Samples
import numpy as np
import pytest

PORT, LEVEL, STATUS, CONTROL, RESET, OUT = 0x11, 0x05, 0x04, 0x2D, 0x2F, 0x08


class Tagged(Driver):
    """Four samples of three words, after the ADXL355."""

    name = 'tagged'
    title = 'Example'
    document = 'none'
    bus_kinds = ('i2c',)
    start_up_s = 0.01
    wiring: ClassVar = {'': Wiring(i2c_addresses=(0x1D,))}
    FLAGS = Register(STATUS, access='ro', clear_on_read=True)
    COUNT = Register(LEVEL, access='ro')
    DATA = Register(OUT, access='ro', size=9)
    FIFO_DATA = Register(PORT, access='ro')
    CTRL = Register(CONTROL, reset=0x01)
    COMMAND = Register(RESET, access='wo')
    overrun = Field(FLAGS, 2)
    rate = Field(CTRL, (5, 4), Codes({100.0: 0, 200.0: 1}), 'Hz')
    standby = Field(CTRL, 0)
    command = Field(COMMAND, (7, 0), Codes({'reset': 0x52}), self_clearing=True)
    acceleration = Vector(
        first=DATA, quantity='acceleration', unit='m/s²', dtype='>i3', si_per_lsb=0.01, shift=4
    )
    fifo = Fifo(
        port=FIFO_DATA,
        frame=Frame(acceleration),
        depth=4,
        count=COUNT,
        units=3,
        overrun=overrun,
        rate=rate,
        runs=(standby, 0),
        marks=bytes([0, 0, 1, 0, 0, 0, 0, 0, 0]),
        empty=bytes([0, 0, 2]),
    )
    reset_steps = (Write({command: 'reset'}),)
    rate_hz = 100.0
    poll_period_s = 0.01

    def read(self):
        return []


SAMPLE = '000641fff380003d50'
"""1.00, -2.00 and 9.81 m/s²: 100, -200 and 981 above four bits, the lowest of them the tag."""


@pytest.fixture
def bus(clock, make_source):
    source = make_source(acceleration=(1.0, -2.0, 9.81))
    line = Line(clock, Timing(byte_ns=0.0, read_header=0, write_header=0, overhead_ns=0.0))
    made = create(Socket(Tagged, 'i2c', 'emulated tagged', source, clock, line))['']
    clock.sleep(0.02)
    return made


@pytest.fixture
def running(clock, bus):
    bus.write(CONTROL, b'\x00')
    clock.sleep(0.0251)
    return bus


def test_samples_come_at_the_rate_of_the_registers(clock, running):
    assert running.read(LEVEL, 1) == b'\x06'
    running.write(CONTROL, b'\x10')
    clock.sleep(0.0101)
    assert running.read(LEVEL, 1) == b'\x0c'


def test_a_frame_is_tagged_and_the_data_registers_hold_it_without(running):
    assert running.read(PORT, 9).hex() == SAMPLE
    assert running.read(OUT, 9).hex() == SAMPLE[:5] + '0' + SAMPLE[6:]


def test_an_empty_one_says_so(running):
    assert running.read(PORT, 24).hex() == 2 * SAMPLE + '000002000002'
    assert running.read(LEVEL, 1) == b'\x00'


def test_a_sample_can_be_read_in_parts(running):
    parts = [running.read(PORT, 3)]
    assert running.read(LEVEL, 1) == b'\x05'
    parts.append(running.read(PORT, 6))
    assert b''.join(parts).hex() == SAMPLE
    assert running.read(LEVEL, 1) == b'\x03'


def test_the_oldest_is_overwritten_and_that_is_told_once(clock, running):
    clock.sleep(0.02)
    assert (running.read(LEVEL, 1), running.read(STATUS, 1)) == (b'\x0c', b'\x00')
    clock.sleep(0.01)
    assert (running.read(LEVEL, 1), running.read(STATUS, 1)) == (b'\x0c', b'\x04')
    assert running.read(STATUS, 1) == b'\x00'


def test_nothing_comes_in_standby_and_after_a_reset(clock, running):
    running.write(RESET, b'\x52')
    assert running.read(CONTROL, 1) == b'\x01'
    clock.sleep(0.1)
    assert running.read(LEVEL, 1) == b'\x00'


def test_power_up_takes_its_time(clock, bus):
    assert not bus.chip.answers(clock.now_ns() - 15_000_000)
    bus.chip.power_up(clock.now_ns())
    assert not bus.chip.answers(clock.now_ns() + 9_000_000)
    assert bus.chip.answers(clock.now_ns() + 10_000_000)


def test_the_low_pass_takes_what_is_above_it(clock, make_source):
    class Filtered(Tagged):
        fifo = Fifo(
            port=Tagged.FIFO_DATA, frame=Tagged.fifo.frame, depth=4, count=Tagged.COUNT, units=3,
            overrun=Tagged.overrun, rate=Tagged.rate, runs=(Tagged.standby, 0), low_pass=0.1,
        )  # fmt: skip

    class Alternating(type(make_source())):
        def samples_until(self, t_ns):
            samples = super().samples_until(t_ns)
            sign = 1.0 - 2.0 * (np.arange(len(samples))[:, np.newaxis] % 2)
            return Samples(samples.stamps, sign * np.ones(3))

    source = Alternating(clock)
    bus = create(Socket(Filtered, 'i2c', 'x', source, clock, Line(clock, Timing.i2c())))['']
    clock.sleep(0.02)
    bus.write(CONTROL, b'\x00')
    clock.sleep(2.0)
    last = Tagged.fifo.frame.unpack(bus.read(OUT, 9))['acceleration'] >> 4
    # of 100 counts at half the rate (1 - p)/(1 + p) are left, p = exp(-0.2 pi)
    assert np.abs(last).max() == pytest.approx(30.4, abs=1.0)


def test_a_fifo_beside_other_dies_needs_a_file(clock, make_source):
    class TwoDies(Tagged):
        wiring: ClassVar = {**Tagged.wiring, 'mag': Wiring(i2c_addresses=(0x1E,))}

    with pytest.raises(ConfigError, match=r'needs imu_bench/emulators/tagged\.py'):
        create(Socket(TwoDies, 'i2c', 'x', make_source(), clock, Line(clock, Timing.i2c())))


def test_a_fifo_that_does_not_fit_is_refused():
    with pytest.raises(ConfigError, match='3 bytes of marks'):

        class Wrong(Tagged):
            fifo = Fifo(
                port=Tagged.FIFO_DATA, frame=Tagged.fifo.frame, depth=4, count=Tagged.COUNT,
                overrun=Tagged.overrun, rate=Tagged.rate, runs=(Tagged.standby, 0),
                marks=b'\0\0\1',
            )  # fmt: skip

    with pytest.raises(ConfigError, match='does not declare'):

        class Foreign(Tagged):
            fifo = Fifo(
                port=Register(0x33), frame=Tagged.fifo.frame, depth=4, count=Tagged.COUNT,
                overrun=Tagged.overrun, rate=Tagged.rate, runs=(Tagged.standby, 0),
            )  # fmt: skip
