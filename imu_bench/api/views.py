# SPDX-License-Identifier: Apache-2.0
"""What an analysis found, under the names that people say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from io import StringIO
import os
from typing import Any, TYPE_CHECKING

from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline import exports
from imu_bench.offline.analysis import results
from imu_bench.offline.analysis.axis_result import AxisResult, Density, STATISTICS
from imu_bench.offline.analysis.results import Analysis, RecordingResult
from imu_bench.offline.comparing.runs import Change, RunComparison
from imu_bench.offline.comparing.sensors import labels
from imu_bench.offline.health import Health
from imu_bench.offline.notation import rate_text, text, unit_of
from msg_conversions.quantities import AXES

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    import pandas
    import xarray

Paths = str | os.PathLike[str]

COEFFICIENTS = ('Q', 'N', 'B', 'K', 'R')

SHORT = {
    'accel': 'linear_acceleration',
    'gyro': 'angular_velocity',
    'magnetometer': 'magnetic_field',
}
"""Names of quantities as people say them."""


class Figures(list['Figure']):
    """Figures of matplotlib, which a notebook shows one below the other."""

    def _repr_html_(self) -> str:
        return ''.join(map(_svg, self))


class Changes:
    """
    Results against the first of them.

    Parameters
    ----------
    compared : RunComparison
        Its lines are iterated over: sensor, run, axis, parameter, reference, value, ratio,
        difference, e_n and verdict ('same', 'higher', 'lower' or 'undecided').
    """

    def __init__(self, compared: RunComparison) -> None:
        self.compared = compared

    @property
    def lines(self) -> tuple[Change, ...]:
        """Every number against that of the reference."""
        return self.compared.lines

    def __len__(self) -> int:
        return len(self.lines)

    def __iter__(self) -> Iterator[Change]:
        return iter(self.lines)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document that ``imu-bench compare --json`` writes."""
        return self.compared.to_json()

    def __repr__(self) -> str:
        from imu_bench.offline.presentation import run_tables

        return '\n'.join(run_tables.summary(self.compared))

    def _repr_html_(self) -> str:
        from imu_bench.offline.presentation import run_tables
        from imu_bench.offline.presentation.tables import cells

        parts = [f'<p>{escape(repr(self))}</p>']
        for sensor, run in dict.fromkeys((line.sensor, line.run) for line in self.lines):
            table = run_tables.table(self.compared, sensor, run, run_tables.ON_PAGE)
            parts.append(f'<p>{escape(sensor)}: {escape(table.title)}</p>')
            heads = [column.title for column in table.columns]
            parts.append(_html(heads, [[cell.text for cell in row] for row in cells(table)]))
        return ''.join(parts)


class Axis:
    """
    Everything measured on one axis.

    Attributes
    ----------
    Q, N, B, K, R : Estimate
        Noise coefficients (IEEE Std 952-1997, annex C).
    noise_density : Estimate
        One-sided, in unit/√Hz.
    mean, std, rms, rms_total, minimum, maximum, peak_to_peak, three_sigma : Estimate
        Statistics, in the unit of the axis.
    oadev : DeviationCurve or None
        Overlapping Allan deviation with its interval; None for an axis without any noise.
    psd : Density or None
        Power spectral density; None if there is none.
    """

    def __init__(self, result: AxisResult) -> None:
        self.result = result

    @property
    def name(self) -> str:
        """Name as in the JSON document, for example 'angular_velocity.z'."""
        return self.result.name

    @property
    def unit(self) -> str:
        """Unit of the signal, SI."""
        return self.result.unit

    @property
    def noise_density(self) -> Estimate:
        """One-sided noise density, the number to compare sensors by."""
        return self.result.white_density

    @property
    def oadev(self) -> DeviationCurve | None:
        """Overlapping Allan deviation."""
        return self.result.allan

    @property
    def psd(self) -> Density | None:
        """One-sided power spectral density and its tones."""
        return self.result.psd

    def __getattr__(self, name: str) -> Estimate:
        if name in COEFFICIENTS:
            return self.result.coefficient(name)
        if name in STATISTICS and name in self.result.statistics:
            return self.result.statistics[name]
        raise AttributeError(f'{self.name} has no {name!r}; it has {", ".join(self._numbers())}')

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._numbers()]

    def _numbers(self) -> list[str]:
        return [*COEFFICIENTS, 'noise_density', *self.result.statistics, 'oadev', 'psd']

    def __repr__(self) -> str:
        return f'<{self.name}: N {self.N}, B {self.B}>'


