# SPDX-License-Identifier: Apache-2.0
"""A measured datasheet on A4: what `datasheet` describes, drawn by matplotlib into a PDF."""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
import textwrap
from typing import Any

from imu_bench.offline.presentation.datasheet import Sheet
from imu_bench.offline.presentation.figure import coloured, FAINT, Figure, INK
from imu_bench.offline.presentation.figure_files import fill, legend, look
from imu_bench.offline.presentation.tables import cells, Table, words
from imu_bench.offline.whole_files import whole
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure as Paper
from matplotlib.lines import Line2D

_WIDTH, _HEIGHT, _MARGIN = 8.27, 11.69, 0.55  # inches: A4
_ROOM = _WIDTH - 2.0 * _MARGIN
_LETTER = 0.58  # of the size of the type: the mean width of DejaVu Sans
_LINE = 1.45  # of the size of the type
_PER_INCH = 72.0
_SMALL, _TEXT, _HEAD, _TITLE = 6.5, 7.5, 9.0, 15.0  # points
_FIGURE = 2.55  # inches high, with legend and labels
_GAP = 0.12  # inches between columns


def write(sheet: Sheet, path: Path) -> None:
    """Write the datasheet; raises OSError if the file cannot be written."""
    # no date: the same results give the same file
    with (
        look(),
        whole(path) as draft,
        PdfPages(draft, metadata={'CreationDate': None, 'Title': sheet.title}) as pages,
    ):
        flow = _Flow(pages)
        flow.words(sheet.title, _TITLE, bold=True)
        for line in sheet.banner:
            flow.words(line, _TEXT, bold=True, box='#ffd54a')
        flow.words(sheet.health, _TEXT)
        for one in sheet.tables:
            flow.table(one)
        flow.figures(sheet.figures)
        flow.words('Provenance', _HEAD, bold=True)
        for name, value in sheet.provenance:
            flow.words(f'{name}: {value}', _SMALL)
        flow.end()


class _Flow:
    """Puts one thing below the other, on as many pages as it takes."""

    def __init__(self, pages: PdfPages) -> None:
        self._pages = pages
        self._begin()

    def _begin(self) -> None:
        self._paper = Paper(figsize=(_WIDTH, _HEIGHT))
        FigureCanvasAgg(self._paper)
        self._top = _MARGIN  # inches from the upper edge

    def end(self) -> None:
        """Write the last page."""
        self._pages.savefig(self._paper)  # type: ignore[no-untyped-call]

    def _need(self, height: float) -> None:
        if self._top + height > _HEIGHT - _MARGIN:
            self.end()
            self._begin()

    def _put(self, left: float, said: str, size: float, **style: Any) -> None:
        x, y = left / _WIDTH, 1.0 - self._top / _HEIGHT
        self._paper.text(x, y, said, size=size, va='top', **style)

    def _rule(self, colour: str) -> None:
        y = 1.0 - self._top / _HEIGHT
        ends = [_MARGIN / _WIDTH, 1.0 - _MARGIN / _WIDTH]
        self._paper.add_artist(Line2D(ends, [y, y], color=colour, lw=0.6))

    def words(self, said: str, size: float, *, bold: bool = False, box: str = '') -> None:
        """Put a paragraph."""
        letters = int(_ROOM * _PER_INCH / (size * _LETTER))
        lines = textwrap.wrap(said, letters) or ['']
        height = len(lines) * size * _LINE / _PER_INCH
        self._need(height)
        style: dict[str, Any] = (
            {'bbox': {'facecolor': box, 'edgecolor': 'none', 'pad': 2.0}} if box else {}
        )
        self._put(
            _MARGIN, '\n'.join(lines), size, color=INK, linespacing=_LINE / 1.2,
            weight='bold' if bold else 'normal', **style,
        )  # fmt: skip
        self._top += height + 0.06

    def table(self, one: Table) -> None:
        """Put a table with its title and its note, in the largest type that has room."""
        rows = cells(one)
        heads = [column.title for column in one.columns]
        widest = [
            max(len(head), *(len(row[at].text) for row in rows)) for at, head in enumerate(heads)
        ]
        room = _ROOM - _GAP * (len(widest) - 1)
        size = min(_TEXT, room * _PER_INCH / (_LETTER * sum(widest)))
        line = size * _LINE / _PER_INCH * 1.15
        self._top += 0.06
        self._need(line * (len(rows) + 4))
        self.words(one.title, _HEAD, bold=True)
        widths = [letters * size * _LETTER / _PER_INCH for letters in widest]
        lefts = [_MARGIN + sum(widths[:at]) + _GAP * at for at in range(len(widths))]
        left_set = words(one)
        for row in [heads, *([cell.text for cell in row] for row in rows)]:
            for at, said in enumerate(row):
                edge = lefts[at] if left_set[at] else lefts[at] + widths[at]
                self._put(
                    edge, said, size, ha='left' if left_set[at] else 'right',
                    color=FAINT if row is heads else INK,
                )  # fmt: skip
            self._top += line
            self._rule('#8a939d' if row is heads else '#e8ebef')
            self._top += 0.02
        if one.note:
            self._top += 0.02
            self.words(one.note, _SMALL)

    def figures(self, described: Sequence[Figure]) -> None:
        """Put figures side by side, two in a row."""
        for at in range(0, len(described), 2):
            self._need(_FIGURE + 0.3)
            for place, figure in enumerate(described[at : at + 2]):
                left = _MARGIN + place * (_ROOM / 2.0 + 0.1) + 0.5
                self._put(left - 0.5, figure.title, _TEXT, color=INK, weight='bold')
                ax = self._paper.add_axes((
                    left / _WIDTH, 1.0 - (self._top + _FIGURE - 0.15) / _HEIGHT,
                    (_ROOM / 2.0 - 0.65) / _WIDTH, (_FIGURE - 0.75) / _HEIGHT,
                ))  # fmt: skip
                colours = coloured([figure])[0]
                fill(ax, figure, colours)
                _name_marks(ax, figure, colours)
                legend(ax, figure, colours)
                ax.tick_params(labelsize=_SMALL)
                ax.xaxis.label.set_fontsize(_SMALL)
                ax.yaxis.label.set_fontsize(_SMALL)
            self._top += _FIGURE + 0.25


def _name_marks(ax: Axes, figure: Figure, colours: Sequence[str]) -> None:
    """Draw the words of marks: N right of the falling curve, or below it; others to the left."""
    middle = math.sqrt(math.prod(ax.get_xlim()))
    for series, colour in zip(figure.series, colours, strict=True):
        if series.kind != 'marks':
            continue
        ax.plot(series.x, series.y, linestyle='none', marker='v', color=colour, markersize=4)
        for at, (x, y, said) in enumerate(zip(series.x, series.y, series.words, strict=True)):
            turned = not at and x > middle
            place = (-4, -10) if turned else (4, 12) if at % 2 else (4, 5)
            ax.annotate(
                said, (x, y), xytext=place, textcoords='offset points', size=_SMALL - 1.0,
                ha='right' if at or turned else 'left', color=INK,
            )  # fmt: skip
