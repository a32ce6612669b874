# SPDX-License-Identifier: Apache-2.0
"""Scripted wires complain about everything that differs; adapters on top of them."""

from collections import Counter

from imu_bench.bus.auxiliary import AuxiliaryBus
from imu_bench.bus.banked import BankedBus
from imu_bench.bus.failures import CountingBus
from imu_bench.bus.scripted import ScriptedFrames, ScriptedRegisters, ScriptedStream
from imu_bench.errors import BusBusy, BusError, FrameError, NoAnswer
from imu_bench.registers import Register
from imu_bench.simulation.clock import SimulatedClock
import pytest


def test_a_different_transfer_is_an_error():
    bus = ScriptedRegisters([(('read', 0x0F, 1), b'\x68')])
    with pytest.raises(FrameError, match=r"expects \('read', 15, 1\), but this came"):
        bus.read(0x0F, 2)


def test_a_transfer_after_the_end_is_an_error():
    with pytest.raises(FrameError, match='over'):
        ScriptedFrames([]).transfer(b'\x00')


def test_leftovers_are_an_error():
    with pytest.raises(FrameError, match='1 step'), ScriptedFrames([(b'a', b'b')]):
        pass


def test_leftovers_do_not_hide_the_first_error():
    with pytest.raises(ValueError, match='first'), ScriptedFrames([(b'a', b'b')]):
        raise ValueError('first')


def test_a_stream_answers_what_was_written():
    line = ScriptedStream([(b'\xaa\x01', b'\xbb')], arriving=b'noise')
    assert line.read(0.1) == b'noise'
    line.write(b'\xaa\x01')
    assert line.read(0.1) == b'\xbb'
    line.finish()


def test_errors_are_counted_and_passed_on():
    counters = Counter()
    steps = [(('read', 1, 1), NoAnswer('a')), (('write', 1, b'x'), BusBusy('b'))]
    bus = CountingBus(ScriptedRegisters(steps), counters)
    with pytest.raises(NoAnswer):
        bus.read(1, 1)
    with pytest.raises(BusBusy):
        bus.write(1, b'x')
    assert counters == {'bus_errors': 2}


# --- banks -------------------------------------------------------------------------------
SELECT = Register(0x76)
HERE, THERE = Register(0x10, bank=0), Register(0x10, bank=1)


def test_a_bank_is_selected_once_and_after_forgetting_again():
    steps = [
        (('write', 0x76, b'\x00'), b''),
        (('read', 0x10, 1), b'a'),
        (('read', 0x10, 2), b'ab'),
        (('write', 0x76, b'\x01'), b''),
        (('write', 0x10, b'z'), b''),
        (('read', 0x76, 1), b'\x01'),
        (('write', 0x76, b'\x01'), b''),
        (('read', 0x10, 1), b'c'),
    ]
    with ScriptedRegisters(steps) as wire:
        bus = BankedBus(wire, SELECT.number)
        assert bus.read(HERE.number, 1) == b'a'
        assert bus.read(HERE.number, 2) == b'ab'
        bus.write(THERE.number, b'z')
        bus.read(SELECT.number, 1)
        bus.forget()
        assert bus.read(THERE.number, 1) == b'c'


def test_a_failed_selection_is_not_taken_for_done():
    steps = [
        (('write', 0x76, b'\x01'), NoAnswer('gone')),
        (('read', 0x76, 1), b'\x00'),
        (('write', 0x76, b'\x01'), b''),
        (('read', 0x10, 1), b'a'),
    ]
    with ScriptedRegisters(steps) as wire:
        bus = BankedBus(wire, SELECT.number)
        with pytest.raises(BusError):
            bus.read(THERE.number, 1)
        bus.read(THERE.number, 1)


def test_a_selection_may_be_taken_without_an_acknowledge():
    steps = [
        (('write', 0x76, b'\x01'), NoAnswer('busy')),
        (('read', 0x76, 1), b'\x01'),
        (('read', 0x10, 1), b'a'),
    ]
    with ScriptedRegisters(steps) as wire:
        assert BankedBus(wire, SELECT.number).read(THERE.number, 1) == b'a'


def test_writing_the_selection_is_remembered():
    steps = [(('write', 0x76, b'\x01'), b''), (('read', 0x10, 1), b'a')]
    with ScriptedRegisters(steps) as wire:
        bus = BankedBus(wire, SELECT.number)
        bus.write(SELECT.number, b'\x01')
        bus.read(THERE.number, 1)


# --- slave 4 of the auxiliary master -----------------------------------------------------
def test_a_byte_behind_the_auxiliary_master():
    steps = [
        (('read', 0x36, 1), b'\x40'),  # left over from before
        (('write', 0x31, b'\x8c\x00\x00\x80'), b''),
        (('read', 0x36, 1), b'\x00'),
        (('read', 0x36, 1), b'\x40'),
        (('read', 0x35, 1), b'\x48'),
        (('read', 0x36, 1), b'\x00'),
        (('write', 0x31, b'\x0c\x0a\x16\x80'), b''),
        (('read', 0x36, 1), b'\x40'),
        (('read', 0x35, 1), b'\x48'),
    ]
    with ScriptedRegisters(steps) as wire:
        bus = AuxiliaryBus(wire, SimulatedClock(0), 0x0C)
        assert bus.read(0x00, 1) == b'\x48'
        bus.write(0x0A, b'\x16')


def test_nobody_behind_the_auxiliary_master():
    steps = [
        (('read', 0x36, 1), b'\x00'),
        (('write', 0x31, b'\x8c\x00\x00\x80'), b''),
        (('read', 0x36, 1), b'\x50'),
    ]
    bus = AuxiliaryBus(ScriptedRegisters(steps), SimulatedClock(0), 0x0C)
    with pytest.raises(NoAnswer, match='auxiliary 0x0C'):
        bus.read(0x00, 1)


def test_a_master_that_does_not_finish():
    steps = [(('read', 0x36, 1), b'\x00'), (('write', 0x31, b'\x8c\x00\x00\x80'), b'')]
    steps += [(('read', 0x36, 1), b'\x00')] * 3
    bus = AuxiliaryBus(ScriptedRegisters(steps), SimulatedClock(0), 0x0C, timeout_s=0.002)
    with pytest.raises(BusBusy, match='0x00 took too long'):
        bus.read(0x00, 1)
