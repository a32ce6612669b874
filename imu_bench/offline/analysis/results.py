# SPDX-License-Identifier: Apache-2.0
"""
What an analysis found, and its JSON form: schema ``imu_bench.analysis/1``.

Every measured number is an `Estimate`; only counts, settings and the points of
curves are plain numbers.  `read` gives back what `write` wrote, except for the
decimated time series and the histograms of the axes, which exist for the report alone.

``health.jitter_histogram`` of a recording are the intervals between samples in s, without gaps:
``counts[i]`` lie between ``edges[i]`` and ``edges[i + 1]``, ``below`` and ``above`` outside of
all, ``expected`` are the counts of a normal distribution of the same mean and σ.  It is null
where all intervals are equal, and that of the gyroscope where two streams make one sensor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import os
from pathlib import Path
from typing import Any

from imu_bench.bags.problems import FOREIGN, SIMULATED
from imu_bench.config.json_file import read_json
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.normality import Histogram
from imu_bench.offline.analysis.axis_result import AxisResult
from imu_bench.offline.analysis.json_forms import histogram_from_json, histogram_to_json
from imu_bench.offline.analysis.settings import Failure
from imu_bench.offline.analysis.typed import check, plain
from imu_bench.offline.health import Health
from imu_bench.offline.whole_files import write_json
from imu_bench.version import __version__

SCHEMA = 'imu_bench.analysis/1'

_LONGEST = 200
"""Characters of a damaged document that an error text repeats."""

_HOW = 'make one with imu-bench analyze RECORDING --json FILE'


@dataclass(frozen=True, eq=False)
class RecordingResult:
    """Everything measured on one topic of one recording."""

    # source, topic, frame_id: input path as given, topic name, frame of the first message
    source: str
    topic: str
    frame_id: str
    # start_ns, end_ns: stamps of the first and the last sample that were analysed
    start_ns: int
    end_ns: int
    origin_ns: int  # stamp of the first sample of the recording: where plots have t = 0
    health: Health  # what is to be known before believing the numbers
    axes: Mapping[str, AxisResult]  # by axis name
    # of the intervals between samples; None if they are all equal
    intervals: Histogram | None = None
    # true sample rate in Hz by quantity, where they differ: two streams that are one sensor
    rates: Mapping[str, Estimate] = field(default_factory=dict)
    serial: str = ''  # number of the part, where it is known
    # the recordings that it was pooled from, by time; empty for a single one
    runs: tuple[RecordingResult, ...] = ()

    @property
    def where(self) -> str:
        """Names the recording in error texts."""
        return f'{self.source}, topic {self.topic}'

    @property
    def simulated(self) -> str:
        """What made the samples if nothing measured them; empty for a recording of a sensor."""
        found = (f.text for f in self.health.findings if f.code == SIMULATED)
        return next(found, '')

    @property
    def foreign(self) -> bool:
        """Whether it is of none of the sensors that were to be recorded."""
        return any(finding.code == FOREIGN for finding in self.health.findings)

    def of(self, quantity: str) -> list[AxisResult]:
        """Return the axes of one quantity, in the order x, y, z."""
        return [axis for axis in self.axes.values() if axis.quantity == quantity]

    def rate_of(self, quantity: str) -> Estimate:
        """Return the true sample rate of a quantity in Hz."""
        return self.rates.get(quantity, self.health.rate)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object of one recording."""
        jitter = None if self.intervals is None else histogram_to_json(self.intervals)
        document: dict[str, Any] = {
            'source': self.source,
            'topic': self.topic,
            'frame_id': self.frame_id,
            'foreign': self.foreign,
            'simulated': bool(self.simulated),
            'start_ns': self.start_ns,
            'end_ns': self.end_ns,
            'origin_ns': self.origin_ns,
            'health': self.health.to_json() | {'jitter_histogram': jitter},
            'axes': plain(self.axes),
        }
        if self.rates:
            document['rates'] = plain(self.rates)
        if self.serial:
            document['serial'] = self.serial
        if self.runs:
            document['runs'] = plain(self.runs)
        return document

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> RecordingResult:
        """Return the recording that `to_json` wrote."""
        jitter = document['health'].get('jitter_histogram')
        return cls(
            source=document['source'],
            topic=document['topic'],
            frame_id=document['frame_id'],
            start_ns=document['start_ns'],
            end_ns=document['end_ns'],
            origin_ns=document['origin_ns'],
            health=Health.from_json(document['health']),
            axes={n: AxisResult.from_json(n, d) for n, d in document['axes'].items()},
            intervals=None if jitter is None else histogram_from_json(jitter),
            rates={n: Estimate.from_json(d) for n, d in document.get('rates', {}).items()},
            serial=document.get('serial', ''),
            runs=tuple(map(cls.from_json, document.get('runs', ()))),
        )


