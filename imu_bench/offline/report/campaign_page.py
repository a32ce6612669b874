# SPDX-License-Identifier: Apache-2.0
"""The page that leads to the reports of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import os

from imu_bench import __version__
from imu_bench.offline.health import worst
from imu_bench.offline.notation import count
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.report.document import page, Places
from imu_bench.offline.whole_files import write_text


@dataclass(frozen=True, eq=False)
class Chapter:
    """
    One test of a campaign.

    Attributes
    ----------
    name, title, plan : str
    result : PlanResult or None
        None if the test has failed.
    link : str
        Its report, relative to the page.
    runs : int
    failure : str
        Why there is no result.
    """

    name: str
    title: str
    plan: str
    result: PlanResult | None = None
    link: str = ''
    runs: int = 0
    failure: str = ''

    @property
    def failed(self) -> bool:
        """Whether a part of the test has no result."""
        return self.result is None or bool(self.result.failures)

    @property
    def severity(self) -> str:
        """The worst of its findings."""
        return 'severe' if self.result is None else worst(self.result.findings)


def overview(chapters: Sequence[Chapter]) -> list[str]:
    """
    Return how the campaign went, a sentence each.

    Examples
    --------
    >>> overview([Chapter('tilt', 'Tilt', 'inclination', failure='no steps')])
    ['1 test; no result of Tilt.']
    """
    titles = [chapter.title or chapter.name for chapter in chapters]
    named = list(zip(titles, chapters, strict=True))
    lost = [title for title, chapter in named if chapter.result is None]
    partial = [title for title, chapter in named if chapter.failed and chapter.result is not None]
    found = [title for title, chapter in named if chapter.severity == 'severe' and chapter.result]
    said = count(len(chapters), 'test')
    said += f'; no result of {", ".join(lost)}.' if lost else ', all with a result.'
    lines = [said]
    if partial:
        lines.append(f'A part could not be measured in {", ".join(partial)}.')
    if found:
        lines.append(f'Not to be trusted without reading the findings: {", ".join(found)}.')
    return lines


def write(title: str, chapters: Sequence[Chapter], path: str | os.PathLike[str]) -> None:
    """
    Write the page.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = page(
        'campaign.html',
        Places(),
        title=title,
        version=__version__,
        chapters=chapters,
        overview=overview(chapters),
    )
    write_text(path, text)
