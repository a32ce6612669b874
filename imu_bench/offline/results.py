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

from collections.abc import Mapping
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
from typing import Any

from imu_bench import __version__
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.normality import Histogram
from imu_bench.offline.axis_result import AxisResult
from imu_bench.offline.failure import Failure
from imu_bench.offline.health import Health
from imu_bench.offline.metrology_json import histogram_from_json, histogram_to_json
from imu_bench.offline.whole_files import write_text

SCHEMA = 'imu_bench.analysis/1'

_HOW = 'make one with imu-bench analyze RECORDING --json FILE'


@dataclass(frozen=True, eq=False)
class RecordingResult:
    """
    Everything measured on one topic of one recording.

    Attributes
    ----------
    source, topic, frame_id : str
        Input path as given, topic name, frame of the first message.
    start_ns, end_ns : int
        Stamps of the first and the last sample that were analysed.
    origin_ns : int
        Stamp of the first sample of the recording: where plots have t = 0.
    health : Health
        What is to be known before believing the numbers.
    axes : mapping of str to AxisResult
        By axis name.
    intervals : Histogram or None
        Of the intervals between samples; None if they are all equal.
    rates : mapping of str to Estimate
        True sample rate in Hz by quantity, where they differ: two streams that are one sensor.
    """

    source: str
    topic: str
    frame_id: str
    start_ns: int
    end_ns: int
    origin_ns: int
    health: Health
    axes: Mapping[str, AxisResult]
    intervals: Histogram | None = None
    rates: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def where(self) -> str:
        """Names the recording in error texts."""
        return f'{self.source}, topic {self.topic}'

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
            'start_ns': self.start_ns,
            'end_ns': self.end_ns,
            'origin_ns': self.origin_ns,
            'health': self.health.to_json() | {'jitter_histogram': jitter},
            'axes': {name: axis.to_json() for name, axis in self.axes.items()},
        }
        if self.rates:
            document['rates'] = {name: rate.to_json() for name, rate in self.rates.items()}
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
        )


@dataclass(frozen=True, eq=False)
class Analysis:
    """
    The result of one run over one or several recordings.

    Attributes
    ----------
    recordings : tuple of RecordingResult
        In the order of the inputs.
    failures : tuple of Failure
        Inputs without a result.
    settings : mapping of str to object
        What the user asked for; enough to run it again.
    comparison : mapping of str to object
        JSON form of `imu_bench.offline.comparison.Comparison`.
    version : str
        Of the package that computed it.
    """

    recordings: tuple[RecordingResult, ...]
    failures: tuple[Failure, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    comparison: Mapping[str, Any] = field(default_factory=dict)
    version: str = __version__

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            'schema': SCHEMA,
            'package': {'name': 'imu_bench', 'version': self.version},
            'settings': dict(self.settings),
            'recordings': [recording.to_json() for recording in self.recordings],
            'comparison': dict(self.comparison),
            'failures': [{'source': f.source, 'error': f.error} for f in self.failures],
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Analysis:
        """
        Return the analysis that `to_json` wrote.

        Raises
        ------
        RecordingError
            If the document is of another schema, or not complete.
        """
        schema = document.get('schema') if isinstance(document, Mapping) else None
        if schema != SCHEMA:
            raise RecordingError(
                f'not a result of this program: schema {schema!r}, not {SCHEMA}; {_HOW}'
            )
        try:
            return cls(
                recordings=tuple(map(RecordingResult.from_json, document['recordings'])),
                failures=tuple(Failure(**failure) for failure in document['failures']),
                settings=document['settings'],
                comparison=document['comparison'],
                version=document['package']['version'],
            )
        except (KeyError, TypeError, ValueError) as error:
            raise RecordingError(f'the result is damaged: {error!r}') from error


def write(analysis: Analysis, path: str | os.PathLike[str]) -> None:
    """
    Write the JSON document.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = json.dumps(analysis.to_json(), ensure_ascii=False, allow_nan=False, indent=1)
    write_text(path, text + '\n')


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
        document = json.loads(Path(path).read_text(encoding='utf-8'))
        return Analysis.from_json(document)
    except (json.JSONDecodeError, UnicodeDecodeError, IsADirectoryError) as error:
        kind = 'a folder' if isinstance(error, IsADirectoryError) else 'not a JSON document'
        raise RecordingError(f'{path}: {kind}, no result: {_HOW}') from error
    except RecordingError as error:
        raise RecordingError(f'{path}: {error}') from error
