# SPDX-License-Identifier: Apache-2.0
"""What every sensor driver has: settings, identity, configuration, recovery, counters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping
from typing import Any, ClassVar

from imu_bench.bus.edges import Edges
from imu_bench.bus.failures import CountingBus
from imu_bench.bus.interface import (
    ByteStream,
    Clock,
    DaqBoard,
    DATA_READY,
    EdgeLine,
    FrameBus,
    OutputLine,
    RegisterBus,
    RESET_LINE,
)
from imu_bench.bus.register_access import Registers
from imu_bench.bus.wiring import Wiring
from imu_bench.config.schema import check_all, raise_if_any, Setting
from imu_bench.errors import IdentityError, NoAnswer
from imu_bench.registers import (
    Channel,
    Field,
    Identity,
    RegisterMap,
    Sequence,
    Typical,
    Value,
    Witness,
)
from imu_bench.samples import Samples
import numpy.typing as npt

Bus = RegisterBus | FrameBus | ByteStream | DaqBoard | EdgeLine | OutputLine


RESET_LOW_S = 1e-3
"""Longer than a chip asks for: 20 ns (BNO055, BST-BNO055-DS000-12, pin nRESET)."""


def choice(name: str, field: Field, default: Value, description: str) -> Setting:
    """
    Return the setting whose values are those of a register field.

    With the name of the field's own attribute, `configure` writes it to the field.
    """
    return Setting(name, default, description, field.allowed, unit=field.unit)


class Driver(RegisterMap, ABC):
    """
    Base of every sensor driver.

    Parameters
    ----------
    bus : RegisterBus, FrameBus or ByteStream, or a mapping of part name to one
        A sensor with one die takes its bus alone.
    clock : Clock
        The only way a driver knows the time or waits.

    Raises
    ------
    ConfigError
        Every setting that is unknown or not allowed, at once.  No bus is touched.

    Attributes
    ----------
    values : dict
        Every setting.
    counters : Counter
        What happened, by the names in `counter_names` of the class and its bases; all of them
        are there from the start.  A restart is a stream begun anew because of a failure.
    configured : bool
        The chip holds the settings, as far as is known.
    trims : dict
        Sensitivity corrections read from the chip, by quantity, in the order of the registers.
    continuity : int
        Increases whenever samples were lost between two reads (overflow, reset, restart), so
        that the clock model starts anew and the gap is counted.
    dated : bool
        False while they are read so seldom that only the time tells how many passed in between.
    rates_hz : mapping of str to float
        The nominal rate of each quantity that has one of its own.
    edge : (int, int) or None
        When a sample of the main run that `read` returned last was measured, by the data-ready
        line; `back` counts from the last of that run.
    latch_ns : int or None
        So long took the transfer during which the newest sample was known to be there; the middle
        of it is stamped.  None where nobody knows how long samples have waited.
    skipped : dict of int to int
        Of a chip that numbers its samples: how many are missing before a run of those that
        `read` returned last, by the place of the run.  The clock model goes on then.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    document: ClassVar[str]
    bus_kinds: ClassVar[tuple[str, ...]]
    start_up_s: ClassVar[float] = 0.05
    """From power-up until the chip answers."""
    wiring: ClassVar[Mapping[str, Wiring]]
    data_ready_pin: ClassVar[str] = ''
    """The pin that can say when there are data; none if empty."""
    reset_pin: ClassVar[str] = ''
    """The pin that resets it when it is low; none if empty."""
    identities: ClassVar[tuple[Identity, ...]] = ()
    # values by the names of `settings`; the rest keep their defaults
    settings: ClassVar[tuple[Setting, ...]] = ()
    described: ClassVar[tuple[str, ...]] = ()
    """Those that say what the device does by itself; its emulation does so."""
    counter_names: ClassVar[tuple[str, ...]] = (
        'bus_errors', 'brown_outs', 'restarts', 'saturated'
    )  # fmt: skip
    """What is counted, beside what the bases of a class count."""
    reset_steps: ClassVar[Sequence] = ()
    start_steps: ClassVar[Sequence] = ()
    stop_steps: ClassVar[Sequence] = ()
    typical: ClassVar[Mapping[str, Typical]] = {}
    witnesses: ClassVar[tuple[Witness, ...]] = ()

    def __init__(
        self, bus: Bus | Mapping[str, Bus], clock: Clock, settings: Mapping[str, object]
    ) -> None:
        self.values = self.check_settings(settings)
        self.clock = clock
        self.counters: Counter[str] = Counter(
            {
                name: 0
                for base in reversed(type(self).__mro__)
                for name in vars(base).get('counter_names', ())
            }
        )
        self.continuity = 0
        self.dated = True
        self.rates_hz: Mapping[str, float] = {}
        self.skipped: dict[int, int] = {}
        self.configured = False
        self.trims: dict[str, Any] = {}
        self._wires: dict[str, Bus] = dict(bus) if isinstance(bus, Mapping) else {'': bus}
        line: Any = self._wires.pop(DATA_READY, None)
        self.reset_line: Any = self._wires.pop(RESET_LINE, None)
        self.edges = None if line is None else Edges(line, self.counters)
        self.edge: tuple[int, int] | None = None
        self.latch_ns: int | None = None
        self.registers = Registers(
            {
                part: CountingBus(wire, self.counters)
                for part, wire in self.register_buses(self._wires).items()
            },
            clock,
        )

    @classmethod
    def check_settings(cls, given: Mapping[str, object]) -> dict[str, Value]:
        """
        Return every setting, those given and the defaults.

        Raises
        ------
        ConfigError
            With every problem at once.
        """
        problems: list[str] = []
        values = check_all(given, cls.settings, cls.name, problems)
        raise_if_any(problems)
        return values

    @classmethod
    def channels_on(cls, kind: str) -> Mapping[str, Channel]:
        """Return the channels that a sensor on such a bus has, by name."""
        return cls.channels()

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        """
        Return a RegisterBus for each part.

        A chip on frames or a serial line puts its codec of `bus.framing` around the wire here,
        one with banks a `BankedBus`.  One without registers returns {}, keeps the wire, and has
        its own identify, configure, start and stop.
        """
        return wires

    @property
    def settling_s(self) -> float:
        """Return how long samples are no good after the sensor itself was without power."""
        return 0.0

    @property
    def rate_hz(self) -> float:
        """Return the nominal output data rate of the main stream."""
        return float(self.values['rate_hz'])

    @property
    def paced(self) -> bool:
        """
        Return whether the host sets the pace: each `read` takes one sample there and then.

        Its stamps are the times at which that happened and stand as they are.
        """
        return False

    @property
    @abstractmethod
    def poll_period_s(self) -> float:
        """Return how often `read` wants to be called, so that nothing overflows."""

    def identify(self) -> str:
        """
        Return the name of the part that answers.

        Raises
        ------
        IdentityError
            If it is not the part this driver is for.
        """
        found = [self.check_identity(identity) for identity in self.identities]
        return found[0] if found else self.title

    def check_identity(self, identity: Identity) -> str:
        """
        Return the name of the part that answers at one identity register.

        Raises
        ------
        NoAnswer
            If the line is not driven: SPI has no acknowledge, it reads all zeros or ones.
        IdentityError
            If it is not the part expected.
        """
        register = identity.register
        word = self.registers.word(register)
        if word in identity.expected:
            return identity.expected[word]
        where = self._wires.get(register.part, self._wires['']).name
        if word in (0, (1 << 8 * register.size) - 1) and word not in identity.others:
            also = '' if word else ', or two chips answer at once'
            raise NoAnswer(
                f'{where}: {register} reads 0x{word:02X}: nothing drives the line{also}'
            )
        expected = ' or '.join(f'0x{known:02X}' for known in identity.expected)
        raise IdentityError(
            f'{where}: {register} holds 0x{word:02X} '
            f'({identity.others.get(word, "not a part this driver knows")}), expected {expected} '
            f'for {self.title}; check address, wiring and the part itself'
        )

    def assignments(self) -> dict[Any, Value]:
        """Return what `configure` writes: each setting with a field of its name."""
        return {
            field: self.values[name]
            for name, field in self.declared(Field).items()
            if name in self.values
        }

    def configure(self) -> None:
        """
        Reset the chip, check its identity, write the configuration, read it back and compare.

        Raises
        ------
        BusError
            If nothing answers, or a register does not hold what was written.
        IdentityError
            If another chip answers.
        """
        self.configured = False
        self.registers.run(self.reset_steps, until_cleared=True)
        self.identify()
        assignments = self.assignments()
        self.registers.write(assignments)
        self.registers.verify(assignments)
        self.configure_parts()
        self.configured = True

    def configure_parts(self) -> None:
        """Configure what lies behind the main die."""

    def start(self) -> None:
        """Start the stream."""
        self.registers.run(self.start_steps)
        self.continuity += 1
        if self.edges is not None:
            self.edges.begin()

    def restart(self) -> None:
        """
        Start the stream again after a failure; configure first if the chip lost its settings.

        A chip that was without power answers as if nothing had happened, with the wrong range.
        """
        self.counters['restarts'] += 1
        if self.configured and self.registers.difference(self.assignments()):
            self.counters['brown_outs'] += 1
            self.configured = False
        if not self.configured:
            self.configure()
        self.start()

    def look_after(self, assignments: Mapping[Any, Value]) -> None:
        """Configure again soon if a part does not hold its settings: a dip resets one die."""
        if self.registers.difference(assignments):
            self.counters['brown_outs'] += 1
            self.configured = False

    def pull_reset(self, steps: Sequence) -> bool:
        """Reset by the line, then take steps; return whether there is one."""
        if self.reset_line is None:
            return False
        self.reset_line.drive(False)
        self.clock.sleep(RESET_LOW_S)
        self.reset_line.drive(True)
        self.registers.run(steps)
        return True

    def stop(self) -> None:
        """Stop the stream."""
        self.registers.run(self.stop_steps)

    @abstractmethod
    def read(self) -> list[Samples]:
        """
        Return everything new since the last call, one run per stream.

        Stamps are a first guess: the host's time when the chip's sample count was latched,
        minus the nominal period for each sample before it.  Acquisition corrects them.
        """

    def decode(self, words: npt.NDArray[Any], *channels: Channel) -> dict[str, Any]:
        """
        Return channels in SI by their quantity; count the samples with one at its limit.

        Parameters
        ----------
        words : structured ndarray, shape (n,)
            By quantity, as `Frame.unpack` returns them.
        *channels : Channel
            One that is scaled by a range field is decoded at the setting of that name.
        """
        columns = {}
        clipped: Any = None
        for channel in channels:
            name = channel.quantity
            range_ = self.values[channel.scaled_by.name] if channel.scaled_by else None
            found = words[name]
            if not channel.within(found, range_):
                at_limit = channel.saturated(found, range_)
                clipped = at_limit if clipped is None else clipped | at_limit
            columns[name] = channel.decode(found, range_, self.trims.get(name, 1.0))
        if clipped is not None:
            self.counters['saturated'] += int(clipped.sum())
        return columns

    def close(self) -> None:
        """Release every bus."""
        for wire in self._wires.values():
            wire.close()
        for line in (self.edges, self.reset_line):
            if line is not None:
                line.close()
