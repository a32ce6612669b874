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

_LITTLE_EFFORT = 1  # of the compression, which does little for noise


class Field(NamedTuple):
    """The name of a column that says something of every point."""

    field: str


class Value(NamedTuple):
    """What holds for every point."""

    value: Any


class Model:
    """
    One object of a figure; used twice, it is the same object.

    Parameters
    ----------
    kind : str
        Name of a model of Bokeh.
    settings
        Of it; what is not given is as in Bokeh.
    """

    __slots__ = ('kind', 'settings')

    def __init__(self, kind: str, **settings: Any) -> None:
        self.kind = kind
        self.settings = settings

    def set(self, **settings: Any) -> None:
        """Change settings."""
        self.settings.update(settings)


def glyph(kind: str, at: Mapping[str, str], **style: Any) -> Model:
    """
    Return something to be drawn at every point.

    Parameters
    ----------
    kind : str
    at : mapping of str to str
        Settings that differ from point to point, and the columns they are in.
    style
        Settings that hold for all points.
    """
    if kind not in _ONE_STYLE:
        style = {name: Value(setting) for name, setting in style.items()}
    return Model(kind, **{name: Field(column) for name, column in at.items()}, **style)


def columns(**arrays: npt.ArrayLike) -> Model:
    """Return columns in single precision: half the file, and still finer than any screen."""
    data = {name: _packed(np.asarray(values)) for name, values in arrays.items()}
    return Model('ColumnDataSource', data=data)


def document(root: Model, prefix: str) -> tuple[str, list[Any]]:
    """
    Return the identifier of a figure and the roots of its document, as for json.

    Examples
    --------
    >>> axis = Model('LinearAxis', axis_label='time')
    >>> name, roots = document(Model('Grid', axis=axis, other=axis), 'a')
    >>> name, roots[0]['attributes']['axis']['attributes'], roots[0]['attributes']['other']
    ('a0', {'axis_label': 'time'}, {'id': 'a1'})
    """
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
    return array.astype(np.float32) if array.dtype.kind == 'f' else array.tolist()


def _array(array: npt.NDArray[Any]) -> dict[str, Any]:
    packed = gzip.compress(array.tobytes(), _LITTLE_EFFORT, mtime=0)
    return {
        'type': 'ndarray',
        'array': {'type': 'bytes', 'data': base64.b64encode(packed).decode('ascii')},
        'shape': list(array.shape),
        'dtype': array.dtype.name,
        'order': sys.byteorder,
    }
