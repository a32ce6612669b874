# SPDX-License-Identifier: Apache-2.0
"""What a test plan is: settings, what it measures on each recording, and a conclusion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

from imu_bench.config.files import load
from imu_bench.config.schema import REQUIRED, Setting, stated
from imu_bench.errors import ConfigError, DataError, RecordingError
from imu_bench.metrology.estimate import CONFIDENCE
from imu_bench.metrology.stamps import time_grid
from imu_bench.offline.analysis.results import RecordingResult
from imu_bench.offline.comparing.sensors import labels, Named
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.recordings import Recording
import numpy as np
import numpy.typing as npt
import yaml

Measured = TypeVar('Measured')
"""What a plan keeps of one recording: small, and it can be sent between processes."""


class AnyPlan(ABC, Generic[Measured]):
    """Settings and conclusion of a test plan."""

    name: ClassVar[str]
    title: ClassVar[str]
    document: ClassVar[str] = ''  # that it follows, if any
    SETTINGS: ClassVar[tuple[Setting, ...]] = ()

    def __init__(
        self,
        settings: Mapping[str, str] | None = None,
        *,
        reference: str = '',
        confidence: float = CONFIDENCE,
    ) -> None:
        self.settings = _checked(self.name, self.SETTINGS, settings or {})
        self.reference = reference
        self.confidence = confidence

    def stated(self) -> dict[str, Any]:
        """Return the settings for the JSON document."""
        return stated(self.settings, self.SETTINGS)

    @abstractmethod
    def conclude(self, measured: Sequence[Measured]) -> PlanResult:
        """Return the result of all recordings, in the order given."""


class Plan(AnyPlan[Measured]):
    """
    A test plan that measures something of its own.

    Recordings are measured one by one, side by side in several processes and each in bounded
    memory; the conclusion is drawn from what was kept of them.
    """

    @abstractmethod
    def measure(self, source: str, recordings: Sequence[Recording]) -> Measured:
        """Return what is kept of one recording."""


class NoisePlan(AnyPlan[RecordingResult]):
    """A test plan that concludes from what `imu-bench analyze` measures without a plan."""


def _checked(plan: str, known: Sequence[Setting], given: Mapping[str, str]) -> dict[str, Any]:
    """Return every setting in its type and unit."""
    by_name = {setting.name: setting for setting in known}
    for name in given:
        if name not in by_name:
            names = ', '.join(sorted(by_name)) or 'none'
            raise ConfigError(f'--set {name}: plan {plan} has no such setting; it has: {names}')
    values: dict[str, Any] = {}
    for name, setting in by_name.items():
        if name in given:
            values[name] = _value(setting, given[name])
        elif setting.default is REQUIRED:
            raise ConfigError(
                f'plan {plan} needs --set {name}=…: {setting.description} ({setting.constraint})'
            )
        else:
            values[name] = setting.default
    return values


def _value(setting: Setting, text: str) -> Any:
    """Return one value; its kind decides how the text is read."""
    value: Any = text
    if setting.kind in ('bool', 'int', 'float'):
        try:
            value = load(text)
        except (yaml.YAMLError, ValueError):
            value = text
        if setting.kind == 'float' and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
    elif setting.kind == 'strs' or (setting.kind == 'quantity' and ',' in text):
        value = [part.strip() for part in text.split(',')]
    try:
        return setting.check(value)
    except ConfigError as error:
        raise ConfigError(f'--set {setting.name}: {error}') from error


Floats = npt.NDArray[np.float64]
Sensor = TypeVar('Sensor', bound=Named)

DRAWN = 2000
"""Points of a line in a figure."""


def place(recording: Recording) -> str:
    """
    Return how error texts name a recording.

    A text file is its own only topic.
    """
    return f'{recording.source}, {recording.topic}'


def seconds(recording: Recording, since_ns: int | None = None) -> Floats:
    """Return the stamps of a recording in s since a time, its first sample by default."""
    stamps = recording.samples.stamps
    start = int(stamps[0]) if since_ns is None else since_ns
    return np.asarray((stamps - start) * 1e-9, np.float64)


def rate_of(recording: Recording) -> float:
    """Return the true sample rate in Hz."""
    try:
        return 1.0 / time_grid.grid(recording.samples.stamps).period_s
    except DataError as error:
        raise RecordingError(f'{place(recording)}: {error}') from error


def thinned(x: Floats, y: Floats, points: int = DRAWN) -> tuple[Floats, Floats]:
    """Return means of equally many samples each, at most so many of them."""
    size = -(-x.size // points)
    count = x.size // size
    first, second = (values[: count * size].reshape(count, size).mean(axis=1) for values in (x, y))
    return first, second


def named(measured: Sequence[Sensor], reference: str = '') -> list[tuple[str, Sensor]]:
    """Return what was measured with short unique names of the sensors; the reference first."""
    names = labels(measured)
    if reference and reference not in names:
        raise RecordingError(f'--reference {reference}: not among the sensors: {", ".join(names)}')
    return sorted(zip(names, measured, strict=True), key=lambda pair: pair[0] != reference)
