# SPDX-License-Identifier: Apache-2.0
"""
An ADS1115 seen from the wire: TI SBAS444D (TI).

Its modulator is imitated by samples at eight times the data rate, of which a conversion is
the mean.
"""

from __future__ import annotations

from imu_bench.bus.converters.ads1115 import Ads1115Registers, WAKE_S
from imu_bench.emulators.ahead import Source
from imu_bench.emulators.register_map import EmulatedChip
from imu_bench.registers import Axis, Field, Value
import numpy as np

OVERSAMPLING = 8
_CONVERSION, _CONFIG = Ads1115Registers.CONVERSION.address, Ads1115Registers.CONFIG.address
_READ_ONLY = 0x8000
_RESET = {0: 0x0000, 1: 0x8583, 2: 0x8000, 3: 0x7FFF}


class Ads1115Chip(EmulatedChip):
    """Four registers of 16 bits behind a pointer."""

    def __init__(
        self, channel: Axis, source: Source, start_ns: int, *, rate_error: float = 0.0
    ) -> None:
        super().__init__(())
        self._channel = channel
        self._source = source
        self._stretch = 1.0 / (1.0 + rate_error)
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin at the reset values: single conversions, resting."""
        self._words = dict(_RESET)
        self._result = 0
        self._begun_ns: int | None = None
        self._stamps = np.empty(0, dtype=np.int64)
        self._values = np.empty((0, 3))
        self._choose_rate(at_ns)

    def read(self, first: int, length: int, at_ns: int, byte_ns: float) -> bytes:
        """Return the register of the pointer, high byte first, again and again."""
        self._convert(at_ns)
        word = self._words[first & 3]
        if first & 3 == _CONVERSION:
            word = self._result & 0xFFFF
        elif first & 3 == _CONFIG:
            converting = self._begun_ns is not None
            word = word & ~_READ_ONLY | (0 if converting else _READ_ONLY)
        return (word.to_bytes(2, 'big') * (length // 2 + 1))[:length]

    def write(self, first: int, data: bytes, at_ns: int) -> None:
        """Take a word; one with its highest bit set begins a conversion."""
        self._convert(at_ns)
        number, word = first & 3, int.from_bytes(data[:2], 'big')
        if number == _CONVERSION or len(data) < 2:
            return
        self._words[number] = word
        if number == _CONFIG:
            self._choose_rate(at_ns)
            continuous = not word & Ads1115Registers.ads1115_mode.mask
            if continuous or word & _READ_ONLY:
                self._begun_ns = at_ns + round(WAKE_S * 1e9)

    # --- conversions ---------------------------------------------------------------------
    def _value(self, field: Field) -> Value:
        return field.extract(self._words[_CONFIG])

    def _choose_rate(self, at_ns: int) -> None:
        rate = float(self._value(Ads1115Registers.ads1115_rate))
        self._period_ns = 1e9 / rate * self._stretch
        self._source.restart(at_ns, OVERSAMPLING * rate)

    def _convert(self, now_ns: int) -> None:
        """Finish the conversions that are over."""
        samples = self._source.samples_until(now_ns)
        if samples.acceleration is not None and len(samples):
            self._stamps = np.concatenate([self._stamps, samples.stamps])
            self._values = np.concatenate([self._values, samples.acceleration])
        if self._begun_ns is None:
            self._forget(now_ns)
            return
        whole = int((now_ns - self._begun_ns) / self._period_ns)
        if whole < 1:
            return
        continuous = self._value(Ads1115Registers.ads1115_mode) == 'continuous'
        whole = whole if continuous else 1
        end = self._begun_ns + round(whole * self._period_ns)
        window = (self._stamps > end - self._period_ns) & (self._stamps <= end)
        if window.any():
            mean = self._values[window].mean(axis=0, keepdims=True)
            range_ = self._value(Ads1115Registers.ads1115_range)
            self._result = int(self._channel.encode(mean, range_)[0])
        self._begun_ns = end if continuous else None
        self._forget(end)

    def _forget(self, before_ns: int) -> None:
        keep = self._stamps > before_ns
        self._stamps, self._values = self._stamps[keep], self._values[keep]
