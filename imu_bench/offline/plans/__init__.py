# SPDX-License-Identifier: Apache-2.0
"""
The test plans of the documents, one file per plan.

A file in this folder that defines a `Plan` or a `NoisePlan` is a plan; nothing else has to be
told of it.  What several files of a plan share lies in a folder beside it.

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

_GRAMMAR = ('plan', 'result', 'shown')


def names() -> list[str]:
    """Return the names of all plans, as given to ``--plan``; folders hold parts of plans."""
    files = (module.name for module in pkgutil.iter_modules(__path__) if not module.ispkg)
    return sorted(name.replace('_', '-') for name in files if name not in _GRAMMAR)


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
    raise ConfigError(f'--plan {name}: its file defines no plan')
