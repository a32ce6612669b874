# SPDX-License-Identifier: Apache-2.0
"""A BNO055 that hangs until the line at its reset pin is pulled."""

from imu_bench.drivers.bno055 import Bno055
from imu_bench.emulators import create
from imu_bench.errors import NoAnswer, NotReady
import pytest


class Hanging:
    """A chip that answers no more until its reset pin was low."""

    name = 'hanging'

    def __init__(self, bus):
        self._bus, self.hangs = bus, False

    def _answer(self):
        if self.hangs:
            raise NoAnswer('nothing answers')

    def read(self, register, length):
        self._answer()
        return self._bus.read(register, length)

    def write(self, register, data):
        self._answer()
        self._bus.write(register, data)


@pytest.mark.parametrize('kind', ['i2c', 'serial'])
def test_a_chip_that_hangs_is_reset_by_its_line(clock, make_source, kind):
    buses = create('bno055', kind, make_source(), clock, lines=('reset_line',))
    clock.sleep(0.65)
    levels = []
    pin = buses['reset_line']
    wire = buses[''] = Hanging(buses['']) if kind == 'i2c' else buses['']
    real = pin.drive

    def drive(high):
        levels.append((high, clock.now_ns()))
        real(high)
        wire.hangs = False

    pin.drive = drive
    made = Bno055(buses, clock, {})
    made.configure()
    assert levels == []
    wire.hangs = kind == 'i2c'
    if kind == 'i2c':
        with pytest.raises(NoAnswer):
            made.configure()
    else:
        with pytest.raises(NotReady):
            made._give_up('SYS_ERR')
    before = clock.now_ns()
    made.configure()
    made.start()
    assert [high for high, _ in levels] == [False, True]
    assert levels[1][1] - levels[0][1] >= 20
    # DS table 0-2: 650 ms from reset to configuration
    assert clock.now_ns() - before > 650_000_000
