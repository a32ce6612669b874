# SPDX-License-Identifier: Apache-2.0
"""
Declared settings, and how a value is held against them.

One declaration of a setting serves everybody: the loader of configuration
files, the ROS parameter with its descriptor, and the tables of the README.
A value that does not fit is refused with what would fit; it is never snapped,
rounded or guessed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
import difflib
import math
from typing import Any, Protocol

from imu_bench.errors import ConfigError, UnitError
from imu_bench.units import canonical, convert, units_like

MANY = 40
"""A list of allowed values that is longer is not spelled out."""

REQUIRED = object()
"""Default of a setting that must be given."""


@dataclass(frozen=True)
class Setting:
    """
    One setting: its name, type, default and what it may be.

    Examples
    --------
    >>> rate = Setting('rate_hz', 100.0, 'Output data rate.', allowed=(50.0, 100.0))
    >>> rate.check(50.0)
    50.0
    >>> density = Setting('noise_density', None, 'White noise.', unit='m/s²/√Hz', kind='quantity')
    >>> [round(axis, 7) for axis in density.check('150 µg/√Hz')]
    [0.001471]
    """

    name: str  # as written in a file; a dot separates levels ('simulation.seed')
    # value when the setting is not given; `REQUIRED` when it must be.  None means that the setting
    # may be absent and then has no value
    default: Any
    description: str  # one sentence for parameter descriptors and tables
    # every value that is allowed; empty when a range, or nothing, limits it
    allowed: tuple[Any, ...] = ()
    # smallest and largest number, both included, in `unit`; infinite for none
    bounds: tuple[float, float] | None = None
    unit: str = ''  # SI unit of a number; of a quantity the unit its value is converted to
    # 'bool', 'int', 'float', 'str', 'strs' (list of texts) or 'quantity': a text of number and
    # unit such as '150 µg/√Hz', or a list of three of them, one per axis.  Deduced from the
    # default when not given
    kind: str = ''
    changes: bool = False  # whether it may be changed while a node runs

    def __post_init__(self) -> None:
        if not self.kind:
            example = (
                self.allowed[0] if self.default is REQUIRED and self.allowed else self.default
            )
            kinds = {bool: 'bool', int: 'int', float: 'float', str: 'str', tuple: 'strs'}
            object.__setattr__(self, 'kind', kinds.get(type(example), 'str'))

    @property
    def constraint(self) -> str:
        """What is allowed, in words for an error text or a table."""
        unit = f' {self.unit}' if self.unit else ''
        if self.allowed:
            words = [_spelled(value) or 'nothing' for value in self.allowed]
            if len(words) > MANY:
                words[8:] = [f'… {words[-1]}']
            return ', '.join(words) + unit
        if self.bounds is None:
            return _KINDS[self.kind] + (f' that measures what {self.unit} does' if unit else '')
        low, high = self.bounds
        if math.isinf(high):
            return f'{_spelled(low)}{unit} or more'
        return f'{_spelled(low)} to {_spelled(high)}{unit}'

    def check(self, value: object) -> Any:
        """
        Return the value in the type and unit of this setting.

        Returns
        -------
        object
            For a quantity a tuple of one or three floats in `unit`.

        Raises
        ------
        ConfigError
            If the value is of another type or outside what is allowed; the
            text says what is allowed, the caller says where the value stands.
        """
        if self.kind == 'quantity':
            return self._quantity(value)
        checked = self._typed(value)
        if self.allowed:
            for known in self.allowed:
                if known == checked or _same(known, checked):
                    return known
            raise ConfigError(
                f'{_spelled(value)} is not allowed; allowed: {self.constraint}'
                f'{self._nearest(checked)}'
            )
        self._limit(checked)
        return checked

    def _nearest(self, value: Any) -> str:
        """Return what there is on both sides of a value, if not all was spelled out."""
        if len(self.allowed) <= MANY:
            return ''
        above = [known for known in self.allowed if known > value]
        below = [known for known in self.allowed if known < value]
        near = [max(below)] if below else []
        return '; nearest ' + ' and '.join(map(_spelled, near + ([min(above)] if above else [])))

    def _typed(self, value: object) -> Any:
        if self.kind == 'bool' and isinstance(value, bool):
            return value
        if self.kind == 'int' and isinstance(value, int) and not isinstance(value, bool):
            return value
        if self.kind == 'float' and isinstance(value, float) and math.isfinite(value):
            return value
        if self.kind == 'str' and isinstance(value, str):
            return value
        if (
            self.kind == 'strs'
            and isinstance(value, list | tuple)
            and all(isinstance(item, str) for item in value)
        ):
            return tuple(value)
        raise ConfigError(f'{value!r} is not {_KINDS[self.kind]}; allowed: {self.constraint}')

    def _limit(self, value: Any) -> None:
        if self.bounds is not None and not self.bounds[0] <= value <= self.bounds[1]:
            raise ConfigError(f'{_spelled(value)} is not allowed; allowed: {self.constraint}')

    def _quantity(self, value: object) -> tuple[float, ...]:
        texts = value if isinstance(value, list | tuple) else [value]
        if len(texts) not in (1, 3):
            raise ConfigError(f'{value!r} has {len(texts)} values; give one, or one per axis')
        numbers = tuple(parse_quantity(text, self.unit) for text in texts)
        for number in numbers:
            self._limit(number)
        return numbers


_KINDS = {
    'bool': 'true or false',
    'int': 'an integer',
    'float': 'a finite number with a decimal point',
    'str': 'a text',
    'strs': 'a list of texts',
    'quantity': 'a number with its unit',
}


def parse_quantity(text: object, unit: str) -> float:
    """
    Return the number of a text such as '150 µg/√Hz' in the unit asked for.

    Raises
    ------
    ConfigError
        If the text is not a number and a unit, or the unit measures something else.

    Examples
    --------
    >>> parse_quantity('60 mg', 'm/s²')
    0.588399
    """
    example = f"write it as text with number and unit, like '1.0 {unit}'"
    if not isinstance(text, str):
        raise ConfigError(f'{text!r} has no unit; {example}')
    number, _, unit_given = text.strip().partition(' ')
    try:
        canonical(unit_given or '1')
    except UnitError:
        known = ', '.join(units_like(unit))
        raise ConfigError(f'{text!r}: unknown unit {unit_given!r}; use one of {known}') from None
    try:
        value = convert(float(number), unit_given or '1', unit)
    except UnitError as error:
        raise ConfigError(f'{text!r}: {error}') from error
    except ValueError:
        raise ConfigError(f'{text!r} is not a number and a unit; {example}') from None
    if not math.isfinite(value):
        raise ConfigError(f'{text!r} is not finite; {example}')
    return value


def flatten(tree: Mapping[Any, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    """
    Yield the leaves of nested mappings under dotted names, as ROS names its parameters.

    Examples
    --------
    >>> dict(flatten({'rate_hz': 100.0, 'simulation': {'seed': 7}}))
    {'rate_hz': 100.0, 'simulation.seed': 7}
    """
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


class Checkable(Protocol):
    """What `check_all` needs of a setting; those of the drivers are made the same way."""

    @property
    def name(self) -> str: ...
    @property
    def default(self) -> Any: ...
    @property
    def constraint(self) -> str: ...
    def check(self, value: object) -> Any: ...


def check_all(
    given: Mapping[str, Any], settings: Iterable[Checkable], where: str, problems: list[str]
) -> dict[str, Any]:
    """
    Return every setting with its checked value or default; report all problems at once.

    Parameters
    ----------
    given : mapping
        Dotted names and values as they stand in a file.
    settings : iterable of Checkable
        What may be given.
    where : str
        File and place for the texts, such as 'x.yaml: ros__parameters'.
    problems : list of str
        Each problem is appended, as one line with its path.
    """
    known = {setting.name: setting for setting in settings}
    problems += [
        f'{where}.{name}: unknown; {suggestion(name, known)}'
        for name in given
        if name not in known
    ]
    values = {}
    for name, setting in known.items():
        if name not in given:
            if setting.default is REQUIRED:
                problems.append(f'{where}.{name}: missing; allowed: {setting.constraint}')
            values[name] = setting.default
            continue
        try:
            values[name] = _checked(setting, given[name])
        except ConfigError as error:
            problems.append(f'{where}.{name}: {str(error).removeprefix(name + ": ")}')
    return values


def _checked(setting: Checkable, value: Any) -> Any:
    """Check a value; a float must be written as one, or ROS refuses the same file."""
    kind = getattr(setting, 'kind', type(setting.default).__name__)
    number = _number(value) if kind == 'float' else None
    if number is not None:
        raise ConfigError(
            f'{value!r} is no number with a decimal point, write {number!r}: ROS parameters keep '
            f'integers, texts and floats apart; allowed: {setting.constraint}'
        )
    return setting.check(value)


def suggestion(name: str, known: Iterable[str]) -> str:
    """
    Return what was probably meant, or everything there is.

    Examples
    --------
    >>> suggestion('rate_hx', ['rate_hz', 'range_g'])
    "did you mean 'rate_hz'?"
    """
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.7)
    if close:
        return f'did you mean {close[0]!r}?'
    return f'known are {", ".join(names) or "none"}'


def stated(values: Mapping[str, Any], settings: Iterable[Setting]) -> dict[str, Any]:
    """
    Return settings for a JSON document: quantities in SI with their unit, the rest as it is.

    Examples
    --------
    >>> window = Setting('window', (1.0,), 'Length.', unit='s', kind='quantity')
    >>> stated({'window': (2.0,)}, [window])
    {'window': {'value': 2.0, 'unit': 's'}}
    """
    units = {setting.name: setting.unit for setting in settings if setting.kind == 'quantity'}
    document: dict[str, Any] = {}
    for name, value in values.items():
        if name in units and value is not None:
            numbers = value[0] if len(value) == 1 else list(value)
            document[name] = {'value': numbers, 'unit': units[name]}
        else:
            document[name] = value
    return document


def raise_if_any(problems: list[str]) -> None:
    """
    Raise every problem collected, one line each.

    Raises
    ------
    ConfigError
        If there is a problem.
    """
    if problems:
        raise ConfigError('\n'.join(problems))


def _number(value: object) -> float | None:
    """Return what a value would be as a float; None when it is no number at all."""
    if isinstance(value, bool) or not isinstance(value, int | str):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _same(known: object, value: object) -> bool:
    """Return whether two floats are equal but for the rounding of a text."""
    return isinstance(known, float) and isinstance(value, float) and math.isclose(known, value)


def _spelled(value: object) -> str:
    return f'{value:g}' if isinstance(value, float) and abs(value) < 1e5 else str(value)
