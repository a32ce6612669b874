# SPDX-License-Identifier: Apache-2.0
"""What may go wrong on an emulated bench, and the script that says when."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import difflib
import math
from typing import Any

from imu_bench.config.schema import Setting
from imu_bench.errors import ConfigError

KINDS = {
    'no_answer': 'a wire is open; the chip keeps its supply',
    'unplugged': 'no answer, and afterwards the chip is at its reset values',
    'stuck': 'a data line is held low; every transfer fails',
    'stretched': 'the chip stretches the clock past the limit; every transfer fails late',
    'executes_without_ack': 'what is written takes effect, but is not acknowledged',
    'busy': 'every tenth transfer is not acknowledged, and not carried out',
    'stuck_fifo': 'a FIFO takes no more samples until it is configured again',
    'slow_boot': 'off and on, then silent for twice the time of its document, after resets too',
    'permission_denied': 'the device may not be opened any more',
    'wrong_identity': 'another chip is plugged in, and at the end the right one again',
    'brown_out': 'the chip is back at its reset values, silently',
    'stall': 'somebody else holds the bus for the time given: FIFOs run over',
    'garbage': 'what is read is noise',
    'bit_error': 'one bit of what is read is wrong, once',
    'bit_errors': 'a bit of every transfer is wrong',
    'dropped_byte': 'a byte of a serial line is lost, once',
    'half_frame': 'what comes over a serial line breaks off in the middle of a frame, once',
}
"""Every fault there is, and what it stands for."""

ONCE = frozenset({'brown_out', 'stuck_fifo', 'bit_error', 'dropped_byte', 'half_frame'})
"""Those that happen once, however long they are said to last."""

ONLY_ON = {
    'stretched': ('i2c',),
    'executes_without_ack': ('i2c',),
    'busy': ('i2c',),
    'slow_boot': ('i2c', 'spi'),
    'garbage': ('i2c', 'spi', 'frame', 'serial'),
    'bit_error': ('i2c', 'spi', 'frame', 'serial'),
    'bit_errors': ('i2c', 'spi', 'frame', 'serial'),
    'dropped_byte': ('serial',),
    'half_frame': ('serial',),
}
"""Kinds of bus on which a fault can happen, where it cannot on every one."""

_FORM = "write 'kind start_s duration_s', like 'unplugged 10 2'"


@dataclass(frozen=True)
class Fault:
    """
    One fault.

    Raises
    ------
    ConfigError
        If the kind is not known.

    Examples
    --------
    >>> Fault('unplugged', 10.0, 2.0).over_s
    12.0
    >>> Fault('brown_out', 10.0).over_s
    10.0
    """

    kind: str  # one of `KINDS`
    at_s: float = 0.0  # start, in seconds after the sensor was switched on
    for_s: float = math.inf  # duration; those of `ONCE` happen once whatever it says

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError(f'fault {self.kind!r} is not known; there are {", ".join(KINDS)}')

    @property
    def over_s(self) -> float:
        """End, in seconds after the sensor was switched on."""
        return self.at_s if self.kind in ONCE else self.at_s + self.for_s


def parse_fault(text: str) -> Fault:
    """Return the fault of one entry of a script."""
    kind, *numbers = text.split() or ['']
    if kind not in KINDS:
        close = difflib.get_close_matches(kind, KINDS, n=1, cutoff=0.7)
        meant = f'did you mean {close[0]!r}? ' if close else ''
        raise ConfigError(
            f'{text!r}: there is no fault {kind!r}; {meant}allowed: {", ".join(KINDS)}'
        )
    try:
        times = [float(number) for number in numbers]
    except ValueError:
        raise ConfigError(f'{text!r}: start and duration are numbers; {_FORM}') from None
    if not 1 <= len(times) <= 2 or (len(times) == 1 and kind not in ONCE):
        raise ConfigError(f'{text!r}: needs a start and a duration; {_FORM}')
    if not all(0.0 <= time < math.inf for time in times) or times[1:] == [0.0]:
        raise ConfigError(f'{text!r}: starts before 0 s, or lasts no finite time; {_FORM}')
    return Fault(kind, *times)


def script(texts: Iterable[str]) -> tuple[Fault, ...]:
    """Return the faults of a script in the order of their beginnings; raises as `parse_fault`."""
    return tuple(sorted(map(parse_fault, texts), key=lambda fault: fault.at_s))


class FaultScript(Setting):
    """The setting that holds a script: a list of texts, each of them checked."""

    @property
    def constraint(self) -> str:
        """What is allowed, in words."""
        return f"a list of 'kind start_s duration_s' with the kinds {', '.join(KINDS)}"

    def check(self, value: object) -> Any:
        """Return the entries."""
        texts = super().check(value)
        script(texts)
        return texts


FAULTS = FaultScript(
    'simulation.faults', (), 'Faults of the wire, each as kind start_s duration_s.', kind='strs'
)
"""What goes wrong on the wire of an emulated sensor, and when."""
