# SPDX-License-Identifier: Apache-2.0
"""The sampling core of a simulated chip: samples at its own rate, when its time has come."""

from __future__ import annotations

import math

from imu_bench.errors import ConfigError
from imu_bench.samples import Samples
from imu_bench.simulation.clock import START_NS
from imu_bench.simulation.motion import highest_hz, Motion
from imu_bench.simulation.sensor_errors import Array
from imu_bench.simulation.sensor_model import ErrorModel
import numpy as np
import numpy.typing as npt

BLOCK_S = 0.25
"""Samples are made this far ahead: the cost of a call does not fall on every sample."""

LARGEST_BLOCK = 1 << 13
"""Samples that are made at once when many are due: they stay in the processor's cache."""

POINTS = 5.0
PASSED_POINTS = 10.0
"""Points per period of the highest frequency at which a sensor's low-pass is computed, and of the
highest one that it lets pass: up to twice its corner.  The bilinear transform takes 2 % (first
order) or 5 % (second) too much at ten points, 13 % or 25 % at five, where little is left."""


class SensorSource:
    """
    What a chip samples, in SI units, at its own output data rate.

    An emulator asks for everything that came about since it asked last, and
    quantises it into registers, FIFO or frames.  The chip's oscillator is not
    the host's: the true rate differs from the nominal one.

    A sensor with a low-pass of its own sees the motion at a multiple of its rate, so that
    frequencies above half its rate pass the filter first and fold back afterwards.

    Parameters
    ----------
    motion : Motion
        The truth.
    model : ErrorModel
        What the sensor makes of it; decides which quantities there are.
    nominal_hz : float
        Output data rate as configured.
    rate_error : float
        Relative error of the chip's oscillator: 120e-6 runs 120 ppm fast.
    start_ns : int
        When the scenario begins and sampling starts; the first sample comes
        one period later.

    Examples
    --------
    >>> from imu_bench.simulation.motion import Still
    >>> from imu_bench.simulation.sensor_errors import Errors
    >>> model = ErrorModel({'acceleration': Errors()})
    >>> source = SensorSource(Still(), model, 100.0, start_ns=0)
    >>> source.samples_until(25_000_000).stamps
    array([10000000, 20000000])
    >>> len(source.samples_until(29_000_000)), len(source.samples_until(30_000_000))
    (0, 1)
    """

    def __init__(
        self,
        motion: Motion,
        model: ErrorModel,
        nominal_hz: float,
        *,
        rate_error: float = 0.0,
        start_ns: int = START_NS,
    ) -> None:
        self.motion = motion
        self.model = model
        self._rate_error = rate_error
        self._origin_ns = int(start_ns)
        self._highest_hz = highest_hz(motion)
        self.nominal_hz = nominal_hz
        self.restart(start_ns, nominal_hz)

    @property
    def rate_hz(self) -> float:
        """True output data rate."""
        return self.nominal_hz * (1.0 + self._rate_error)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities of the samples."""
        return self.model.quantities

    def at_start(self) -> dict[str, Array]:
        """Return per quantity what each axis shows when it all begins, but for the noise."""
        first = self._truth(np.zeros(1))
        return {quantity: row[0] for quantity, row in self.model.ideal(first).items()}

    def restart(self, t_ns: int, nominal_hz: float | None = None) -> None:
        """
        Begin to sample anew: the chip woke up, was reset, or changes its rate.

        Nothing is made between the last sample handed out and `t_ns`; the next
        one comes one period after `t_ns`.  The noise goes on from its state.

        Raises
        ------
        ConfigError
            If the rate is not positive.
        """
        if nominal_hz is not None:
            self.nominal_hz = nominal_hz
        if not self.rate_hz > 0:
            raise ConfigError(f'a sensor cannot sample at {self.rate_hz:g} Hz')
        passed = min(self._highest_hz, 2.0 * self.model.corner_hz)
        inside_hz = max(POINTS * self._highest_hz, PASSED_POINTS * passed)
        self._oversampling = math.ceil(inside_hz / self.rate_hz) if passed else 1
        self._anchor_ns = int(t_ns)
        self._made = 0
        self._ahead = self._nothing = self._make(0)
        self._expect()

    def samples_until(self, t_ns: int) -> Samples:
        """Return every sample made after those handed out already, up to and including `t_ns`."""
        if t_ns < self._next_ns:
            return self._nothing
        parts = []
        while True:
            due = int(np.searchsorted(self._ahead.stamps, t_ns, side='right'))
            parts.append(self._ahead[:due])
            self._ahead = self._ahead[due:]
            waiting = self._waiting(t_ns)
            if len(self._ahead) or not waiting:
                break
            ahead = max(1, round(BLOCK_S * self.rate_hz))
            largest = max(ahead, LARGEST_BLOCK // self._oversampling)
            self._ahead = self._make(min(max(ahead, waiting), largest))
        self._expect()
        return parts[0] if len(parts) == 1 else Samples.concatenate(parts)

    def samples_ahead(self, t_ns: int) -> Samples:
        """Return what `samples_until` does, and behind it what was made ahead with that."""
        due = self.samples_until(t_ns)
        if not len(due) or not len(self._ahead):
            return due
        rest, self._ahead = self._ahead, self._nothing
        self._expect()
        return Samples.concatenate([due, rest])

    def _expect(self) -> None:
        """Take note of when the next sample that was not handed out is due."""
        next_ = self._made - len(self._ahead) + 1
        self._next_ns = int(self._stamps(next_, 1)[0])

    def _waiting(self, t_ns: int) -> int:
        """Return how many samples are due at a time and not made yet."""
        guess = math.ceil((t_ns - self._anchor_ns) * 1e-9 * self.rate_hz) + 1 - self._made
        # what rounds to the same nanosecond is due
        while guess > 0 and self._stamps(self._made + guess, 1)[0] > t_ns:
            guess -= 1
        return max(guess, 0)

    def _stamps(self, first: int, n: int) -> npt.NDArray[np.int64]:
        """Return the times of samples number `first` and on since the restart, ns."""
        elapsed = np.arange(first, first + n) * (1e9 / self.rate_hz)
        return np.asarray(self._anchor_ns + np.rint(elapsed).astype(np.int64))

    def _make(self, n: int) -> Samples:
        first, fold = self._made + 1, self._oversampling
        self._made += n
        # every fold-th of these is a sample, the last one of all included
        points = np.arange((first - 1) * fold + 1, (first - 1 + n) * fold + 1)
        t = (self._anchor_ns - self._origin_ns) * 1e-9 + points / (fold * self.rate_hz)
        values = self.model.sample(
            self._truth(t),
            n,
            1.0 / self.rate_hz,
            oversampling=fold,
            moves=self._highest_hz > 0.0,
        )
        return Samples(stamps=self._stamps(first, n), **values)

    def _truth(self, t: Array) -> dict[str, Array]:
        """Return what moves the sensor: force and temperature disturb every quantity."""
        motion = self.motion
        truth = {
            'acceleration': motion.specific_force(t),
            'temperature': motion.temperature(t),
        }
        if 'angular_velocity' in self.quantities:
            truth['angular_velocity'] = motion.angular_velocity(t)
        if 'magnetic_field' in self.quantities:
            truth['magnetic_field'] = motion.magnetic_field(t)
        return truth
