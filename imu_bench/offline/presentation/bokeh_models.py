# SPDX-License-Identifier: Apache-2.0
"""
What a figure is made of, as Bokeh's part in the browser reads it.

Bokeh's part in Python would say the same, but it builds, checks and walks over thousands of
objects for a report of seventy figures, and takes longer than the analysis of six sensors.  The
tests let it read, and so check, every kind of figure.  Source of names, settings and format:
Bokeh reference guide, bokeh.models and bokeh.core.serialization, version 3.4 and later.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
import gzip
from itertools import count
import math
import sys
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

_ONE_STYLE = frozenset(('Line', 'Step', 'VArea'))
"""Glyphs that have one style, not one for each of their points."""

EFFORT = 8  # of the compression: 1 % smaller than 6 for 20 ms

_SEEN = np.uint32(0xFFFFFF00)
"""Bits of a float32 that are kept: 16 of its mantissa, one part in 65 000, are more than a screen
has pixels, and noise has nothing else to be compressed by."""


class Field(NamedTuple):
    """The name of a column that says something of every point."""

    field: str


class Value(NamedTuple):
    """What holds for every point."""

    value: Any


class Model:
    """One object of a figure; used twice, it is the same object."""

    __slots__ = ('kind', 'settings')

    def __init__(self, kind: str, **settings: Any) -> None:
        self.kind = kind
        self.settings = settings

    def set(self, **settings: Any) -> None:
        """Change settings."""
        self.settings.update(settings)


def glyph(kind: str, at: Mapping[str, str], **style: Any) -> Model:
    """Return something to be drawn at every point."""
    if kind not in _ONE_STYLE:
        style = {name: Value(setting) for name, setting in style.items()}
    return Model(kind, **{name: Field(column) for name, column in at.items()}, **style)


def columns(**arrays: npt.ArrayLike) -> Model:
    """Return columns in single precision: half the file, and still finer than any screen."""
    data = {name: _packed(np.asarray(values)) for name, values in arrays.items()}
    return Model('ColumnDataSource', data=data)


def document(root: Model, prefix: str) -> tuple[str, list[Any]]:
    """Return the identifier of a figure and the roots of its document, as for json."""
    encoder = _Encoder(prefix)
    encoded = encoder.encode(root)
    return encoded['id'], [encoded]


class _Encoder:
    """Gives every model its identifier, and refers to those that it has met."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._number = count()
        self._met: dict[int, str] = {}

    def encode(self, what: Any) -> Any:
        if isinstance(what, Model):
            return self._model(what)
        if isinstance(what, Value):
            return {'type': 'value', 'value': self.encode(what.value)}
        if isinstance(what, Field):
            return {'type': 'field', 'field': what.field}
        if isinstance(what, np.ndarray):
            return _array(what)
        if isinstance(what, list | tuple):
            return [self.encode(item) for item in what]
        if isinstance(what, dict):
            return {
                'type': 'map',
                'entries': [[key, self.encode(item)] for key, item in what.items()],
            }
        if isinstance(what, float) and not math.isfinite(what):
            return {
                'type': 'number',
                'value': {math.inf: '+inf', -math.inf: '-inf'}.get(what, 'nan'),
            }
        return what

    def _model(self, model: Model) -> dict[str, Any]:
        if (known := self._met.get(id(model))) is not None:
            return {'id': known}
        name = self._met[id(model)] = f'{self._prefix}{next(self._number)}'
        settings = {key: self.encode(setting) for key, setting in model.settings.items()}
        return {'type': 'object', 'name': model.kind, 'id': name, 'attributes': settings}


def _packed(array: npt.NDArray[Any]) -> Any:
    if array.ndim == 2:  # one line per row
        return [_packed(row) for row in array]
    if array.dtype.kind != 'f':
        return array.tolist()
    with np.errstate(over='ignore'):  # what is too large for a float32 is not seen in a figure
        single = array.astype(np.float32)
    return (single.view(np.uint32) & _SEEN).view(np.float32)


def _array(array: npt.NDArray[Any]) -> dict[str, Any]:
    packed = gzip.compress(array.tobytes(), EFFORT, mtime=0)
    return {
        'type': 'ndarray',
        'array': {'type': 'bytes', 'data': base64.b64encode(packed).decode('ascii')},
        'shape': list(array.shape),
        'dtype': array.dtype.name,
        'order': sys.byteorder,
    }
