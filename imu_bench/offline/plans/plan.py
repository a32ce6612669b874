# SPDX-License-Identifier: Apache-2.0
"""What a test plan is: settings, what it measures on each recording, and a conclusion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

from imu_bench.config.schema import REQUIRED, Setting, stated
from imu_bench.errors import ConfigError
from imu_bench.metrology.estimate import CONFIDENCE
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.recordings import Recording
from imu_bench.offline.results import RecordingResult
import yaml

Measured = TypeVar('Measured')
"""What a plan keeps of one recording: small, and it can be sent between processes."""


class AnyPlan(ABC, Generic[Measured]):
    """
    Settings and conclusion of a test plan.

    Parameters
    ----------
    settings : mapping of str to str
        As given to ``--set NAME=VALUE``.
    reference : str
        Sensor that the others are compared with, as given to ``--reference``.
    confidence : float
        Level of every interval.

    Raises
    ------
    ConfigError
        If a setting is unknown, missing or not allowed.
    """

    name: ClassVar[str]
    title: ClassVar[str]
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
        """
        Return the result of all recordings, in the order given.

        Raises
        ------
        RecordingError
            If something the plan needs is missing, such as a sensor or a run.
        """


class Plan(AnyPlan[Measured]):
    """
    A test plan that measures something of its own.

    Recordings are measured one by one, side by side in several processes and each in bounded
    memory; the conclusion is drawn from what was kept of them.
    """

    @abstractmethod
    def measure(self, source: str, recordings: Sequence[Recording]) -> Measured:
        """
        Return what is kept of one recording.

        Parameters
        ----------
        source : str
            Path as given.
        recordings : sequence of Recording
            Its topics; the sensors of one bag share its clock.

        Raises
        ------
        RecordingError
            If the plan's zones or steps are not in it.
        """


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
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            value = text
        if setting.kind == 'float' and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
    elif setting.kind == 'strs' or (setting.kind == 'quantity' and ',' in text):
        value = [part.strip() for part in text.split(',')]
    try:
        return setting.check(value)
    except ConfigError as error:
        raise ConfigError(f'--set {setting.name}: {error}') from error
