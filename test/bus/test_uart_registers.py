# SPDX-License-Identifier: Apache-2.0
"""Registers of a BNO055 behind its serial line."""

from collections import Counter

from imu_bench.bus.scripted import ScriptedStream
from imu_bench.bus.uart_registers import UartRegisters
from imu_bench.errors import BusError, FrameError, NoAnswer
from imu_bench.simulation.clock import SimulatedClock
import pytest

READ_ID = bytes.fromhex('aa010001')
NDOF = bytes.fromhex('aa003d010c')


def registers(*steps, arriving='', silent=()):
    counters = Counter()
    script = [(command, bytes.fromhex(answer)) for command, answer in steps]
    line = ScriptedStream(script, bytes.fromhex(arriving))
    return UartRegisters(line, SimulatedClock(), counters, silent), line, counters


def test_reading_and_writing():
    made, line, counters = registers((READ_ID, 'bb01a0'), (NDOF, 'ee01'))
    assert made.read(0x00, 1) == b'\xa0'
    made.write(0x3D, b'\x0c')
    line.finish()
    assert not +counters
    made.close()
    assert line.closed


def test_commands_have_a_pause_between_them():
    made, _, _ = registers((READ_ID, 'bb01a0'), (READ_ID, 'bb01a0'))
    made.read(0x00, 1)
    start = made._clock.now_ns()
    made.read(0x00, 1)
    assert made._clock.now_ns() - start >= 2_000_000


@pytest.mark.parametrize('answer', ['ee07', 'ee02', 'ee0a', '', 'bb02a0a0', '00', 'bb01'])
def test_what_went_wrong_is_counted_and_asked_for_again(answer):
    made, line, counters = registers((READ_ID, answer), (READ_ID, 'bb01a0'))
    assert made.read(0x00, 1) == b'\xa0'
    line.finish()
    assert counters['uart_errors'] == 1


@pytest.mark.parametrize(
    ('answer', 'error', 'text'),
    [
        ('', NoAnswer, 'register 0x00: nothing answers; check power, PS1'),
        ('ee07', BusError, '0x07, bus overrun'),
        ('ee01', FrameError, 'belongs to another command'),
        ('bb03000000', FrameError, 'belongs to another command'),
    ],
)
def test_what_stays_wrong_is_an_error(answer, error, text):
    made, line, counters = registers(*[(READ_ID, answer)] * 4)
    with pytest.raises(error, match=text):
        made.read(0x00, 1)
    line.finish()
    assert counters['uart_errors'] == 4


@pytest.mark.parametrize(('answer', 'text'), [('ee05', 'in this mode'), ('ee04', 'this page')])
def test_a_refusal_is_an_error_at_once(answer, text):
    made, line, _ = registers((NDOF, answer))
    with pytest.raises(BusError, match=text):
        made.write(0x3D, b'\x0c')
    line.finish()


def test_old_bytes_are_thrown_away_before_a_command():
    made, _, counters = registers((READ_ID, 'bb01a0'), arriving='bb0147ee')
    assert made.read(0x00, 1) == b'\xa0'
    assert counters['garbage_bytes'] == 4


def test_noise_before_an_answer_is_counted():
    made, _, counters = registers((READ_ID, '0013bb01a0'))
    assert made.read(0x00, 1) == b'\xa0'
    assert counters['garbage_bytes'] == 2


def test_a_chip_that_resets_need_not_answer():
    made, line, counters = registers((bytes.fromhex('aa003f0120'), ''), silent=(0x3F,))
    made.write(0x3F, b'\x20')
    line.finish()
    assert not +counters