class Quantity:
    """The axes of one quantity by their letters: x, y and z."""

    def __init__(self, axes: Mapping[str, Axis]) -> None:
        self._axes = axes

    def __getattr__(self, letter: str) -> Axis:
        if letter.startswith('_') or letter not in self._axes:
            raise AttributeError(f'no axis {letter!r}; there are {", ".join(AXES)}')
        return self._axes[letter]

    def __getitem__(self, letter: str) -> Axis:
        return self._axes[letter]

    def __iter__(self) -> Iterator[str]:
        return iter(self._axes)

    def __len__(self) -> int:
        return len(self._axes)

    def __repr__(self) -> str:
        return '\n'.join(map(repr, self._axes.values()))


class Sensor:
    """What was measured on one topic of one recording, or on one sensor of several."""

    def __init__(self, label: str, result: RecordingResult) -> None:
        self.label, self.result = label, result

    @property
    def topic(self) -> str:
        """Name of the topic."""
        return self.result.topic

    @property
    def source(self) -> str:
        """Path as given."""
        return self.result.source

    @property
    def health(self) -> Health:
        """What is to be known before believing the numbers."""
        return self.result.health

    @property
    def rate(self) -> Estimate:
        """True sample rate."""
        return self.result.health.rate

    @property
    def simulated(self) -> str:
        """What made the samples if nothing measured them, else empty."""
        return self.result.simulated

    @property
    def axes(self) -> dict[str, Axis]:
        """Every axis by its name in the JSON document."""
        return {name: Axis(axis) for name, axis in self.result.axes.items()}

    def __getattr__(self, name: str) -> Quantity:
        full = SHORT.get(name, name)
        found = {axis.letter: Axis(axis) for axis in self.result.of(full)}
        if not found:
            there = {axis.quantity for axis in self.result.axes.values()}
            known = [short for short, long in SHORT.items() if long in there] or sorted(there)
            raise AttributeError(f'{self.label} has no {name!r}; it has {", ".join(known)}')
        return Quantity(found)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(n for n, full in SHORT.items() if self.result.of(full))]

    def __repr__(self) -> str:
        made = f', {self.simulated}' if self.simulated else ''
        seconds = (self.result.end_ns - self.result.start_ns) * 1e-9
        return f'<{self.label}: {seconds:.4g} s at {rate_text(self.rate)}{made}>'

    def _repr_html_(self) -> str:
        return _table([self])


