# SPDX-License-Identifier: Apache-2.0
"""A measured number: value, interval, unit, and whether the data support it at all."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
import math
from typing import Any

from imu_bench.counting import number, with_uncertainty
from imu_bench.errors import DataError
from imu_bench.units import convert

CONFIDENCE = 0.95
"""Confidence level of intervals where the caller does not name one."""


def check_confidence(confidence: float) -> None:
    """Raise DataError unless a confidence level lies between 0 and 1."""
    if not 0.0 < confidence < 1.0:
        raise DataError(f'confidence must lie between 0 and 1, got {confidence}')


@dataclass(frozen=True, slots=True)
class Estimate:
    """
    A measured quantity with its confidence interval.

    Examples
    --------
    >>> n = Estimate(2.0e-3, 1.9e-3, 2.1e-3, 'm/s²/√Hz')
    >>> n.to('µg/√Hz').value.__round__(1)
    203.9
    >>> print(n.to('µg/√Hz'))
    204 ± 10 µg/√Hz
    >>> print(Estimate.not_observable('m/s²', 'record about 3 h', high=1e-4))
    below 0.00010 m/s²; not observable: record about 3 h
    """

    value: float | None  # best value; None when the data cannot support one
    # low, high: two-sided confidence interval.  For a quantity that is not observable `high` is
    # the upper bound at this confidence, or None if there is none
    low: float | None
    high: float | None
    unit: str  # unit of all three, as `imu_bench.units` spells it; '1' for a ratio
    confidence: float = CONFIDENCE  # confidence level of the interval, between 0 and 1
    observable: bool = True  # false when the data cannot support a value
    reason: str = ''  # why it is not observable and what would make it so
    method: str = ''  # how it was found, in a few words, where several ways exist

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
        check_confidence(self.confidence)

    def __str__(self) -> str:
        unit = '' if self.unit == '1' else f' {self.unit}'
        if self.value is not None:
            return with_uncertainty(self.value, self.low, self.high) + unit
        bound = '' if self.high is None else f'below {number(self.high, 2)}{unit}; '
        return f'{bound}not observable: {self.reason}'

    def _repr_html_(self) -> str:
        return escape(str(self))

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
