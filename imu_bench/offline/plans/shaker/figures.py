# SPDX-License-Identifier: Apache-2.0
"""Figures 3 and 7 to 12 of Capriglione et al. 2021 from a campaign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imu_bench.metrology.trials.crosstalk import Repeated
from imu_bench.offline.plans.result import PlanFigure, Series
from imu_bench.offline.plans.shaker.campaign import Campaign, Case, INDICES
from imu_bench.offline.plans.shaker.measuring import Shaken
from imu_bench.offline.plans.shaker.tables import TITLES
from imu_bench.samples import IMU_QUANTITIES, LINEAR_ACCELERATION, Quantity
from imu_bench.units import convert
import numpy as np

_FIGURES = {
    ('RR', 'linear_acceleration'): '8',
    ('RR', 'angular_velocity'): '9',
    ('SR', 'linear_acceleration'): '10',
    ('SR', 'angular_velocity'): '11',
}


def figures(campaign: Campaign, measured: Sequence[Shaken]) -> Iterator[PlanFigure]:
    """Yield all figures; bars with the standard deviation of a repetition."""
    for quantity in IMU_QUANTITIES:
        for name in INDICES:
            for sensor in campaign.sensors:
                yield from _bars(campaign, name, quantity, sensor)
    for sensor in campaign.sensors:
        yield from _ratio_bars(campaign, sensor)
    for sensor in campaign.sensors:
        yield from _error_bars(campaign, sensor)
    yield _zones(measured[0])


def _bar(label: str, found: Sequence[Repeated | None]) -> Series | None:
    """Return the bars of what was measured, with one standard deviation either side."""
    places, means, spreads = [], [], []
    for place, over in enumerate(found):
        if over is not None and over.mean.value is not None:
            places.append(float(place))
            means.append(over.mean.value)
            spreads.append(over.spread.value or 0.0)
    if not places:
        return None
    mean, spread = np.array(means), np.array(spreads)
    return Series(label, np.array(places), mean, mean - spread, mean + spread, 'bars')


def _bars(campaign: Campaign, name: str, quantity: Quantity, sensor: str) -> Iterator[PlanFigure]:
    series = [
        bars
        for condition in campaign.conditions
        if (
            bars := _bar(
                condition,
                [
                    campaign.index(name, quantity, Case(condition, j, sensor, True), i)[1]
                    for i, j in campaign.pairs
                ],
            )
        )
        is not None
    ]
    if series:
        number = _FIGURES[name, quantity.name]
        yield PlanFigure(
            f'{TITLES[quantity.name]} of {sensor}: {name} (figure {number})',
            'axis not excited, axis excited', f'{name} in dB', tuple(series),
            categories=tuple(f'{i}{j}' for i, j in campaign.pairs),
        )  # fmt: skip


def _ratio_bars(campaign: Campaign, sensor: str) -> Iterator[PlanFigure]:
    places = sorted(
        {
            (case.condition, case.axis)
            for case, runs in campaign.runs.items()
            if case.sensor == sensor and any(run.snr.value is not None for run in runs)
        }
    )
    series = []
    for random, label in ((False, 'sine alone'), (True, 'sine on random')):
        found = [campaign.ratio(Case(c, axis, sensor, random)) for c, axis in places]
        bars = _bar(label, found)
        if bars is not None:
            series.append(bars)
    if series:
        yield PlanFigure(
            f'Accelerometer of {sensor}: SNR (figure 12)', 'condition and axis', 'SNR in dB',
            tuple(series), categories=tuple(f'{c} {axis}' for c, axis in places),
        )  # fmt: skip


def _error_bars(campaign: Campaign, sensor: str) -> Iterator[PlanFigure]:
    """Yield means before and after with the standard deviation of the readings."""
    for condition in campaign.conditions[:1]:
        case = next(
            (
                c
                for c in campaign.runs
                if c[:1] == (condition,) and c.sensor == sensor and c.random
            ),
            None,
        )
        if case is None:
            continue
        name = f'{LINEAR_ACCELERATION.name}.{case.axis}'
        runs = [run.axes[name] for run in campaign.runs[case]]
        series = []
        for label, off, zones in (
            ('before', -0.1, [run.before for run in runs]),
            ('after', 0.1, [run.after for run in runs]),
        ):
            known = [(k, zone) for k, zone in enumerate(zones) if zone is not None]
            if not known:
                continue
            mean = np.array([convert(z[0].value or 0.0, z[0].unit, 'mg') for _, z in known])
            spread = np.array([convert(z[1].value or 0.0, z[1].unit, 'mg') for _, z in known])
            middle = float(np.mean([convert(run.before[0].value or 0.0, run.unit, 'mg')
                                    for run in runs]))  # fmt: skip
            x = np.array([k for k, _ in known]) + off
            mean = mean - middle
            series.append(Series(label, x, mean, mean - spread, mean + spread, 'points'))
        yield PlanFigure(
            f'Accelerometer {case.axis} of {sensor} before and after, {condition} (figure 7)',
            'repetition', 'mean and σ about the mean of all, mg',
            tuple(series), categories=tuple(str(k + 1) for k in range(len(runs))),
        )  # fmt: skip


def _zones(shaken: Shaken) -> PlanFigure:
    run = shaken.runs[0]
    time, level = shaken.level
    top = float(level.max())
    series = [Series('RMS of the accelerometer', time, level)]
    for name, zone in zip(
        ('before', 'test', 'after'), (run.zones.before, run.zones.test, run.zones.after),
        strict=True,
    ):  # fmt: skip
        if zone is not None:
            ends = np.array([zone.begin_s, zone.end_s])
            series.append(Series(name, ends, np.full(2, 1.2 * top), dashed=name != 'test'))
    return PlanFigure(
        f'Zones of {shaken.source.rsplit("/", 1)[-1]}, {run.sensor} (figure 3)', 'time in s',
        'acceleration in m/s²', tuple(series), log_y=True,
    )  # fmt: skip
