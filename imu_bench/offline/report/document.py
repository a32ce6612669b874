# SPDX-License-Identifier: Apache-2.0
"""What every page of ours is made of: its figures, its style, the plotting library, templates."""

from __future__ import annotations

from functools import cache
import json
from pathlib import Path
from typing import Any

import bokeh
from bokeh.core.serialization import Serializer
from bokeh.document import Document
from bokeh.models import LayoutDOM
from bokeh.resources import Resources
from imu_bench.offline.report import figures
import jinja2
from markupsafe import Markup

_FOLDER = Path(__file__).parent


class Places:
    """
    Collects figures; the page gets empty places and one JSON document each.

    Parameters
    ----------
    prefix : str
        Of the identifiers, where a page is put together from several collections.

    Attributes
    ----------
    items : list of str
        JSON documents of the figures.
    """

    def __init__(self, prefix: str = '') -> None:
        self.items: list[str] = []
        self._prefix = prefix

    def add(self, model: LayoutDOM, caption: str) -> dict[str, str]:
        """Return the identifier of the place and the caption."""
        name = f'figure-{self._prefix}{len(self.items) + 1}'
        # what bokeh.embed.json_item makes; a Document walks over all models three times more
        roots = Serializer(deferred=False).encode([model])
        content = {
            'root_id': model.id,
            'doc': {**_empty_document(), 'roots': roots},
            'version': bokeh.__version__,
        }
        self.items.append(_script_safe({'target_id': name, **content}))
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


def _script_safe(document: dict[str, Any]) -> str:
    """Return JSON that cannot end the script element it stands in."""
    return json.dumps(document, separators=(',', ':')).replace('<', '\\u003c')


@cache
def _empty_document() -> dict[str, Any]:
    return dict(Document(title='').to_json(deferred=False))


@cache
def _library() -> str:
    """Return the plotting library that came with the Python package, without its widgets."""
    return '\n'.join(Resources(mode='inline', components=['bokeh']).js_raw)


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
