# SPDX-License-Identifier: Apache-2.0
"""
What a test plan found: words, tables and figures, whoever shows them.

A plan computes; terminal, JSON document, report and figure files show every plan alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import os
from typing import Any

from imu_bench.bags.problems import SIMULATED
from imu_bench.offline.analysis.settings import Failure
from imu_bench.offline.analysis.typed import plain
from imu_bench.offline.health import Finding
from imu_bench.offline.plans.recorded import Recorded
from imu_bench.offline.presentation.figure import Figure
from imu_bench.offline.presentation.tables import Table
from imu_bench.offline.whole_files import write_json
from imu_bench.version import __version__

SCHEMA = 'imu_bench.plan/1'


@dataclass(frozen=True, eq=False)
class PlanResult:
    """What a test plan found."""

    # plan, title: name as given to ``--plan``; heading of the report
    plan: str
    title: str
    summary: tuple[str, ...]  # the answer in sentences, the most important first
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()  # not in the JSON document
    findings: tuple[Finding, ...] = ()  # what casts doubt on the result
    # JSON-ready numbers for programs, in SI; Estimates through ``to_json``
    values: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)  # what the user asked for
    sources: tuple[str, ...] = ()  # recordings it rests on
    failures: tuple[Failure, ...] = ()  # recordings without a result
    recorded: tuple[Recorded, ...] = ()  # when, how long and how well each stream was recorded
    document: str = ''  # that the plan follows
    form: str = ''  # in what a short form differs from the test as it is

    @property
    def simulated(self) -> str:
        """What made the samples if nothing measured them; empty for recordings of sensors."""
        return next((f.text for f in self.findings if f.code == SIMULATED), '')

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document of schema imu_bench.plan/1."""
        return {
            'schema': SCHEMA,
            'package': {'name': 'imu_bench', 'version': __version__},
            'plan': self.plan,
            'title': self.title,
            'document': self.document,
            'form': self.form,
            'simulated': bool(self.simulated),
            'recorded': plain(self.recorded),
            'settings': dict(self.settings),
            'sources': list(self.sources),
            'summary': list(self.summary),
            'findings': plain(self.findings),
            'values': dict(self.values),
            'tables': [_table_json(table) for table in self.tables],
            'failures': plain(self.failures),
        }


def _table_json(table: Table) -> dict[str, Any]:
    return {
        'title': table.title,
        'note': table.note,
        'columns': [{'title': column.title, 'unit': column.unit} for column in table.columns],
        'rows': plain(table.rows),
    }


def write(result: PlanResult, path: str | os.PathLike[str]) -> None:
    """Write the JSON document; raises OSError if the file cannot be written."""
    write_json(path, result.to_json())
