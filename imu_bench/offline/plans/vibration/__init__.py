# SPDX-License-Identifier: Apache-2.0
"""
Vibration in time and frequency: Shabulinzenze 2020 (Tampere University MSc thesis), section 5.2.

Levels, speed and way of a ride, tones with their orders, spectrograms, and every sensor against
a reference, for any sensors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from imu_bench.config.schema import Setting
from imu_bench.errors import RecordingError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.comparing.sensors import labels
from imu_bench.offline.health import Finding
from imu_bench.offline.notation import duration, short, text
from imu_bench.offline.plans.plan import Plan
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.plans.vibration import bearing, measuring, presenting
from imu_bench.offline.plans.vibration.comparing import Against, against, origins
from imu_bench.offline.plans.vibration.measuring import AxisVibration, SensorVibration
from imu_bench.offline.plans.vibration.presenting import Found
from imu_bench.offline.recordings import Recording
from imu_bench.units import STANDARD_GRAVITY

_MISSING = 0.01
"""
Share of samples: straight lines in their place turn the sign of a tone at half the rate, which
comes out 2 % too weak.
"""

_SCALE = 0.02
"""Error of gravity that is told: a ride of 7 m comes out wrong by 14 cm."""

_HZ: tuple[Any, ...] = ((), (1e-3, 1e6), 'Hz', 'quantity')
_S: tuple[Any, ...] = ((), (0.0, 1e9), 's', 'quantity')


class Vibration(Plan[tuple[SensorVibration, ...]]):
    """Vibration of a machine or a lift, as in the thesis."""

    name = 'vibration'
    title = 'Vibration'
    document = (
        'Shabulinzenze, Comparison of MEMS sensors in machine vibration monitoring, MSc thesis, '
        'Tampere University 2020, sections 4.4 and 5.2'
    )
    SETTINGS = (
        Setting('high_pass', (2.0,), 'Slower motion is taken out (thesis: 2 Hz).', *_HZ),
        Setting('low_pass', (50.0,), 'Faster motion is taken out (thesis: 50 Hz).', *_HZ),
        Setting(
            'moving_average', 1, 'Samples averaged before the filters (thesis: 10).',
            bounds=(1, 10_000),
        ),
        Setting('resolution', (0.5,), 'Distance of the bins of spectra.', *_HZ),
        Setting('spectrogram', (1.0,), 'Distance of the bins of spectrograms.', *_HZ),
        Setting('cylinders', 0, 'Cylinders of a four-stroke engine; 0 for none.', bounds=(0, 64)),
        Setting('begin', None, 'Analyse from here on, since the first sample.', *_S),
        Setting('end', None, 'Analyse up to here, since the first sample.', *_S),
        *bearing.SETTINGS,
        Setting('max_offset', (0.05,), 'Largest time offset within a recording.', *_S),
    )  # fmt: skip

    def __init__(self, settings: Mapping[str, str] | None = None, **others: Any) -> None:
        super().__init__(settings, **others)
        bearing.band(self.settings)
        bearing.expected(self.settings)

    def measure(self, source: str, recordings: Sequence[Recording]) -> tuple[SensorVibration, ...]:
        """Return every accelerometer of a recording."""
        return measuring.measure(
            source, recordings, self.settings, self.confidence, traces=bool(self.reference)
        )

    def conclude(self, measured: Sequence[tuple[SensorVibration, ...]]) -> PlanResult:
        """Return levels, ride, tones and the comparison of all sensors."""
        every = list(measuring.sensors(measured))
        sensors = dict(zip(labels(every), every, strict=True))
        compared: list[Against] = []
        if self.reference:
            compared = against(sensors, self.reference, self.settings, self.confidence)
            if not compared:
                raise RecordingError(
                    f'--reference {self.reference}: no other sensor has an axis of it'
                )
        found = Found(sensors, compared, self.reference, self.settings)
        if self.settings['envelope'] and not found.envelopes:
            low, high = bearing.band(self.settings) or (0.0, 0.0)
            raise RecordingError(
                f'--set envelope: no sensor is fast enough for {low:g} to {high:g} Hz'
            )
        return PlanResult(
            self.name,
            self.title,
            tuple(_summary(found)),
            tuple(presenting.tables(found)),
            (*presenting.figures(found), *bearing.figures(found.envelopes)),
            tuple(_findings(found)),
            {label: _values(found, label) for label in sensors},
        )


def _summary(found: Found) -> Iterator[str]:
    rides = [(label, s.ride) for label, s in found.sensors.items() if s.ride is not None]
    if rides:
        label, ride = next((r for r in rides if r[0] == found.reference), rides[0])
        yield (
            f'A ride of {text(ride.travel)} at up to {text(ride.peak_velocity)} and '
            f'{text(ride.smooth_acceleration)} ({label}); with its vibration a single reading '
            f'reaches {short(ride.peak_acceleration)} m/s².'
        )
    label = found.reference or max(
        found.sensors, key=lambda name: found.sensors[name].strongest.band.rms.value or 0.0
    )
    axis = found.sensors[label].strongest
    where = presenting.band(found.sensors[label], found.settings)
    yield f'Vibration {where}: {text(axis.band.rms)} RMS on {label} {axis.letter}.'
    groups = found.families(label, axis)
    if groups:
        family = groups[0]
        crank = found.crank(label, axis)
        speed = '' if crank is None else f': the engine runs at {text(crank.to("rpm"))}'
        yield (
            f'Strongest tone {text(family.strongest.frequency)}, with {len(family.members) - 1} '
            f'more at multiples of {text(family.fundamental)}{speed}.'
        )
    elif axis.tones:
        tone = axis.tones[0]
        yield f'Strongest tone {text(tone.frequency)}, {text(tone.amplitude)}.'
    else:
        yield f'No tone stands out of {label} {axis.letter}.'
    yield from bearing.sentences(found.envelopes, found.faults)
    yield from _compared(found)


def _compared(found: Found) -> Iterator[str]:
    judged = [
        (abs((one.gains[0][1].value or 1.0) - 1.0), one)
        for one in found.against
        if one.gains and one.gains[0][1].value is not None
    ]
    if judged:
        _, worst = max(judged, key=lambda item: item[0])
        tone, gain = worst.gains[0]
        yield (
            f'Against {found.reference}, {worst.label} {worst.letter} is furthest off at '
            f'{tone.frequency.value or 0.0:.4g} Hz: it shows {text(gain)} times the amplitude.'
        )


def _findings(found: Found) -> Iterator[Finding]:
    for label, sensor in found.sensors.items():
        if sensor.cut:
            yield Finding(
                'warning', 'cut',
                f'{label}: only the first {duration(sensor.length_s)} were analysed.',
                'What comes later is not in the result.',
                'Choose the part with --set begin= and --set end=.',
            )  # fmt: skip
        if sensor.missing > _MISSING:
            yield Finding(
                'warning', 'gaps', f'{label}: {100.0 * sensor.missing:.2g} % of its samples are '
                'missing.', 'Straight lines take their place; high frequencies come out too weak.',
                'See the health check of imu-bench analyze.',
            )  # fmt: skip
        if sensor.low_pass is None:
            yield Finding(
                'info', 'no-low-pass',
                f'{label}: no low-pass at {found.settings["low_pass"][0]:g} Hz, its rate is '
                f'{sensor.rate_hz:.4g} Hz.',
                'Its levels hold all up to half its rate.',
                'Compare it with a lower --set low_pass=.',
            )  # fmt: skip
        off = sensor.gravity / STANDARD_GRAVITY - 1.0
        if sensor.ride is not None and abs(off) > _SCALE:
            yield Finding(
                'warning', 'scale',
                f'{label} shows {sensor.gravity:.4g} m/s² of gravity, {100.0 * off:+.1f} %.',
                'If that is an error of its scale, speed and way are off by as much.',
                'Calibrate it in six positions: --plan six-position.',
            )  # fmt: skip
        yield from _folded(found, label, sensor)
    if not found.reference and len(found.sensors) > 1:
        yield Finding(
            'info', 'no-reference', 'No reference was named.',
            'Sensors are not compared with each other.', 'Name one with --reference.',
        )  # fmt: skip


def _folded(found: Found, label: str, sensor: SensorVibration) -> Iterator[Finding]:
    # the axes of a sensor show the same tone a little apart
    there = {
        f'{true:.3g} Hz': f'{tone.frequency.value or 0.0:.2g} Hz'
        for tone, _, true in origins(sensor, found.reference_tones, found.tolerance_hz)
    }
    if there:
        named = sorted(there.items(), key=lambda item: float(item[0].split()[0]))
        yield Finding(
            'warning', 'folded',
            f'{label} shows tones folded at its rate of {sensor.rate_hz:.4g} Hz: '
            f'{", ".join(f"{true} at {seen}" for true, seen in named)}.',
            'They look like vibration that is not there.', 'Sample faster, or filter lower.',
        )  # fmt: skip


def _values(found: Found, label: str) -> dict[str, Any]:
    """Return what was measured of one sensor, for programs."""
    sensor = found.sensors[label]
    ride = sensor.ride
    document: dict[str, Any] = {
        'source': sensor.source,
        'topic': sensor.topic,
        'rate_hz': sensor.rate_hz,
        'axes': {axis.letter: _axis(found, label, axis) for axis in sensor.axes},
    }
    if ride is not None:
        names = ('peak_acceleration', 'smooth_acceleration', 'peak_velocity', 'travel', 'closing')
        document['ride'] = {name: getattr(ride, name).to_json() for name in names}
    compared = [one for one in found.against if one.label == label]
    if compared:
        document['against'] = {
            one.letter: {
                'reference': found.reference,
                'offset': None if one.response is None else one.response.offset.to_json(),
                'rms_ratio': one.ratio.to_json(),
                'gains': [
                    {'frequency': tone.frequency.to_json(), 'gain': gain.to_json()}
                    for tone, gain in one.gains
                ],
            }
            for one in compared
        }
    return document


def _axis(found: Found, label: str, axis: AxisVibration) -> dict[str, Any]:
    crank = found.crank(label, axis)

    def json(levels: Any) -> dict[str, Any]:
        names = ('peak', 'peak_to_peak', 'rms', 'crest_factor')
        estimates: list[tuple[str, Estimate]] = [(name, getattr(levels, name)) for name in names]
        return {name: estimate.to_json() for name, estimate in estimates}

    return {
        'total': json(axis.total),
        'band': json(axis.band),
        'velocity': json(axis.velocity),
        'displacement': json(axis.displacement),
        'snr': {'before': axis.snr[0].to_json(), 'after': axis.snr[1].to_json()},
        'tones': [
            {
                'frequency': tone.frequency.to_json(),
                'amplitude': tone.amplitude.to_json(),
                'steady': tone.steady,
            }
            for tone in axis.tones
        ],
        'families': [
            {
                'fundamental': family.fundamental.to_json(),
                'harmonics': [order for order, _ in family.members],
            }
            for family in found.families(label, axis)
        ],
        'crank': None if crank is None else crank.to_json(),
        'envelope': bearing.document(
            axis.envelope,
            [fault for name, fault in found.faults if name == f'{label} {axis.letter}'],
        ),
    }
