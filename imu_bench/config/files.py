# SPDX-License-Identifier: Apache-2.0
"""Reading YAML, and the ROS parameter file inside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from imu_bench.errors import ConfigError
import yaml

PARAMETERS = 'ros__parameters'


class _Loader(yaml.SafeLoader):
    """YAML without surprises: a key given twice is an error, not a silent replacement."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    loader.flatten_mapping(node)
    made: dict[Any, Any] = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if key in made:
            raise yaml.constructor.ConstructorError(
                None, None, f'key {key!r} is given twice', key_node.start_mark
            )
        made[key] = loader.construct_object(value_node, deep=True)
    return made


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def read_yaml(path: Path) -> dict[Any, Any]:
    """
    Return the mapping a YAML file holds.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, or holds no mapping; the text
        names file and line.
    """
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'it is not UTF-8 text'
        raise ConfigError(f'{path}: cannot be read: {reason}') from error
    try:
        document = yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        line = f' line {error.problem_mark.line + 1}:' if error.problem_mark else ''
        raise ConfigError(f'{path}:{line} {error.problem}') from error
    except (yaml.YAMLError, TypeError) as error:
        raise ConfigError(f'{path}: not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(document, dict):
        raise ConfigError(f'{path}: holds no mapping; see config/ for examples')
    return document


def read_parameters(path: Path) -> dict[str, Any]:
    """
    Return the parameters of a ROS parameter file that addresses one node.

    Raises
    ------
    ConfigError
        If the file is not of the form ``/**: {ros__parameters: {...}}``.
    """
    document = read_yaml(path)
    form = f"write '/**:' and below it '{PARAMETERS}:' with the settings"
    if len(document) != 1:
        names = ', '.join(map(repr, document)) or 'nothing'
        raise ConfigError(f'{path}: holds {names} at the top; {form}')
    ((node, content),) = document.items()
    if not isinstance(content, Mapping) or list(content) != [PARAMETERS]:
        raise ConfigError(f'{path}: {node}: {form}')
    parameters = content[PARAMETERS]
    if not isinstance(parameters, Mapping):
        raise ConfigError(f'{path}: {PARAMETERS}: holds no settings; {form}')
    return dict(parameters)
