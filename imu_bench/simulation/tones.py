# SPDX-License-Identifier: Apache-2.0
"""Periodic motion: sine, sweep, steps, an engine at idle, and the hum of the mains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from imu_bench.errors import ConfigError
from imu_bench.simulation.motion import along, Band, NOTHING, Part, Seed
from imu_bench.simulation.sensor_errors import Array
import numpy as np


@dataclass(frozen=True)
class Sine(Part):
    """A sinusoidal acceleration along one axis."""

    amplitude: float  # peak, m/s²
    frequency_hz: float  # may lie above the Nyquist frequency of a sensor
    axis: str = 'z'  # 'x', 'y' or 'z'
    phase: float = 0.0  # at the beginning, rad

    def __post_init__(self) -> None:
        along(self.axis)

    @property
    def bands(self) -> Sequence[Band]:
        """One frequency."""
        return (Band('sine', self.frequency_hz, self.frequency_hz),)

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3)."""
        wave = self.amplitude * np.sin(2.0 * np.pi * self.frequency_hz * t + self.phase)
        return np.asarray(np.multiply.outer(wave, along(self.axis)))


@dataclass(frozen=True)
class Sweep(Part):
    """A sine whose frequency rises and falls by octaves per minute (IEC 60068-2-6)."""

    amplitude: float  # peak, m/s², the same at every frequency
    # low_hz, high_hz: it begins at the low end
    low_hz: float
    high_hz: float
    octaves_per_s: float  # octaves per second
    axis: str = 'z'
    returns: bool = True  # whether it sweeps down again; otherwise it begins anew at the low end

    def __post_init__(self) -> None:
        along(self.axis)
        if not 0.0 < self.low_hz < self.high_hz or not self.octaves_per_s > 0.0:
            raise ConfigError(
                f'sweep: {self.low_hz:g} Hz to {self.high_hz:g} Hz at '
                f'{60.0 * self.octaves_per_s:g} oct/min is none; low must be below high, and '
                'the rate above zero'
            )

    @property
    def bands(self) -> Sequence[Band]:
        """Everything that is swept."""
        return (Band('sweep', self.low_hz, self.high_hz),)

    @property
    def one_way_s(self) -> float:
        """Time from one end to the other."""
        return math.log2(self.high_hz / self.low_hz) / self.octaves_per_s

    def frequency(self, t: Array) -> Array:
        """Return the frequency at each time, Hz."""
        since, _, _ = self._since_low_end(t)
        return np.asarray(self.low_hz * np.exp2(self.octaves_per_s * since))

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3)."""
        since, falling, passes = self._since_low_end(t)
        growth = self.octaves_per_s * math.log(2.0)
        cycles = self.low_hz * np.expm1(growth * since) / growth
        one_way = (self.high_hz - self.low_hz) / growth
        # a way down runs through the cycles of the way up, backwards
        total = passes * one_way + np.where(falling, one_way - cycles, cycles)
        wave = self.amplitude * np.sin(2.0 * np.pi * total)
        return np.asarray(np.multiply.outer(wave, along(self.axis)))

    def _since_low_end(self, t: Array) -> tuple[Array, Array, Array]:
        """Return the time from the low end, whether the frequency falls, and ways completed."""
        passes = np.floor(t / self.one_way_s)
        within = t - passes * self.one_way_s
        falling = (passes % 2 == 1) & self.returns
        return np.where(falling, self.one_way_s - within, within), falling, passes


@dataclass(frozen=True)
class SteppedSine(Part):
    """A sine whose frequency is held, then rises by a step, up to the highest."""

    amplitude: float  # peak, m/s², the same at every frequency
    # low_hz, high_hz, step_hz: the first frequency, the one that none is above, and what lies
    # between two
    low_hz: float
    high_hz: float
    step_hz: float
    hold_s: float  # how long each is held
    axis: str = 'z'

    def __post_init__(self) -> None:
        along(self.axis)
        if not 0.0 < self.low_hz < self.high_hz or not min(self.step_hz, self.hold_s) > 0.0:
            raise ConfigError(
                f'stepped_sine: {self.low_hz:g} Hz to {self.high_hz:g} Hz in steps of '
                f'{self.step_hz:g} Hz, {self.hold_s:g} s each, is none; low must be below high, '
                'and step and hold above zero'
            )

    @property
    def bands(self) -> Sequence[Band]:
        """Everything between the ends."""
        return (Band('stepped_sine', self.low_hz, self.high_hz),)

    def _step(self, t: Array) -> Array:
        last = math.floor((self.high_hz - self.low_hz) / self.step_hz * (1.0 + 1e-12))
        return np.asarray(np.clip(np.floor(t / self.hold_s), 0, last))

    def frequency(self, t: Array) -> Array:
        """Return the frequency at each time, Hz."""
        return np.asarray(self.low_hz + self.step_hz * self._step(t))

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3); its phase goes on from step to step."""
        k = self._step(t)
        before = self.hold_s * (k * self.low_hz + self.step_hz * k * (k - 1.0) / 2.0)
        cycles = before + (self.low_hz + self.step_hz * k) * (t - k * self.hold_s)
        wave = self.amplitude * np.sin(2.0 * np.pi * cycles)
        return np.asarray(np.multiply.outer(wave, along(self.axis)))


