# SPDX-License-Identifier: Apache-2.0
"""
Sine on random: the test plan of Capriglione et al. 2021.

Performance analysis of MEMS-based inertial measurement units in terrestrial vehicles: sensors on
a shaker along one axis at a time, a quiet zone, a sine on random vibration, a quiet zone, five
repetitions of each; rejection ratio RR, spurious response ratio SR, signal-to-noise ratio, and
whether the sensor is the same after as before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from imu_bench.config.schema import Setting
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.metrology.spectra.snr import HARMONICS
from imu_bench.metrology.trials.crosstalk import COVERAGE
from imu_bench.offline.health import Finding
from imu_bench.offline.notation import text
from imu_bench.offline.plans.plan import Plan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.plans.sine_on_random import measuring, presenting
from imu_bench.offline.plans.sine_on_random.comparing import Campaign, Case, PAIRS, values
from imu_bench.offline.plans.sine_on_random.control import present
from imu_bench.offline.plans.sine_on_random.identity import EXCITATIONS
from imu_bench.offline.plans.sine_on_random.measuring import SensorRun, Shaken
from imu_bench.offline.recordings import Recording
from imu_bench.units import STANDARD_GRAVITY
from msg_conversions.quantities import AXES, IMU_QUANTITIES, LINEAR_ACCELERATION

_FOLDED_HZ = 0.25
"""A sine is where it should be if its line is this near: the three of table III are 5 Hz apart."""


class SineOnRandom(Plan[Shaken]):
    """Sensors on a shaker, as in the document."""

    name = 'sine-on-random'
    title = 'Sine on random vibration'
    document = (
        'Capriglione et al., Performance analysis of MEMS-based inertial measurement units in '
        'terrestrial vehicles, 2021'
    )
    SETTINGS = (
        Setting('condition', '', 'Service condition of every recording, such as SC1.'),
        Setting('axis', '', 'Axis excited in every recording.', ('', *AXES)),
        Setting('repetition', 0, 'Number of the repetition; 0 as recorded.', bounds=(0, 10**6)),
        Setting('excitation', '', 'What the shaker does.', ('', *EXCITATIONS)),
        Setting(
            'frequency', None, 'Frequency of the sine, where it is not that of table III.', (),
            (1e-3, 1e6), 'Hz', 'quantity',
        ),
        Setting(
            'zones', None, 'Lengths of the zones before, test and after; found if not given.', (),
            (0.0, 1e7), 's', 'quantity',
        ),
        Setting(
            'shortest', (5.0,), 'Shortest zone that counts as one.', (), (1.0, 1e6), 's',
            'quantity',
        ),
        Setting(
            'guard', (2.0,), 'Left out at either end of a zone.', (), (0.0, 1e6), 's', 'quantity'
        ),
        Setting(
            'harmonics', HARMONICS, 'Harmonics that are no noise, with the sine.', bounds=(1, 50)
        ),
        Setting('control', '', 'Accelerometer of the shaker, held against the profile.'),
        Setting(
            'density', (0.01 * STANDARD_GRAVITY**2,), 'Random vibration of the profile.', (),
            (0.0, 1e9), '(m/s²)²/Hz', 'quantity',
        ),
        Setting(
            'band', (200.0, 2000.0), 'Where the random vibration begins and ends.', (),
            (0.0, 1e6), 'Hz', 'quantity',
        ),
        Setting(
            'coverage', COVERAGE, 'Multiple of the uncertainty up to which zones are compatible.',
            bounds=(0.1, 10.0),
        ),
    )  # fmt: skip

    def measure(self, source: str, recordings: Sequence[Recording]) -> Shaken:
        """Return the zones of a recording and every axis in them."""
        return measuring.measure(source, recordings, self.settings, self.confidence)

    def conclude(self, measured: Sequence[Shaken]) -> PlanResult:
        """Return the tables of the document."""
        runs = [run for shaken in measured for run in shaken.runs]
        control = self.settings['control']
        if control and not any(run.control for run in runs):
            there = ', '.join(dict.fromkeys(run.sensor for run in runs))
            raise RecordingError(f'--set control={control}: not among the sensors: {there}')
        tables, figures = present(
            [
                (run.source.rstrip('/').rpartition('/')[2], run.control)
                for run in runs
                if run.control is not None and run.identity.random
            ],
            self.settings,
        )
        campaign = Campaign.of(runs, self.confidence, self.settings['coverage'])
        return PlanResult(
            self.name,
            self.title,
            tuple(_summary(campaign)),
            (*presenting.tables(campaign), *tables),
            (*presenting.figures(campaign, measured), *figures),
            tuple(_findings(campaign, runs)),
            values(campaign),
        )


def _summary(campaign: Campaign) -> Iterator[str]:
    total = sum(len(runs) for runs in campaign.runs.values())
    yield (
        f'{total} runs: {", ".join(campaign.conditions) or "no condition with random vibration"} '
        f'on {", ".join(campaign.sensors)}.'
    )
    yield _compatible(campaign)
    worst = _worst(campaign)
    if worst is not None:
        case, axis, found = worst
        yield (
            f'Least rejection: {case.sensor} {axis} shows {text(found)} less than the excited '
            f'{case.axis} ({case.condition}).'
        )
    losses = [
        (loss.value, case, loss)
        for case in campaign.runs
        if case.random and (loss := campaign.loss(case)).value is not None
    ]
    if losses:
        _, case, loss = max(losses, key=lambda item: item[0])
        yield (
            f'Random vibration costs up to {text(loss)} of SNR: {case.sensor} {case.axis}, '
            f'{case.condition}.'
        )


def _compatible(campaign: Campaign) -> str:
    verdicts = [
        verdict
        for quantity in IMU_QUANTITIES
        for sensor in campaign.sensors
        for _, axis in campaign.quiet(quantity, sensor)
        if (verdict := campaign.compared(axis)) is not None
    ]
    if not verdicts:
        return 'No quiet zone after the vibration: nothing to compare with the one before.'
    agree = sum(verdict.compatible for verdict in verdicts)
    if agree == len(verdicts):
        return (
            f'Before and after are fully compatible, in all {agree} comparisons: the vibration '
            'left no trace.'
        )
    return (
        f'Before and after are not compatible in {len(verdicts) - agree} of {len(verdicts)} '
        'comparisons.'
    )


def _worst(campaign: Campaign) -> tuple[Case, str, Estimate] | None:
    """Return case, axis and RR of the accelerometer axis that rejects least."""
    found = []
    for case in campaign.runs:
        for i, j in PAIRS:
            if case.random and case.axis == j:
                _, over = campaign.index('RR', LINEAR_ACCELERATION, case, i)
                if over is not None and over.mean.value is not None:
                    found.append((over.mean.value, case, i, over.mean))
    if not found:
        return None
    _, case, axis, mean = min(found, key=lambda item: item[0])
    return case, axis, mean


def _findings(campaign: Campaign, runs: Sequence[SensorRun]) -> Iterator[Finding]:
    for quantity in IMU_QUANTITIES:
        for sensor in campaign.sensors:
            for run, axis in campaign.quiet(quantity, sensor):
                verdict = campaign.compared(axis)
                if verdict is not None and not verdict.compatible:
                    yield Finding(
                        'warning', 'not-compatible',
                        f'{run.source}: {sensor} {axis.name} differs after the vibration by '
                        f'{verdict.difference:.3g} {axis.unit}',
                        'The sensor or its mounting changed.',
                        'Look at the zones before and after in the recording; repeat the run.',
                    )  # fmt: skip
    if all(case.random for case in campaign.runs):
        yield Finding(
            'info', 'no-reference', 'No recording of the sine without random vibration.',
            'How much SNR the random vibration costs is not known.',
            'Record the sine alone, named like sc1_x_sine or with --custom-data excitation=sine.',
        )  # fmt: skip
    yield from _folded(runs)


def _folded(runs: Sequence[SensorRun]) -> Iterator[Finding]:
    """Say where a sensor shows the sine at another frequency than that of the shaker."""
    told = set()
    for run in runs:
        asked, seen = run.identity.sine_hz, run.fundamental
        key = (run.identity.condition, run.sensor)
        if asked is None or seen is None or key in told or abs(seen - asked) <= _FOLDED_HZ:
            continue
        told.add(key)
        folded = abs(asked - run.rate_hz * round(asked / run.rate_hz))
        above = asked > 0.5 * run.rate_hz
        if above and abs(folded - seen) <= _FOLDED_HZ:
            yield Finding(
                'warning', 'folded',
                f'{run.source}: the sine of {asked:g} Hz is above half the rate of {run.sensor} '
                f'({0.5 * run.rate_hz:.4g} Hz) and shows at {seen:.4g} Hz.',
                'RR, SR and SNR are those of what the low-pass let through and folded back.',
                'Nothing, if that is what the test is about; otherwise a higher rate.',
            )  # fmt: skip
        else:
            yield Finding(
                'warning', 'other-frequency',
                f'{run.source}: the largest line of {run.sensor} is at {seen:.4g} Hz, the sine '
                f'of {run.identity.condition} at {asked:g} Hz.',
                'The SNR is that of another line.',
                'Check the condition and the rate; --set frequency= tells another sine.',
            )  # fmt: skip
