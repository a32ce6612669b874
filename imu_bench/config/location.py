# SPDX-License-Identifier: Apache-2.0
"""Where the configuration files of the package lie: beside the source, or installed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import sys

from imu_bench.config.schema import suggestion
from imu_bench.errors import ConfigError

_ONE_OF = {'benches': 'bench', 'scenarios': 'scenario', 'sensors': 'sensor'}


def named_file(folder: str, name: str) -> Path:
    """
    Return a file of one of the package's folders by its short name, or a user's own by its path.

    Parameters
    ----------
    folder : str
        'benches', 'scenarios' or 'sensors'.
    name : str
        Such as 'machine_vibration', or the path of a .yaml file.

    Raises
    ------
    ConfigError
        If there is no such file; the text says what there is.

    Examples
    --------
    >>> named_file('benches', 'machine_vibration').name
    'machine_vibration.yaml'
    """
    if name.endswith('.yaml'):
        return config_file(name)
    known = names_in(folder)
    if name not in known:
        raise ConfigError(f'no {_ONE_OF[folder]} {name!r}; {suggestion(name, known)}')
    return config_file(f'{folder}/{name}.yaml')


def named_in(place: Path, folder: str, name: str) -> Path:
    """
    Return a file that a bench names: one beside it, or by its short name one of the package.

    Parameters
    ----------
    place : Path
        Folder of the bench.
    folder, name : str
        As in `named_file`; 'mpu9250' and 'config/sensors/mpu9250.yaml' are the same.

    Raises
    ------
    ConfigError
        If there is no such file; the text says what there is.

    Examples
    --------
    >>> named_in(Path('/nowhere'), 'sensors', 'mpu9250').name
    'mpu9250.yaml'
    """
    own = place / name
    if own.is_file():
        return own
    short = name.removeprefix(f'config/{folder}/').removesuffix('.yaml')
    if short == name or name.startswith('config/'):
        return named_file(folder, short)
    known = ', '.join(names_in(folder))
    raise ConfigError(f'{own}: no such file; those of the package are, without .yaml: {known}')


def names_in(folder: str) -> list[str]:
    """Return the short names of the files of one of the package's folders."""
    return sorted({path.stem for root in _folders() for path in (root / folder).glob('*.yaml')})


def config_file(name: str) -> Path:
    """
    Return a file of the package's `config` folder, or a user's own file.

    Parameters
    ----------
    name : str
        A path that exists, or one below `config`, such as 'benches/machine_vibration.yaml'.

    Raises
    ------
    ConfigError
        If there is no such file; the text lists what is there.

    Examples
    --------
    >>> config_file('benches/machine_vibration.yaml').name
    'machine_vibration.yaml'
    """
    own = Path(name)
    if own.is_file():
        return own
    for folder in _folders():
        if (folder / name).is_file():
            return folder / name
    kin = sorted(path.name for folder in _folders() for path in (folder / own.parent).glob('*'))
    there = ', '.join(dict.fromkeys(kin)) or 'nothing'
    raise ConfigError(f'{name}: no such file, here or among the package files ({there})')


def _folders() -> Iterator[Path]:
    """Yield `config` of a checkout, then of the install prefixes above this file."""
    package = Path(__file__).resolve().parent.parent
    if (package.parent / 'package.xml').is_file():
        yield package.parent / 'config'
    for prefix in (*package.parents, Path(sys.prefix)):
        yield prefix / 'share' / 'imu_bench' / 'config'
