# SPDX-License-Identifier: Apache-2.0
"""
The Python interface, as ``import imu_bench as ib`` shows it.

Its names and those of the classes here are stable: see docs/python.md.

>>> from tempfile import mkdtemp
>>> import imu_bench as ib, numpy as np
>>> file = f'{mkdtemp()}/chip.csv'
>>> turns = np.random.default_rng(3).normal(0.0, 1e-3, (2000, 3))
>>> stamps = np.arange(2000) / 100.0
>>> names = 'stamp_s,angular_velocity.x,angular_velocity.y,angular_velocity.z'
>>> np.savetxt(file, np.column_stack([stamps, turns]), delimiter=',', header=names, comments='')
>>> r = ib.analyze(file)
>>> print(r['chip'].gyro.z.N)
(1.003 ± 0.058)×10⁻⁴ rad/s/√Hz
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
import os
from pathlib import Path
from typing import Any, TYPE_CHECKING

from imu_bench.api.views import Changes, Paths
from imu_bench.api.views import Result as Result
from imu_bench.errors import RecordingError
from imu_bench.metrology.allan import deviation
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import CONFIDENCE
from imu_bench.offline import analyze as _analyze
from imu_bench.offline.analysis import results
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.comparing.runs import compare_runs, named
from imu_bench.offline.recordings import load_all, open_source, ReadOptions, Recording
from imu_bench.samples import Samples

if TYPE_CHECKING:
    import numpy.typing as npt


def analyze(*inputs: Paths, **asked: Any) -> Result:
    """
    Return what is measured on recordings, each Imu topic of them, and how they compare.

    Parameters
    ----------
    *inputs : path
        Bags, text files, arrays, or folders of such.
    **asked : object
        Fields of `ReadOptions` (topics, rate_hz, columns, units) and of `Settings` (taus,
        start_s, end_s, window_ns, confidence, reference, min_share).

    Raises
    ------
    RecordingError
        If a path holds no recording, or nothing could be analysed.
    """
    options, settings = _split(asked)
    found = _analyze([os.fspath(each) for each in inputs], options, settings)
    if not found.recordings:
        raise RecordingError('; '.join(f.error for f in found.failures) or 'nothing to analyse')
    return Result(found)


def _split(asked: Mapping[str, Any]) -> tuple[ReadOptions, Settings]:
    of = {field.name: cls for cls in (ReadOptions, Settings) for field in fields(cls)}
    wrong = [name for name in asked if name not in of]
    if wrong:
        raise TypeError(f'unknown option {wrong[0]!r}; there are {", ".join(of)}')
    parts: dict[type, dict[str, Any]] = {ReadOptions: {}, Settings: {}}
    for name, value in asked.items():
        parts[of[name]][name] = value
    return ReadOptions(**parts[ReadOptions]), Settings(**parts[Settings])


def load(path: Paths) -> Result:
    """
    Return the result in a JSON file of `Result.save` or ``imu-bench analyze --json``.

    Raises
    ------
    RecordingError
        If it is none.
    """
    return Result(results.read(path))


def read(path: Paths, **options: Any) -> dict[str, Recording]:
    """
    Return the recordings in a file by topic: `samples` of each hold stamps and columns in SI.

    Parameters
    ----------
    path : path
        A bag, a text file or an array.
    **options : object
        Fields of `ReadOptions`: topics, rate_hz, columns, units.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    source = open_source(Path(path), ReadOptions(**options))
    return {recording.topic: recording for recording in load_all(source, source.topics)}


def simulate(
    bench: Paths, scenario: str = 'still', *, duration_s: float, seed: int = 0
) -> dict[str, list[Samples]]:
    """
    Return what the sensors of a bench would measure, by name; one run of samples for each rate.

    Parameters
    ----------
    bench : path
        A bench of config/benches by its name, or a YAML file.
    scenario : str
        One of config/scenarios, or a YAML file.
    duration_s : float
        How long it lasts, in s.
    seed : int
        Another run of the same sensors.

    Raises
    ------
    ConfigError
        If bench or scenario are unknown or wrong.
    """
    from imu_bench import bench as benches
    from imu_bench.config.location import named_file
    from imu_bench.simulation.clock import START_NS
    from imu_bench.simulation.scenario import load_scenario

    config = benches.load_bench(named_file('benches', os.fspath(bench)))
    moved = load_scenario(scenario, seed=seed)
    until = START_NS + round(duration_s * 1e9)
    return {
        sensor.name: [
            source.samples_until(until)
            for source in benches.simulate(sensor, moved, run=seed).sources
        ]
        for sensor in config.sensors
    }


def compare(*found: Result | Paths) -> Changes:
    """
    Return results, or files of such, against the first of them.

    Raises
    ------
    RecordingError
        If there are fewer than two, or no sensor of one is in another.
    """
    analyses, paths = [], []
    for number, each in enumerate(found, 1):
        whole = each if isinstance(each, Result) else load(each)
        analyses.append(whole.analysis)
        paths.append(f'result {number}' if isinstance(each, Result) else os.fspath(each))
    return Changes(compare_runs(named(paths, analyses)))


def export(found: Result | Paths, to: str, topic: str = '', *, conservative: bool = False) -> str:
    """
    Return the numbers of a result in the form of another program, such as kalibr.

    Parameters
    ----------
    found : Result or path
        What is exported, or where its JSON lies.
    to : str
        One of `imu_bench.offline.exports.FORMATS`.
    topic : str
        Topic or label of the sensor; not needed where there is one only.
    conservative : bool
        Upper ends of intervals instead of values.

    Raises
    ------
    RecordingError
        If format or sensor are unknown, or the result lacks what the format needs.
    """
    whole = found if isinstance(found, Result) else load(found)
    return whole.export(to, topic, conservative=conservative)


def oadev(
    data: npt.ArrayLike, rate_hz: float, *, confidence: float = CONFIDENCE, **options: Any
) -> DeviationCurve:
    """
    Return the overlapping Allan deviation of one axis: `deviation` with kind='oadev'.

    Parameters
    ----------
    data : array_like, shape (n,)
        Samples of a rate (angular velocity, acceleration) on a regular time grid.
    rate_hz : float
        Sample rate in Hz.
    confidence : float
        Level of the intervals.
    **options : object
        Those of `deviation`: tau, valid, unit, overlap, threads, ...

    Returns
    -------
    DeviationCurve
        tau in s; deviation, low and high in `unit`; all of shape (k,).

    Raises
    ------
    DataError
        If the data give not one averaging time, or a sample is NaN that `valid` does not name.

    References
    ----------
    NIST SP 1065 (2008), section 5.2.

    Examples
    --------
    >>> import numpy as np
    >>> curve = oadev(np.random.default_rng(1).normal(0.0, 1e-3, 10_000), 100.0, unit='rad/s')
    >>> print(curve.at(0))
    0.001003 ± 0.000017 rad/s
    """
    return deviation(data, rate_hz, kind='oadev', confidence=confidence, **options)
