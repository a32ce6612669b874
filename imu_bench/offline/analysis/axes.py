# SPDX-License-Identifier: Apache-2.0
"""The scalar axes of a run of samples: what is there, under the names that results use."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from imu_bench.samples import Samples
from msg_conversions.quantities import AXES, IMU_QUANTITIES, Quantity
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_NONE: Integers = np.empty(0, np.int64)


class Axis(NamedTuple):
    """
    One scalar signal of a recording.

    `values` is a view of shape (n,), with NaN where lost; `spikes` are the positions of single
    samples that the health check named as outliers.
    """

    name: str
    quantity: Quantity
    values: Floats
    spikes: Integers = _NONE

    @property
    def unit(self) -> str:
        """SI unit of the values."""
        return self.quantity.unit


def axes(samples: Samples) -> Iterator[Axis]:
    """Yield every axis that holds numbers; a column of NaN is an axis the sensor does not have."""
    for quantity in IMU_QUANTITIES:
        columns = getattr(samples, quantity.field)
        if columns is None:
            continue
        for index, letter in enumerate(AXES):
            values = columns[:, index]
            if values.size and not (np.isnan(values[0]) and np.isnan(values).all()):
                yield Axis(f'{quantity.name}.{letter}', quantity, values)
