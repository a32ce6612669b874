# SPDX-License-Identifier: Apache-2.0
"""
Declared settings as ROS parameters: description, type and range from one declaration.

rclpy ignores parameters that nobody declared, so a misspelt name in a file would change
nothing without a word.  Here everything the user gave is collected first and checked as a
whole by the same code that checks the files of the bench; then each setting is declared.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
import sys
from typing import Any

from imu_bench.config import REQUIRED, Setting
from imu_bench.config.schema import check_all, raise_if_any
from imu_bench.config.sensor import ROS_OWN
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.node import Node

SOURCE = 'parameters'
"""How error texts name the place of a setting: 'parameters.rate_hz: …'."""

_TYPES = {
    'bool': ParameterType.PARAMETER_BOOL,
    'int': ParameterType.PARAMETER_INTEGER,
    'float': ParameterType.PARAMETER_DOUBLE,
    'str': ParameterType.PARAMETER_STRING,
    'strs': ParameterType.PARAMETER_STRING_ARRAY,
}


NOTHING: tuple[object, ...] = (None, 'null')
"""What the parser of rcl makes of null and of an empty list."""


class FromDump(Node):
    """
    A node that starts from what ``ros2 param dump`` has written.

    There null is a setting not given, and an empty list a parameter without a type.
    """

    def declare_parameters(
        self, namespace: str, parameters: Any, ignore_override: bool = False
    ) -> Any:
        """Declare parameters, but what a file names without a value."""
        valued = [
            each
            for each in parameters
            if len(each) < 3 or each[1] is not None or each[2].dynamic_typing
        ]
        return super().declare_parameters(namespace, valued, ignore_override)


def take_given(node: Node) -> dict[str, Any]:
    """Return the parameters that the user gave, by name, and leave none of them declared."""
    given: dict[str, Any] = {}
    for name, parameter in dict[str, Any](node.get_parameters_by_prefix('')).items():
        if name in ROS_OWN:
            continue
        # those of ROS below a prefix are declared anew, read-only, when they are needed
        node.undeclare_parameter(name)
        if name.partition('.')[0] not in ROS_OWN and parameter.value not in NOTHING:
            given[name] = parameter.value
    return given


def descriptor(setting: Setting) -> ParameterDescriptor:
    """Return the descriptor of a setting, read-only unless the setting may change."""
    unit = f' [{setting.unit}]' if setting.unit else ''
    made = ParameterDescriptor(
        name=setting.name,
        description=setting.description + unit,
        additional_constraints=setting.constraint,
        read_only=not setting.changes,
    )
    if setting.kind in _TYPES:
        made.type = _TYPES[setting.kind]
    else:
        # a quantity is a text or a list of texts
        made.dynamic_typing = True
    if setting.bounds is not None and setting.kind == 'float':
        low, high = (_finite(bound) for bound in setting.bounds)
        made.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    if setting.bounds is not None and setting.kind == 'int':
        low, high = (int(_finite(bound)) for bound in setting.bounds)
        made.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return made


def _finite(bound: float) -> float:
    return math.copysign(sys.float_info.max, bound) if math.isinf(bound) else float(bound)


def declare(node: Node, settings: Iterable[Setting], given: dict[str, Any]) -> None:
    """Declare settings that have been checked, with what was given or their defaults."""
    untyped: Any = node  # rclpy of Jazzy has few type hints
    untyped.add_on_set_parameters_callback(_as_started)
    for setting in settings:
        value = given.get(setting.name, setting.default)
        if value is REQUIRED:
            continue
        if setting.kind == 'strs':
            value = list(value)
        elif setting.kind == 'quantity' and setting.name not in given:
            # a default in SI units has no text form that the user could have written
            value = None
        node.declare_parameter(setting.name, value, descriptor(setting), ignore_override=True)


def _as_started(changed: Sequence[Any]) -> SetParametersResult:
    """Keep the clock that the node was started with: stamps of two clocks do not go together."""
    moved = any(parameter.name == 'use_sim_time' for parameter in changed)
    reason = 'use_sim_time is for the start of the node' if moved else ''
    return SetParametersResult(successful=not moved, reason=reason)


def read(node: Node, settings: Iterable[Setting]) -> dict[str, Any]:
    """Check everything the user gave against the settings, declare them, return their values."""
    settings = tuple(settings)
    given = take_given(node)
    problems: list[str] = []
    values = check_all(given, settings, SOURCE, problems)
    raise_if_any(problems)
    declare(node, settings, given)
    return values