class Result:
    """
    What `analyze` found: its sensors by topic, label or place.

    Its `analysis` has the settings, the failures and the comparison of the sensors as well.
    """

    def __init__(self, analysis: Analysis) -> None:
        self.analysis = analysis
        named_ = zip(labels(analysis.recordings), analysis.recordings, strict=True)
        self.sensors = [Sensor(label, recording) for label, recording in named_]

    def __len__(self) -> int:
        return len(self.sensors)

    def __iter__(self) -> Iterator[Sensor]:
        return iter(self.sensors)

    def __getitem__(self, which: str | int) -> Sensor:
        if isinstance(which, int):
            return self.sensors[which]
        found = [s for s in self.sensors if which in (s.label, s.topic)]
        if len(found) == 1:
            return found[0]
        names = ', '.join(s.label for s in found or self.sensors)
        problem = 'names several: choose among' if found else 'is no sensor of this result:'
        raise KeyError(f'{which!r} {problem} {names}')

    def export(self, to: str, topic: str = '', *, conservative: bool = False) -> str:
        """Return the numbers in the form of another program: see `export`."""
        return exports.render(self.analysis, to, topic, conservative=conservative)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document of schema imu_bench.analysis/1."""
        return self.analysis.to_json()

    def save(self, path: Paths) -> None:
        """Write the JSON document, which `load` reads and `compare` compares."""
        results.write(self.analysis, path)

    def report(self, path: Paths) -> None:
        """Write the page that ``imu-bench analyze --html`` writes."""
        from imu_bench.offline import write_report

        write_report(self.analysis, path)

    def plot(self, kind: str = 'allan') -> Figures:
        """
        Return figures of matplotlib, which Jupyter shows: one for each quantity of each sensor.

        Parameters
        ----------
        kind : {'allan', 'spectrum', 'time', 'histogram'}
            Which figure.

        Raises
        ------
        ModuleNotFoundError
            Without matplotlib: ``pip install imu_bench[figures]``.
        """
        from imu_bench.offline.presentation import analysis_figures
        from imu_bench.offline.presentation.figure_files import draw, look

        with look():
            return Figures(
                draw(figure)
                for sensor in self.sensors
                for quantity in SHORT.values()
                for drawn, figure in analysis_figures.of_sensor(sensor.result, quantity)
                if drawn == kind
            )

    def to_pandas(self) -> pandas.DataFrame:
        """
        Return every number in a row of its own: the table that exports as csv.

        Raises
        ------
        ModuleNotFoundError
            Without pandas: ``pip install imu_bench[notebook]``.
        """
        import pandas

        return pandas.DataFrame(exports.rows(self.analysis.recordings), columns=exports.COLUMNS)

    def to_xarray(self) -> xarray.Dataset:
        """
        Return the numbers as variables over (sensor, axis, end), end being value, low and high.

        Units are attributes of the variables, one for each quantity.  What is not observable is
        NaN, but for its upper bound.

        Raises
        ------
        ModuleNotFoundError
            Without xarray: ``pip install imu_bench[notebook]``.
        """
        import xarray

        ends = ('value', 'low', 'high')
        made = {}
        for full in dict.fromkeys(SHORT.values()):
            for name in (*COEFFICIENTS, 'noise_density', *STATISTICS):
                found = {
                    (sensor.label, letter): getattr(axis, name)
                    for sensor in self.sensors
                    for letter, axis in _axes(sensor, full).items()
                    if hasattr(axis, name)
                }
                if not found:
                    continue
                rows = [
                    [[_end(found.get((s.label, letter)), end) for end in ends] for letter in AXES]
                    for s in self.sensors
                ]
                unit = next(iter(found.values())).unit
                made[f'{full}.{name}'] = (('sensor', 'axis', 'end'), rows, {'units': unit})
        places = {'sensor': [s.label for s in self.sensors], 'axis': list(AXES), 'end': list(ends)}
        return xarray.Dataset(made, coords=places)

    def __repr__(self) -> str:
        return '\n'.join(map(repr, self.sensors)) or '<no sensor>'

    def _repr_html_(self) -> str:
        return _table(self.sensors)


def _axes(sensor: Sensor, quantity: str) -> dict[str, Axis]:
    return {axis.letter: Axis(axis) for axis in sensor.result.of(quantity)}


def _end(estimate: Estimate | None, end: str) -> float:
    found = None if estimate is None else getattr(estimate, end)
    return float('nan') if found is None else found


def _table(sensors: list[Sensor]) -> str:
    """Return N, B, K and the noise density of every axis as a table of HTML."""
    shown = (('noise density', 'noise_density', 'density'), ('N', 'N', 'N'), ('B', 'B', 'B'),
             ('K', 'K', 'K'))  # fmt: skip
    rows = []
    for sensor in sensors:
        made = f' ({sensor.simulated})' if sensor.simulated else ''
        for name, axis in sensor.axes.items():
            found = [(getattr(axis, attribute), role) for _, attribute, role in shown]
            numbers = [text(e, unit_of([e], role)) for e, role in found]
            rows.append([f'{sensor.label}{made}', name, *numbers])
    return _html(['sensor', 'axis', *(head for head, _, _ in shown)], rows)


def _html(heads: list[str], rows: list[list[str]]) -> str:
    """Return a table of HTML, with every text escaped."""
    head = ''.join(f'<th>{escape(each)}</th>' for each in heads)
    body = ''.join(f'<tr>{"".join(f"<td>{escape(c)}</td>" for c in row)}</tr>' for row in rows)
    return f'<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def _svg(figure: Figure) -> str:
    file = StringIO()
    figure.savefig(file, format='svg', metadata={'Date': None})
    written = file.getvalue()
    return written[written.index('<svg') :]  # without what only a file of its own has
