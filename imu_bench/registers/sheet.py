# SPDX-License-Identifier: Apache-2.0
"""What else a document says about a chip: identity, typical values, and witnesses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from imu_bench.registers.channels import Channel
from imu_bench.registers.fields import Register, Value


@dataclass(frozen=True)
class Identity:
    """A register that says what the chip is."""

    register: Register
    expected: Mapping[int, str]
    # known relatives that this driver refuses, with what to know about them
    others: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Typical:
    """
    Typical values of the document for one quantity, in SI; None where it gives none.

    Simulator defaults, and the yardstick of a comparison with the datasheet.
    """

    source: str  # document and table
    # one-sided, SI/√Hz; per axis (x, y, z) where they differ
    noise_density: float | tuple[float, float, float] | None = None
    bandwidth: float | None = None  # Hz, at the default settings
    high_pass: float | None = None  # Hz; a sensor that does not show constant values
    # range, resolution: at the default settings
    range: float | None = None
    resolution: float | None = None
    # bias, bias_per_kelvin: zero offset (the document's ± figure) and its change with temperature
    bias: float | tuple[float, float, float] | None = None
    bias_per_kelvin: float | None = None
    bias_instability: float | None = None
    # scale_error, scale_per_kelvin, nonlinearity, cross_axis: relative
    scale_error: float | None = None
    scale_per_kelvin: float | None = None
    nonlinearity: float | None = None
    cross_axis: float | None = None


@dataclass(frozen=True)
class Witness:
    """
    Bytes on the wire and what they mean, from a document or calculated by hand.

    It never comes from the channel it testifies for, so a mistake there cannot prove itself.
    """

    channel: Channel
    data: str  # hexadecimal, as they come over the wire
    expected: tuple[float, ...]  # SI, in the body frame
    source: str
    range: Value | None = None
    trim: float | tuple[float, ...] = 1.0
