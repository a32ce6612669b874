# SPDX-License-Identifier: Apache-2.0
"""
TI ADS1115: 16 bits on I²C.

Document: SBAS444D (TI).  It has neither FIFO nor filter, and its oscillator is off by up to
10 %: each conversion is started by the host, so that its time is known.
"""

from __future__ import annotations

from collections import Counter

from imu_bench.bus.converters.converter import Converter, Reading
from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.bus.register_access import Registers
from imu_bench.registers import Codes, Field, Register, RegisterMap, Value
import numpy as np

PART = 'ads1115'
TOLERANCE = 1.1  # TI section 7.5: data rate ±10 %
WAKE_S = 25e-6  # TI section 9.4.2.1
TRANSFERS_S = 0.5e-3  # reading and starting, at 400 kHz


class Ads1115Registers(RegisterMap):
    """TI section 9.6; a sensor behind an ADS1115 inherits them."""

    CONVERSION = Register(0x00, access='ro', size=2, addresses=1, part=PART)
    CONFIG = Register(0x01, reset=0x8583, size=2, addresses=1, part=PART)
    LO_THRESH = Register(0x02, reset=0x8000, size=2, addresses=1, part=PART)
    HI_THRESH = Register(0x03, reset=0x7FFF, size=2, addresses=1, part=PART)

    # fmt: off
    ads1115_start = Field(CONFIG, 15, self_clearing=True)  # reads 1 when no conversion runs
    ads1115_input = Field(
        CONFIG, (14, 12), Codes({'A0-A1': 0, 'A0-A3': 1, 'A1-A3': 2, 'A2-A3': 3,
                                 'A0': 4, 'A1': 5, 'A2': 6, 'A3': 7}))
    ads1115_range = Field(
        CONFIG, (11, 9),
        Codes({6.144: 0, 4.096: 1, 2.048: 2, 1.024: 3, 0.512: 4, 0.256: 5},
              aliases={6: (0.256, 'TI table 8: 101 to 111'), 7: (0.256, 'TI table 8')}), 'V')
    ads1115_mode = Field(CONFIG, 8, Codes({'continuous': 0, 'single': 1}))
    ads1115_rate = Field(
        CONFIG, (7, 5),
        Codes({8.0: 0, 16.0: 1, 32.0: 2, 64.0: 3, 128.0: 4, 250.0: 5, 475.0: 6, 860.0: 7}), 'Hz')
    ads1115_comparator = Field(CONFIG, (4, 2))
    ads1115_queue = Field(CONFIG, (1, 0), Codes({'one': 0, 'two': 1, 'four': 2, 'off': 3}))
    # fmt: on


_R = Ads1115Registers


class Ads1115(Converter):
    """
    The converter.

    Parameters
    ----------
    wire, clock, counters, rate_hz
        As for `Converter`.
    registers : Registers
        On that wire.
    """

    part = PART
    usual_hz = 500.0

    def __init__(
        self,
        wire: RegisterBus,
        clock: Clock,
        counters: Counter[str],
        rate_hz: float,
        *,
        registers: Registers,
        input_name: Value,
        range_v: Value,
    ) -> None:
        super().__init__(wire, clock, counters, rate_hz)
        self._registers = registers
        self._started_ns = 0
        self.assignments: dict[Field, Value] = {
            _R.ads1115_start: 0,
            _R.ads1115_input: input_name,
            _R.ads1115_range: range_v,
            _R.ads1115_mode: 'single',
            _R.ads1115_rate: 1.0 / self._conversion_s,
            _R.ads1115_comparator: 0,
            _R.ads1115_queue: 'off',
        }

    def checked_rate(self, rate_hz: float) -> float:
        """Choose the slowest conversion that is over in time: it averages most."""
        for data_rate in _R.ads1115_rate.allowed:
            self._conversion_s = 1.0 / float(data_rate)
            needed = self._conversion_s * TOLERANCE + WAKE_S + TRANSFERS_S
            if needed <= 1.0 / rate_hz:
                return rate_hz
        raise self.refused('rate_hz', f'{rate_hz:g}', f'up to {1.0 / needed:.0f} Hz')

    def identify(self) -> str:
        """Return its name; no register says so, but it has to answer."""
        self._registers.word(_R.CONFIG)
        return f'ADS1115 on {self.wire.name}'

    def configure(self) -> None:
        """Do nothing: the driver has written the assignments and read them back."""

    def start(self) -> None:
        """Begin a conversion."""
        self._registers.write({**self.assignments, _R.ads1115_start: 1})
        self._started_ns = self.clock.now_ns()

    def read(self) -> Reading:
        """Return the conversion begun last time, and begin the next one."""
        config = self._registers.word(_R.CONFIG)
        for field, value in self.assignments.items():
            if not field.self_clearing and field.insert(config, value) != config:
                return Reading(lost=True)
        if not config & _R.ads1115_start.mask:
            self.counters['late_conversions'] += 1
            return Reading()
        word = np.frombuffer(self._registers.burst(_R.CONVERSION), dtype='>i2')
        middle = self._started_ns + round((WAKE_S + self._conversion_s / 2) * 1e9)
        self.start()
        return Reading(np.array([middle]), word)

    def stop(self) -> None:
        """Do nothing: after a conversion it rests."""

    def release(self) -> None:
        """Do nothing."""
