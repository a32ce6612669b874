# SPDX-License-Identifier: Apache-2.0
"""The page that leads to the reports of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import os
from pathlib import Path

from imu_bench import __version__
from imu_bench.offline.health import worst
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.report.document import page, Places


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


def write(title: str, chapters: Sequence[Chapter], path: str | os.PathLike[str]) -> None:
    """
    Write the page.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = page('campaign.html', Places(), title=title, version=__version__, chapters=chapters)
    Path(path).write_text(text, encoding='utf-8')
