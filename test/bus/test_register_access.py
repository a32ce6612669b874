# SPDX-License-Identifier: Apache-2.0
"""Declared registers over a bus: which transactions there are, and which are refused."""

from imu_bench.bus.register_access import Registers
from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.errors import BusError, ConfigError, NoAnswer, NotReady
from imu_bench.registers import Codes, Field, Register, RegisterMap, Until, Wait, Write
from imu_bench.simulation.clock import SimulatedClock
import pytest


class Chip(RegisterMap):
    ID = Register(0x0F, access='ro', reset=0x33)
    CTRL = Register(0x10, reset=0x80)
    COMMAND = Register(0x11, access='wo')
    WIDE = Register(0x12, size=2)
    FLAGS = Register(0x20, part='other')

    scale = Field(CTRL, (5, 4), Codes({2: 0, 16: 3}), 'g')
    rate = Field(CTRL, (3, 0))
    reset = Field(CTRL, 6, self_clearing=True)
    go = Field(COMMAND, 0)
    high = Field(WIDE, (15, 8))
    low = Field(WIDE, (7, 0))
    ready = Field(FLAGS, 0)


def chip(steps, other=()):
    wires = ScriptedRegisters(steps), ScriptedRegisters(other)
    return Registers(dict(zip(('', 'other'), wires, strict=True)), SimulatedClock(0)), wires


def read(register, answer):
    return ('read', register, len(answer)), answer


def write(register, data):
    return ('write', register, data), b''


def test_fields_of_one_register_are_one_transaction_and_the_rest_is_kept():
    registers, (wire, _) = chip([read(0x10, b'\x85'), write(0x10, b'\xb7')])
    registers.write({Chip.scale: 16, Chip.rate: 7})
    wire.finish()


def test_a_register_whose_bits_are_all_given_is_not_read_first():
    registers, (wire, _) = chip([write(0x12, b'\x01\x02'), write(0x10, b'\x55')])
    registers.write({Chip.high: 1, Chip.low: 2, Chip.CTRL: 0x55})
    wire.finish()


def test_a_write_only_register_is_never_read():
    registers, (wire, _) = chip([write(0x11, b'\x01')])
    registers.write({Chip.go: 1})
    registers.verify({Chip.go: 1})
    wire.finish()
    with pytest.raises(ConfigError, match='write only'):
        registers.word(Chip.COMMAND)


@pytest.mark.parametrize('values', [{Chip.rate: 1, Chip.ID: 1}, {Chip.rate: 1, Chip.scale: 4}])
def test_nothing_is_written_when_a_value_is_refused(values):
    registers, (wire, _) = chip([])
    with pytest.raises(ConfigError):
        registers.write(values)
    wire.finish()


def test_parts_have_their_own_bus():
    registers, (_, other) = chip([], [read(0x20, b'\x01')])
    assert registers.read(Chip.ready) == 1
    other.finish()


def test_what_the_chip_does_not_hold_is_named():
    registers, _ = chip([read(0x10, b'\x80')])
    with pytest.raises(BusError, match=r'script: scale in register CTRL \(0x10\) .* 16, .* 0x80'):
        registers.verify({Chip.scale: 16, Chip.reset: 1})


def test_bits_that_clear_themselves_are_not_compared():
    registers, (wire, _) = chip([read(0x10, b'\xb0')])
    registers.verify({Chip.scale: 16, Chip.reset: 1})
    wire.finish()


def test_sequences_wait_on_the_clock():
    clock = SimulatedClock(0)
    wire = ScriptedRegisters([write(0x10, b'\x01'), read(0x20, b'\x00'), read(0x20, b'\x01')])
    registers = Registers({'': wire, 'other': wire}, clock)
    registers.run(
        (Write({Chip.CTRL: 1}), Wait(0.25), Until(Chip.ready, 1, timeout_s=1.0, period_s=0.5))
    )
    wire.finish()
    assert clock.now_ns() == 750_000_000


def test_waiting_for_a_field_ends():
    registers, _ = chip([], [read(0x20, b'\x00')] * 3)
    with pytest.raises(NotReady, match=r'ready in register other FLAGS .* after 0.01 s'):
        registers.run((Until(Chip.ready, 1, timeout_s=0.01, period_s=0.005),))


def test_a_bus_error_goes_through():
    registers, _ = chip([(('read', 0x0F, 1), NoAnswer('gone'))] * 2)
    with pytest.raises(NoAnswer, match='gone'):
        registers.word(Chip.ID)


NACK = NoAnswer('nothing answers')


def test_a_write_that_took_effect_without_an_acknowledge_is_read_back():
    registers, (wire, _) = chip([(('write', 0x12, b'\x01\x02'), NACK), read(0x12, b'\x01\x02')])
    registers.write({Chip.WIDE: 0x0102})
    wire.finish()


@pytest.mark.parametrize('held', [[read(0x12, b'\x01\x00')], [(('read', 0x12, 2), NACK)] * 2])
def test_a_write_that_did_not_take_effect_is_done_again_once(held):
    refused = ('write', 0x12, b'\x01\x02'), NACK
    registers, (wire, _) = chip([refused, *held, refused])
    with pytest.raises(NoAnswer, match='nothing answers'):
        registers.write({Chip.WIDE: 0x0102})
    wire.finish()
    registers, (wire, _) = chip([refused, *held, write(0x12, b'\x01\x02')])
    registers.write({Chip.WIDE: 0x0102})
    wire.finish()


@pytest.mark.parametrize('steps', [(Chip.reset, 0x10, b'\xc0'), (Chip.go, 0x11, b'\x01')])
def test_a_reset_may_cut_its_own_acknowledge(steps):
    field, register, data = steps
    asked = [read(0x10, b'\x80')] if field is Chip.reset else []
    registers, (wire, _) = chip([*asked, (('write', register, data), NACK)])
    registers.write({field: 1})
    wire.finish()


def test_a_chip_that_starts_is_waited_for():
    silent = (('read', 0x20, 1), NACK)  # asked twice each time
    registers, (_, other) = chip([], [silent, silent, silent, read(0x20, b'\x01')])
    registers.run((Until(Chip.ready, 1, timeout_s=0.01, period_s=0.005),))
    other.finish()
    registers, (_, other) = chip([], [silent] * 6)
    with pytest.raises(NoAnswer):
        registers.run((Until(Chip.ready, 1, timeout_s=0.01, period_s=0.005),))
    other.finish()
