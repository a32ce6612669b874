# SPDX-License-Identifier: Apache-2.0
"""What every page of ours is made of: its figures, its style, the plotting library, templates."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from functools import cache
import gzip
import json
from pathlib import Path
import re
from typing import Any

from imu_bench.errors import needed
from imu_bench.offline.presentation.bokeh_models import document, EFFORT
from imu_bench.offline.presentation.figure import coloured, Figure
from imu_bench.offline.presentation.page_figures import draw, height_of
from imu_bench.offline.presentation.tables import cells, words
import jinja2
from markupsafe import Markup

with needed('bokeh', 'a page with figures'):
    import bokeh

_FOLDER = Path(__file__).parent
_UNIT = r'±|%|[mµn]?(?:°|g\b|m\b|s\b|rad\b)|(?:Hz|kHz|h|d|min|dB|rpm|ppm)\b'
_NUMBER = re.compile(rf'(?<=[\d⁰-⁹)]) (?={_UNIT})|(?<=±) (?=\d)')
"""The space between a number and its unit, and around the sign before its uncertainty."""


class Places:
    """Collects figures; the page gets empty places and one JSON document each."""

    def __init__(self) -> None:
        self.items: list[str] = []  # JSON documents of the figures

    def add(self, figures: Iterable[Figure]) -> list[dict[str, Any]]:
        """Return the places of figures that are seen together: a sensor has one colour there."""
        described = list(figures)
        chosen = zip(described, coloured(described), strict=True)
        return [self._add(figure, colours) for figure, colours in chosen]

    def _add(self, figure: Figure, colours: Sequence[str]) -> dict[str, Any]:
        name, model = f'figure-{len(self.items) + 1}', draw(figure, colours)
        root, roots = document(model, f'{name}-')
        # what bokeh.embed.json_item would make
        content = {
            'target_id': name,
            'root_id': root,
            'doc': {'version': bokeh.__version__, 'title': '', 'roots': roots},
            'version': bokeh.__version__,
        }
        self.items.append(json.dumps(content, separators=(',', ':'), allow_nan=False))
        return {
            'id': name,
            'caption': figure.title,
            'picture': figure.image is not None,
            'height': str(height_of(model)),
            'choices': figure.choices if len(figure.choices) > 1 else (),
        }


class Nowhere(Places):
    """Draws nothing: of what stands beside many others like it, only tables are shown."""

    def add(self, figures: Iterable[Figure]) -> list[dict[str, Any]]:
        """Return no places."""
        return []


def page(template: str, collected: Places, **content: Any) -> str:
    """
    Return a page as one HTML document without any reference to the outside.

    Everything that comes from a recording (topics, frames, file names, notes) is escaped by the
    template engine.
    """
    return (
        _environment()
        .get_template(template)
        .render(
            style=Markup((_FOLDER / 'page.css').read_text(encoding='utf-8')),
            script=Markup((_FOLDER / 'page.js').read_text(encoding='utf-8')),
            library=_library(),
            figures=_packed(f'[{",".join(collected.items)}]') if collected.items else '',
            **{'banner': (), **content},
        )
    )


def _packed(words: str) -> Markup:
    """Return text as the browser unpacks it; base 64 cannot end the element it stands in."""
    return Markup(base64.b64encode(gzip.compress(words.encode(), EFFORT, mtime=0)).decode('ascii'))


@cache
def _library() -> Markup:
    """Return the plotting library that came with the Python package, without its widgets."""
    folder = Path(bokeh.__file__).parent / 'server' / 'static' / 'js'
    return _packed((folder / 'bokeh.min.js').read_text(encoding='utf-8'))


def bound(text: str) -> str:
    """Return text in which a line does not end between a number and its unit."""
    return _NUMBER.sub('\u00a0', text)


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(bound=bound, cells=cells, left_columns=words)
    return environment
