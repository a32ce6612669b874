# SPDX-License-Identifier: Apache-2.0
"""What all converters have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, TypeVar

from imu_bench.bus.interface import Clock
from imu_bench.errors import BusError, ConfigError
import numpy as np

_T = TypeVar('_T')


class Reading(NamedTuple):
    """What a converter gives."""

    stamps: np.ndarray = np.empty(0, dtype=np.int64)  # first guess of the times of measurement
    words: np.ndarray = np.empty(0)  # as they came over the wire
    lost: bool = False  # samples were lost, or the settings: it has to be started again


class Converter(ABC):
    """
    What turns a voltage into words, and when.

    Parameters
    ----------
    wire : RegisterBus, FrameBus or DaqBoard
        How the converter is reached.
    counters : Counter
        Counts 'bus_errors' and what the converter has of its own.
    rate_hz : float
        0 for the usual one.

    Raises
    ------
    ConfigError
        If it cannot do the rate.
    """

    part: ClassVar[str]
    usual_hz: ClassVar[float]
    paced: ClassVar[bool] = True
    """Whether it waits to be asked for each sample."""
    settling_s: ClassVar[float] = 0.0
    """From feeding the sensor until what it gives is good."""

    def __init__(self, wire: Any, clock: Clock, counters: Counter[str], rate_hz: float) -> None:
        self.wire = wire
        self.clock = clock
        self.counters = counters
        self.rate_hz = self.checked_rate(rate_hz or self.usual_hz)

    @property
    def poll_period_s(self) -> float:
        """Return how often it wants to be read."""
        return 1.0 / self.rate_hz

    @abstractmethod
    def checked_rate(self, rate_hz: float) -> float:
        """Return the rate, if the converter can do it."""

    @abstractmethod
    def identify(self) -> str:
        """Return what it is; it has to answer."""

    @abstractmethod
    def configure(self) -> None:
        """Prepare it, and wait until the sensor has settled."""

    @abstractmethod
    def start(self) -> None:
        """Start converting."""

    @abstractmethod
    def read(self) -> Reading:
        """Return what is new."""

    @abstractmethod
    def stop(self) -> None:
        """Stop converting."""

    @abstractmethod
    def release(self) -> None:
        """Leave it as it was found."""

    def counted(self, call: Callable[..., _T], *arguments: object) -> _T:
        """Return the result of a transfer; count its failure."""
        try:
            return call(*arguments)
        except BusError:
            self.counters['bus_errors'] += 1
            raise

    def refused(self, setting: str, value: object, allowed: str) -> ConfigError:
        """Return the error for a setting that this converter does not have."""
        return ConfigError(
            f'{setting}: {value} is not possible with the {self.part}; allowed: {allowed}'
        )
