# SPDX-License-Identifier: Apache-2.0
"""The host's side of a FIFO of slots: what is believed, and when a loss cannot be ruled out."""

from collections import Counter

from imu_bench.bus.polled_quantity import PolledQuantity
from imu_bench.bus.register_access import Registers
from imu_bench.bus.slots import SlotFifo
from imu_bench.errors import BusError
from imu_bench.registers import Field, Frame, Register, Scalar
from imu_bench.simulation.clock import SimulatedClock
import pytest

CONTROL, SOURCE = Register(0x2E), Register(0x2F, access='ro')
OUT = Register(0x28, access='ro', size=2)
WORDS = Scalar(first=OUT, quantity='temperature', unit='°C', dtype='<i2', si_per_lsb=1.0)


class Chip:
    """A bus on which every transfer takes its time."""

    name = 'chip'

    def __init__(self, clock, level, flags=0, transfer_s=1e-4, slot_s=3e-4, running=(0x80, 0x80)):
        self.clock, self.level, self.flags = clock, level, flags
        self.transfer_s, self.slot_s = transfer_s, slot_s
        self.running = iter(running)

    def read(self, register, length):
        if register == 0x28:
            self.clock.sleep(length / 2 * self.slot_s)
            return bytes(k // 2 if k % 2 == 0 else 0 for k in range(length))
        self.clock.sleep(self.transfer_s)
        return bytes([next(self.running), self.level | self.flags][:length])


@pytest.fixture
def clock():
    return SimulatedClock()


def fifo(clock, chip, rate_hz=1000.0):
    return SlotFifo(
        Registers({'': chip}, clock),
        clock,
        Counter(),
        control=CONTROL,
        running=0x80,
        level=Field(SOURCE, (5, 0)),
        overrun=Field(SOURCE, 6),
        first=OUT,
        frame=Frame(WORDS),
        depth=32,
        rate_hz=rate_hz,
    )


@pytest.mark.parametrize(
    ('level', 'slot_s', 'gap'),
    [
        (8, 3e-4, False),
        (20, 3e-4, False),  # 8.2 ms until the end: 20 + 9
        (26, 3e-4, True),  # the bus may have been taken away before the first slot
        (8, 4e-3, True),  # too slow: in 28 ms it may have run over
    ],
)
def test_without_the_flag_a_loss_is_ruled_out_only_if_it_was_impossible(clock, level, slot_s, gap):
    slots = fifo(clock, Chip(clock, level, slot_s=slot_s)).take()
    assert len(slots.words) == len(slots.stamps) == level - 1
    assert (slots.overrun, slots.gap) == (False, gap)


def test_stamps_count_back_from_the_level_and_after_a_loss_from_the_end(clock):
    slots = fifo(clock, Chip(clock, 4)).take()
    latched = clock.now_ns() - 100_000 - 3 * 300_000 - 50_000
    assert (slots.stamps - latched).tolist() == [-3_000_000, -2_000_000, -1_000_000]
    slots = fifo(clock, Chip(clock, 4, flags=0x40)).take()
    assert slots.overrun
    assert slots.gap
    assert (slots.stamps - clock.now_ns()).tolist() == [-3_000_000, -2_000_000, -1_000_000]


@pytest.mark.parametrize('running', [(0x00, 0x80), (0x80, 0x00)])
def test_what_is_not_in_its_mode_before_and_after_is_nothing(clock, running):
    made = fifo(clock, Chip(clock, 4, running=running))
    assert made.take() is None
    assert made.torn == (running[0] == 0x80)


def test_a_level_beyond_the_depth_is_a_bus_error(clock):
    made = fifo(clock, Chip(clock, 33))
    with pytest.raises(BusError, match='33 of 32'):
        made.take()
    assert made._counters == {'bus_errors': 1}


def test_slots_are_skipped_across_bursts(clock):
    made = fifo(clock, Chip(clock, 4, running=[0x80] * 6))
    made.skip = 5
    assert [made.take().words['temperature'].tolist() for _ in range(3)] == [[], [2], [0, 1, 2]]


# --- what is looked at now and then ------------------------------------------------------
def test_what_came_and_went_between_two_looks_is_counted(clock):
    field = PolledQuantity(clock, 100.0)
    field.begin()
    clock.sleep(0.0101)
    field.found()
    clock.sleep(0.036)
    stamps = field.found()
    assert field.lost == 2
    assert stamps.tolist() == [clock.now_ns() - 18_000_000]
    clock.sleep(0.005)
    field.found(overrun=True)
    assert field.lost == 3


def test_what_was_overwritten_before_the_beginning_is_no_loss(clock):
    field = PolledQuantity(clock, 100.0)
    field.begin()
    field.found(overrun=True)
    assert field.lost == 0


def test_silence_is_told_once_and_again_after_as_long(clock):
    field = PolledQuantity(clock, 100.0)
    field.begin()
    told = []
    for _ in range(60):
        clock.sleep(0.01)
        told.append(field.silent)
    assert told.count(True) == 2
    assert not any(told[:25])
