# SPDX-License-Identifier: Apache-2.0
"""
The test plans of the documents, one folder per plan.

A folder here that defines a `Plan` or a `NoisePlan` is a plan; nothing else has to be told of it.
Beside it lie what it keeps of a recording (`measuring`), how recordings stand to one another
(`comparing`), and its tables and figures (`presenting`), as far as it needs them.

>>> from imu_bench.offline import plans
>>> 'static' in plans.names()
True
"""

from __future__ import annotations

import difflib
from importlib import import_module
import pkgutil
from typing import Any

from imu_bench.errors import ConfigError
from imu_bench.offline.plans.plan import AnyPlan


def names() -> list[str]:
    """Return the names of all plans, as given to ``--plan``."""
    folders = (module.name for module in pkgutil.iter_modules(__path__) if module.ispkg)
    return sorted(name.replace('_', '-') for name in folders)


def load(name: str) -> type[AnyPlan[Any]]:
    """
    Return the class of a plan.

    Raises
    ------
    ConfigError
        If there is no plan of that name; the text lists those there are.
    """
    if name not in names():
        near = difflib.get_close_matches(name, names(), 1)
        hint = f'did you mean {near[0]}? ' if near else ''
        raise ConfigError(f'--plan {name}: {hint}plans: {", ".join(names())}')
    module = import_module(f'{__name__}.{name.replace("-", "_")}')
    for item in vars(module).values():
        if isinstance(item, type) and issubclass(item, AnyPlan):
            plan: type[AnyPlan[Any]] = item
            if plan.__module__ == module.__name__:
                return plan
    raise ConfigError(f'--plan {name}: its folder defines no plan')
