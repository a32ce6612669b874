# SPDX-License-Identifier: Apache-2.0
"""What every page of ours is made of: its figures, its style, the plotting library, templates."""

from __future__ import annotations

from functools import cache
import json
from pathlib import Path
import re
from typing import Any

import bokeh
from imu_bench.offline.report import figures
from imu_bench.offline.report.models import document, Model
import jinja2
from markupsafe import Markup

_FOLDER = Path(__file__).parent
_UNIT = r'±|%|[mµn]?(?:°|g\b|m\b|s\b|rad\b)|(?:Hz|kHz|h|d|min|dB|rpm|ppm)\b'
_NUMBER = re.compile(rf'(?<=[\d⁰-⁹)]) (?={_UNIT})|(?<=±) (?=\d)')
"""The space between a number and its unit, and around the sign before its uncertainty."""


class Places:
    """
    Collects figures; the page gets empty places and one JSON document each.

    Attributes
    ----------
    items : list of str
        JSON documents of the figures.
    """

    def __init__(self) -> None:
        self.items: list[str] = []

    def add(self, model: Model, caption: str) -> dict[str, str]:
        """Return the identifier of the place and the caption."""
        name = f'figure-{len(self.items) + 1}'
        root, roots = document(model, f'{name}-')
        # what bokeh.embed.json_item would make
        content = {
            'target_id': name,
            'root_id': root,
            'doc': {'version': bokeh.__version__, 'title': '', 'roots': roots},
            'version': bokeh.__version__,
        }
        self.items.append(_script_safe(content))
        return {'id': name, 'caption': caption, 'height': str(figures.height_of(model))}


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
            library=Markup(_library()),
            figures=[Markup(item) for item in collected.items],
            **content,
        )
    )


def _script_safe(content: dict[str, Any]) -> str:
    """Return JSON that cannot end the script element it stands in."""
    return json.dumps(content, separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')


@cache
def _library() -> str:
    """Return the plotting library that came with the Python package, without its widgets."""
    folder = Path(bokeh.__file__).parent / 'server' / 'static' / 'js'
    return (folder / 'bokeh.min.js').read_text(encoding='utf-8')


def bound(text: str) -> str:
    r"""
    Return text in which a line does not end between a number and its unit.

    Examples
    --------
    >>> bound('at most 0.0052 ± 0.0004 °') == 'at most 0.0052\u00a0±\u00a00.0004\u00a0°'
    True
    """
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
    environment.filters['bound'] = bound
    return environment
