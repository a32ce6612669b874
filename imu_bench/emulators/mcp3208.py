# SPDX-License-Identifier: Apache-2.0
"""
An MCP3208 seen from its SPI frames: Microchip DS21298E (MC).

It has no filter: what the sensor does up to half of `SAMPLED_HZ` folds into the samples.
"""

from __future__ import annotations

from imu_bench.emulators.ahead import Source
from imu_bench.registers import Axis
import numpy as np

SAMPLED_HZ = 20_000.0  # twice the bandwidth of the sensor
MIDDLE = 2048
IDLE_NS = 100_000_000


class Mcp3208Chip:
    """A start bit, a choice of input, and twelve bits."""

    foreign = False

    def __init__(self, channel: Axis, source: Source, start_ns: int) -> None:
        self._channel = channel
        self._source = source
        self._code = MIDDLE
        self.power_up(start_ns)

    def power_up(self, at_ns: int) -> None:
        """Begin to sample; what is at the input stays there."""
        self._now_ns = at_ns
        self._source.restart(at_ns, SAMPLED_HZ)

    def transfer(self, frame: bytes, at_ns: int) -> bytes:
        """Return null bit and code behind the start bit; ones before, zeros after."""
        self._sample(at_ns)
        bits = f'{int.from_bytes(frame, "big"):0{8 * len(frame)}b}'
        start = bits.find('1')
        if start < 0 or self.foreign:
            return b'\xff' * len(frame)
        # MC figure 5-2: start, single-ended, D2 to D0, one clock to sample, null bit, code, and
        # the code once more from its second bit on, lowest first
        single_ended = bits[start + 1 : start + 2] == '1'
        code = self._code if single_ended else 0
        sent = '1' * (start + 6) + f'0{code:012b}' + f'{code:012b}'[-2::-1]
        sent = sent[: len(bits)].ljust(len(bits), '0')
        return int(sent, 2).to_bytes(len(frame), 'big')

    def _sample(self, at_ns: int) -> None:
        if at_ns - self._now_ns > IDLE_NS:
            self._source.restart(at_ns - IDLE_NS // 10)
        self._now_ns = at_ns
        samples = self._source.samples_until(at_ns)
        if samples.acceleration is not None and len(samples):
            self._code = int(np.asarray(self._channel.encode(samples.acceleration[-1:]))[0])
