# SPDX-License-Identifier: Apache-2.0
"""The typical values of a sensor as its driver is set."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TYPE_CHECKING

from imu_bench.registers import Field, Fifo, Typical
from imu_bench.units import convert

if TYPE_CHECKING:
    from imu_bench.drivers.driver import Driver


def as_set(driver: Driver) -> dict[str, Typical]:
    """Return the typical values of a driver, with range, resolution and filter as it is set."""
    found = dict(driver.typical)
    names = {id(field): name for name, field in driver.declared(Field).items()}
    channels = driver.channels().values()
    quantities = [channel.quantity for channel in channels]
    for channel in channels:
        # of a quantity with words of several lengths the document's own values are kept
        if channel.quantity not in found or quantities.count(channel.quantity) > 1:
            continue
        setting = names.get(id(channel.scaled_by), '')
        full_scale = driver.values.get(setting)
        changed: dict[str, Any] = {}
        if channel.quantised:
            changed['resolution'] = tuple(channel.resolution(full_scale))
        if channel.scaled_by is not None and isinstance(full_scale, float):
            changed['range'] = convert(full_scale, channel.scaled_by.unit, channel.unit)
        bandwidth = driver.values.get(setting.replace('_range', '_bandwidth'))
        if setting and isinstance(bandwidth, float) and bandwidth > 0.0:
            changed['bandwidth'] = bandwidth
        found[channel.quantity] = replace(found[channel.quantity], **changed)
    for fifo in driver.declared(Fifo).values():
        for quantity in set(fifo.frame.dtype.names or ()) & set(found):
            corner = fifo.low_pass * driver.rate_hz
            found[quantity] = replace(found[quantity], bandwidth=corner)
    return found
