# SPDX-License-Identifier: Apache-2.0
"""
What happened on the wires of one sensor, written while it runs and played again without it.

A driver and its acquisition get everything from outside: a clock and the wires of the chip.
`Recorder` stands around both and writes every reading of the clock and every transfer, with its
answer or its error; `Player` stands in their place and gives the same in the same order, so that
the same code makes the same samples, to the bit.
"""

from imu_bench.bus.recording.file import Head, read_head
from imu_bench.bus.recording.player import Played, Player
from imu_bench.bus.recording.recorder import Recorder

__all__ = ['Head', 'Played', 'Player', 'Recorder', 'read_head']