@dataclass(frozen=True, eq=False)
class Analysis:
    """The result of one run over one or several recordings."""

    recordings: tuple[RecordingResult, ...]  # of sensors first
    failures: tuple[Failure, ...] = ()  # inputs without a result
    # what the user asked for; enough to run it again
    settings: Mapping[str, Any] = field(default_factory=dict)
    # JSON form of `imu_bench.offline.comparing.sensors.Comparison`
    comparison: Mapping[str, Any] = field(default_factory=dict)
    version: str = __version__  # of the package that computed it

    @property
    def sensors(self) -> tuple[RecordingResult, ...]:
        """The recordings without topics of others; all if there is nothing else."""
        return without_foreign(self.recordings)

    @property
    def failed(self) -> bool:
        """Whether anything that was asked for has no result."""
        return any(not failure.foreign for failure in self.failures)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            'schema': SCHEMA,
            'package': {'name': 'imu_bench', 'version': self.version},
            'settings': dict(self.settings),
            'recordings': plain(self.recordings),
            'comparison': dict(self.comparison),
            'failures': plain(self.failures),
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Analysis:
        """Return the analysis that `to_json` wrote."""
        schema = document.get('schema') if isinstance(document, Mapping) else None
        if schema != SCHEMA:
            raise RecordingError(
                f'not a result of this program: schema {schema!r}, not {SCHEMA}; {_HOW}'
            )
        try:
            made = cls(
                recordings=tuple(map(RecordingResult.from_json, document['recordings'])),
                failures=tuple(Failure(**failure) for failure in document['failures']),
                settings=document['settings'],
                comparison=document['comparison'],
                version=document['package']['version'],
            )
            check(made)
        except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise RecordingError(f'the result is damaged: {_reason(error)}; {_HOW}') from error
        return made


def without_foreign(recordings: Sequence[RecordingResult]) -> tuple[RecordingResult, ...]:
    """Return the recordings without topics of others; all if there is nothing else."""
    return tuple(each for each in recordings if not each.foreign) or tuple(recordings)


def write(analysis: Analysis, path: str | os.PathLike[str]) -> None:
    """
    Write the JSON document.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_json(path, analysis.to_json())


def read(path: str | os.PathLike[str]) -> Analysis:
    """
    Return the analysis in a JSON file.

    Raises
    ------
    RecordingError
        If the file is not such a document.
    OSError
        If the file cannot be read.
    """
    try:
        return Analysis.from_json(read_json(Path(path)))
    except IsADirectoryError as error:
        raise RecordingError(f'{path}: a folder, no result: {_HOW}') from error
    except RecordingError as error:
        raise RecordingError(f'{path}: {error}') from error
    except ValueError as error:
        raise RecordingError(f'{path}: not a JSON document ({_reason(error)}): {_HOW}') from error


def _reason(error: Exception) -> str:
    """Return what a document lacks in a few words."""
    name = '' if isinstance(error, (ValueError, OverflowError)) else f'{type(error).__name__} '
    return f'{name}{" ".join(str(error).split())[:_LONGEST]}'
