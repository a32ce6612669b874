# SPDX-License-Identifier: Apache-2.0
"""
One file per sensor, read like its datasheet.

A driver exists because its file exists: nothing is registered anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from imu_bench.errors import ConfigError

if TYPE_CHECKING:
    from imu_bench.drivers.driver import Driver


def names() -> list[str]:
    """
    Return the name of every sensor that has a driver.

    Examples
    --------
    >>> 'mpu9250' in names()
    True
    """
    return sorted(module.name for module in iter_modules(__path__) if not module.ispkg)


def load(name: str) -> type[Driver]:
    """
    Return the driver class of a sensor.

    Raises
    ------
    ConfigError
        If there is no such driver, with the names there are.

    Examples
    --------
    >>> load('mpu9250').title
    'InvenSense MPU-9250'
    """
    if name not in names():
        raise ConfigError(f'no driver {name!r}; there are {", ".join(names())}')
    from imu_bench.drivers.driver import Driver  # whoever asks for names alone need not wait

    module = import_module(f'{__name__}.{name}')
    found = [
        item
        for item in vars(module).values()
        if isinstance(item, type)
        and issubclass(item, Driver)
        and item.__module__ == module.__name__
    ]
    if len(found) != 1:
        raise ConfigError(f'{module.__name__} must define exactly one Driver, it has {len(found)}')
    return found[0]


def check_lines(name: str, lines: Iterable[str], source: str) -> None:
    """Refuse lines at pins that a sensor does not have."""
    for line in lines:
        pin = {'data_ready': 'data_ready_pin', 'reset_line': 'reset_pin'}[line]
        having = [driver for driver in names() if getattr(load(driver), pin)]
        if name not in having:
            where = f'{source}.{line}'.lstrip('.')
            raise ConfigError(
                f'{where}: a {name} has no such pin that is used; leave it out '
                f'({", ".join(having)})'
            )