@dataclass(frozen=True)
class Tones(Part):
    """Tones of different strength along the axes."""

    name: str  # what makes them, for texts
    frequencies_hz: tuple[float, ...]
    forces: tuple[tuple[float, float, float], ...]  # per tone the peak along x, y and z, m/s²
    # per tone the peak angular velocity about x, y and z, rad/s; empty for none
    rates: tuple[tuple[float, float, float], ...] = ()
    phases: tuple[float, ...] = ()  # per tone, rad
    wander: float = 0.0  # relative peak change of all frequencies
    wander_period_s: float = 10.0  # how long one such change takes

    @property
    def bands(self) -> Sequence[Band]:
        """From the lowest to the highest tone."""
        return (Band(self.name, min(self.frequencies_hz), max(self.frequencies_hz)),)

    @property
    def events(self) -> Sequence[dict[str, Any]]:
        """Every tone."""
        return [
            {
                'tone': self.name,
                'frequency': {'value': frequency, 'unit': 'Hz'},
                'amplitude': {'value': list(force), 'unit': 'm/s²'},
                'rate_amplitude': {'value': list(rate), 'unit': 'rad/s'},
            }
            for frequency, force, rate in zip(
                self.frequencies_hz, self.forces, self.rates or self._none, strict=True
            )
        ]

    @property
    def _none(self) -> tuple[tuple[float, float, float], ...]:
        return ((0.0, 0.0, 0.0),) * len(self.frequencies_hz)

    def specific_force(self, t: Array) -> Array:
        """Return m/s², shape (n, 3)."""
        return self._sum(t, self.forces)

    def angular_velocity(self, t: Array) -> Array:
        """Return rad/s, shape (n, 3)."""
        return self._sum(t, self.rates) if self.rates else NOTHING

    def _sum(self, t: Array, amplitudes: tuple[tuple[float, float, float], ...]) -> Array:
        # time as the wandering clock of the machine counts it
        own = t
        if self.wander:
            turn = 2.0 * np.pi / self.wander_period_s
            own = t + self.wander / turn * (1.0 - np.cos(turn * t))
        total = np.zeros((t.size, 3))
        phases = self.phases or (0.0,) * len(self.frequencies_hz)
        for frequency, amplitude, phase in zip(
            self.frequencies_hz, amplitudes, phases, strict=True
        ):
            if any(amplitude):
                wave = np.sin(2.0 * np.pi * frequency * own + phase)
                total += np.multiply.outer(wave, amplitude)
        return total


def engine(
    speed_hz: float,
    cylinders: int,
    firing: Sequence[float],
    valves: Sequence[float],
    *,
    unbalance: float = 0.0,
    decay: float = 0.5,
    harmonics: int = 8,
    rocking: float = 0.0,
    wander: float = 0.0,
    wander_period_s: float = 10.0,
    seed: Seed = 0,
) -> Tones:
    """
    Return the periodic part of a four-stroke engine's vibration.

    Half of the cylinders fire in each turn of the crank shaft, so that the firing frequency is
    cylinders/2 times the speed: 26.67 Hz for four cylinders at 800 rpm.  Its second
    harmonic, 53.33 Hz, is that of the valves (Shabulinzenze 2020, section 4.4.4).

    Parameters
    ----------
    speed_hz : float
        Turns of the crank shaft per second.
    firing, valves : sequence of float
        Peaks at the firing frequency and at its double along x, y and z, m/s².
    unbalance : float
        Peak at the speed itself in relation to `firing`.
    decay : float
        Peak of each higher harmonic of the firing frequency in relation to the one before.
    harmonics : int
        Number of harmonics of the firing frequency.
    rocking : float
        Peak angular velocity about x at the firing frequency, rad/s.
    wander, wander_period_s : float
        Relative peak change of the speed, and its period.
    seed : int or tuple of int
        Of the phases.
    """
    firing_hz = speed_hz * cylinders / 2.0
    first, second = np.asarray(firing, dtype=float), np.asarray(valves, dtype=float)
    peaks = [first, second, *(second * decay**k for k in range(1, harmonics - 1))][:harmonics]
    frequencies = [firing_hz * (k + 1) for k in range(len(peaks))]
    rates = [np.array([rocking, 0.0, 0.0]), *([np.zeros(3)] * (len(peaks) - 1))]
    if unbalance:
        frequencies.insert(0, speed_hz)
        peaks.insert(0, first * unbalance)
        rates.insert(0, np.zeros(3))
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(peaks))
    return Tones(
        'engine',
        tuple(frequencies),
        tuple(_three(peak) for peak in peaks),
        tuple(_three(rate) for rate in rates) if rocking else (),
        tuple(phases.tolist()),
        wander,
        wander_period_s,
    )


def mains_hum(frequency_hz: float, amplitude: Sequence[float], third: float) -> Tones:
    """Return the hum of the mains: its frequency and, in relation, its third harmonic."""
    peak = np.asarray(amplitude, dtype=float)
    peaks = [peak, third * peak] if third else [peak]
    frequencies = (frequency_hz, 3.0 * frequency_hz)[: len(peaks)]
    return Tones('mains hum', frequencies, tuple(_three(one) for one in peaks))


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
