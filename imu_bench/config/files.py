# SPDX-License-Identifier: Apache-2.0
"""Reading YAML, and the ROS parameter file inside it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from imu_bench.errors import ConfigError
import yaml

PARAMETERS = 'ros__parameters'

_LARGEST = 1 << 18
"""Bytes; the largest of our own files has 3000, and a quarter of a MiB is read in some seconds."""

_DEEPEST = 40
"""Levels; a scenario, the deepest of ours, has eight."""

_MOST = 100_000
"""Entries; what an alias stands for counts wherever it is used."""

_TOO_DEEP = f'nested more than {_DEEPEST} levels deep'
_INTEGER, _DIGITS = 'tag:yaml.org,2002:int', 100
_LONGEST = 200
"""Characters of a file that an error text repeats."""


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


def load(text: str | bytes, loader: Any = yaml.SafeLoader, most: int = _MOST) -> Any:
    r"""
    Return the document of a YAML text, of bounded depth and size.

    Parameters
    ----------
    text : str or bytes
        YAML.
    loader : type, optional
        Of PyYAML.
    most : int, optional
        Entries that it may have; what an alias stands for counts wherever it is used.

    Raises
    ------
    yaml.YAMLError
        If it is not YAML, is nested too deeply, or has too many entries.
    ValueError
        If a number or date in it is none.

    Examples
    --------
    >>> load('a: &a [1, 2]\nb: *a')
    {'a': [1, 2], 'b': [1, 2]}
    """
    reading = loader(text)
    try:
        root = reading.get_single_node()
        if root is None:
            return None
        size = _extent(root, {})
        if size.depth > _DEEPEST:
            raise yaml.YAMLError(_TOO_DEEP)
        if size.entries > most:
            raise yaml.YAMLError(
                f'it has more than {most} entries, those of an alias counted wherever it is used'
            )
        return reading.construct_document(root)
    except RecursionError as error:
        raise yaml.YAMLError(_TOO_DEEP) from error
    finally:
        reading.dispose()


class _Extent(NamedTuple):
    """How many entries a node has below it, and on how many levels."""

    entries: int
    depth: int


def _extent(node: yaml.Node, known: dict[int, _Extent | None]) -> _Extent:
    """Return the size of what a node stands for; that of an alias is looked at once."""
    if isinstance(node, yaml.ScalarNode):
        if node.tag == _INTEGER and len(node.value) > _DIGITS:
            line = node.start_mark.line + 1
            raise yaml.YAMLError(f'line {line}: a number of more than {_DIGITS} digits')
        return _Extent(0, 0)
    if id(node) in known:
        found = known[id(node)]
        if found is None:
            raise yaml.YAMLError(f'line {node.start_mark.line + 1}: it contains itself')
        return found
    known[id(node)] = None
    pairs = isinstance(node, yaml.MappingNode)
    parts = list(chain.from_iterable(node.value)) if pairs else node.value
    below = [_extent(part, known) for part in parts]
    entries = len(below) + sum(part.entries for part in below)
    found = _Extent(entries, 1 + max((part.depth for part in below), default=0))
    known[id(node)] = found
    return found


def _short(words: object) -> str:
    """Return words in one line; of long ones the beginning and the end."""
    text = ' '.join(str(words).split())
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f'{text[:half]}...{text[-half:]}'


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
        with path.open('rb') as file:
            stored = file.read(_LARGEST + 1)
        text = stored.decode('utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'it is not UTF-8 text'
        raise ConfigError(f'{path}: cannot be read: {reason}') from error
    if len(stored) > _LARGEST:
        raise ConfigError(
            f'{path}: larger than {_LARGEST >> 10} KiB: no settings; see config/ for examples'
        )
    try:
        document = load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        line = f' line {error.problem_mark.line + 1}:' if error.problem_mark else ''
        raise ConfigError(f'{path}:{line} {_short(error.problem or error.context)}') from error
    except (yaml.YAMLError, TypeError, ValueError) as error:
        raise ConfigError(f'{path}: not YAML: {_short(error)}') from error
    if not isinstance(document, dict):
        raise ConfigError(f'{path}: holds no mapping; see config/ for examples')
    return document


def read_parameters(path: Path) -> dict[str, Any]:
    """Return the parameters of a ROS parameter file that addresses one node."""
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
