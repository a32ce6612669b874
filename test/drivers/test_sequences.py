# SPDX-License-Identifier: Apache-2.0
"""The words that resets, starts and stops put on the wire, as other drivers write them."""

from pathlib import Path

from imu_bench.drivers import load
from imu_bench.registers import Write
from imu_bench.simulation.clock import SimulatedClock
import pytest
import yaml

TABLES = {
    path.stem: yaml.safe_load(path.read_text('utf-8'))
    for path in (Path(__file__).parents[1] / 'oracles').glob('*.yaml')
}
CASES = [
    (name, sequence, table['driver'], stated)
    for name, table in sorted(TABLES.items())
    for sequence, stated in table.get('sequences', {}).items()
]
DISPUTED = {
    (
        'mpu9250_driverframework',
        'master_steps',
    ): 'its clock, and the wait (0x40) of Linux and eMPL:'
    ' a sample is ready when the slaves have been read',
    ('mpu9250_px4', 'master_steps'): 'it stops between slaves (0x10), of which we have one',
}
BANK = {('iim42652', 0x76)}


class Memory:
    """Registers that hold what is written, and what was written in order."""

    name = 'memory'

    def __init__(self, words=()):
        self.words, self.written = dict.fromkeys(range(128), 0) | dict(words), []

    def read(self, register, length):
        return bytes(self.words[register + k] for k in range(length))

    def write(self, register, data):
        for k, word in enumerate(data):
            self.words[register + k] = word
            self.written.append([register + k, word])


def written(driver, sequence, before):
    """Return what a sequence writes; a reset forgets its bit."""
    part = 'magnetometer' if sequence.startswith('magnetometer') else ''
    settings = {'magnetometer_bypass': True} if part and driver == 'mpu9250' else {}
    found = []
    for step in getattr(load(driver), sequence):
        if isinstance(step, Write):
            wires = {'': Memory(before), 'magnetometer': Memory(before)}
            load(driver)(wires, SimulatedClock(), settings).registers.run((step,))
            found += sorted(wires[part].written)
    return found


@pytest.mark.parametrize(
    ('name', 'sequence', 'driver', 'stated'), CASES, ids=[f'{c[0]}-{c[1]}' for c in CASES]
)
def test_a_sequence_writes_what_the_source_writes(name, sequence, driver, stated):
    registers = {register for register, _ in stated['words']}
    found = written(driver, sequence, stated.get('before', {}))
    agreed = [word for word in found if word[0] in registers] == stated['words']
    assert agreed is ((name, sequence) not in DISPUTED), found


@pytest.mark.parametrize(('driver', 'sequence'), sorted({(c[2], c[1]) for c in CASES}))
def test_nothing_is_written_there_that_no_source_writes(driver, sequence):
    agreeing = [c[3]['words'] for c in CASES if c[1:3] == (sequence, driver)]
    stated = {(driver, register) for words in agreeing for register, _ in words} | BANK
    assert {(driver, register) for register, _ in written(driver, sequence, {})} <= stated


@pytest.mark.parametrize('name', [name for name, table in TABLES.items() if 'fifo' in table])
def test_what_the_fifo_holds_comes_in_the_order_of_the_source(name):
    made = load(TABLES[name]['driver'])({'': Memory(), 'magnetometer': Memory()}, None, {})
    assert list(made._frame.dtype.names) == TABLES[name]['fifo']
