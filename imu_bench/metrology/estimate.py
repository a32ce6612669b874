# SPDX-License-Identifier: Apache-2.0
"""A measured number: value, interval, unit, and whether the data support it at all."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from imu_bench.errors import DataError
from imu_bench.units import convert

CONFIDENCE = 0.95
"""Confidence level of intervals where the caller does not name one."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """
    A measured quantity with its confidence interval.

    Attributes
    ----------
    value : float or None
        Best value; None when the data cannot support one.
    low, high : float or None
        Two-sided confidence interval.  For a quantity that is not observable
        `high` is the upper bound at this confidence, or None if there is none.
    unit : str
        Unit of all three, as `imu_bench.units` spells it; '1' for a ratio.
    confidence : float
        Confidence level of the interval, between 0 and 1.
    observable : bool
        False when the data cannot support a value.
    reason : str
        Why it is not observable and what would make it so.
    method : str
        How it was found, in a few words, where several ways exist.

    Examples
    --------
    >>> n = Estimate(2.0e-3, 1.9e-3, 2.1e-3, 'm/s²/√Hz')
    >>> n.to('µg/√Hz').value.__round__(1)
    203.9
    >>> Estimate.not_observable('m/s²', 'record about 3 h', high=1e-4).value is None
    True
    """

    value: float | None
    low: float | None
    high: float | None
    unit: str
    confidence: float = CONFIDENCE
    observable: bool = True
    reason: str = ''
    method: str = ''

    def __post_init__(self) -> None:
        for name in ('value', 'low', 'high'):
            number = getattr(self, name)
            if number is not None:
                object.__setattr__(self, name, float(number))
                if not math.isfinite(number):
                    raise DataError(f'an Estimate cannot hold {name}={number}')
        if self.observable and self.value is None:
            raise DataError('an observable Estimate needs a value')
        if not self.observable and (self.value is not None or not self.reason):
            raise DataError('an Estimate that is not observable has no value, and a reason')
        if not 0.0 < self.confidence < 1.0:
            raise DataError(f'confidence must lie between 0 and 1, got {self.confidence}')

    @classmethod
    def not_observable(
        cls,
        unit: str,
        reason: str,
        *,
        high: float | None = None,
        confidence: float = CONFIDENCE,
        method: str = '',
    ) -> Estimate:
        """Return the estimate of a quantity the data cannot support, with its upper bound."""
        low = None if high is None else 0.0
        return cls(None, low, high, unit, confidence, False, reason, method)

    def scaled(self, factor: float, unit: str) -> Estimate:
        """Return this estimate multiplied by an exact constant, in another unit."""

        def times(number: float | None) -> float | None:
            return None if number is None else number * factor

        low, high = times(self.low), times(self.high)
        if factor < 0:
            low, high = high, low
        return Estimate(
            times(self.value), low, high, unit,
            self.confidence, self.observable, self.reason, self.method,
        )  # fmt: skip

    def to(self, unit: str) -> Estimate:
        """
        Return this estimate in another unit of the same quantity.

        Raises
        ------
        UnitError
            If the units do not measure the same quantity.
        """
        return self.scaled(convert(1.0, self.unit, unit), unit)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object of schema imu_bench.analysis/1."""
        document: dict[str, Any] = {
            'value': self.value,
            'low': self.low,
            'high': self.high,
            'unit': self.unit,
            'confidence': self.confidence,
            'observable': self.observable,
        }
        if self.reason:
            document['reason'] = self.reason
        if self.method:
            document['method'] = self.method
        return document

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Estimate:
        """Return the estimate that `to_json` wrote."""
        return cls(**document)
