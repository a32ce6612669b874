# SPDX-License-Identifier: Apache-2.0
"""The sampling core of a simulated chip: samples at its own rate, when its time has come."""

from __future__ import annotations

from imu_bench.errors import ConfigError
from imu_bench.samples import Samples
from imu_bench.simulation.clock import START_NS
from imu_bench.simulation.scenario import Motion
from imu_bench.simulation.sensor_model import ErrorModel
import numpy as np
import numpy.typing as npt

BLOCK_S = 0.25
"""Samples are made this far ahead at most: the cost of a call does not fall on every sample."""


class SensorSource:
    """
    What a chip samples, in SI units, at its own output data rate.

    An emulator asks for everything that came about since it asked last, and
    quantises it into registers, FIFO or frames.  The chip's oscillator is not
    the host's: the true rate differs from the nominal one.

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
    >>> from imu_bench.simulation.scenario import Still
    >>> from imu_bench.simulation.sensor_model import Errors
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
        self._motion = motion
        self._model = model
        self._rate_error = rate_error
        self._origin_ns = int(start_ns)
        self.nominal_hz = nominal_hz
        self.restart(start_ns, nominal_hz)

    @property
    def rate_hz(self) -> float:
        """True output data rate."""
        return self.nominal_hz * (1.0 + self._rate_error)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities of the samples."""
        return self._model.quantities

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
        self._anchor_ns = int(t_ns)
        self._made = 0
        self._ahead = self._make(0)

    def samples_until(self, t_ns: int) -> Samples:
        """Return every sample made after those handed out already, up to and including `t_ns`."""
        parts = []
        while True:
            due = int(np.searchsorted(self._ahead.stamps, t_ns, side='right'))
            parts.append(self._ahead[:due])
            self._ahead = self._ahead[due:]
            if len(self._ahead) or self._stamps(self._made + 1, 1)[0] > t_ns:
                break
            self._ahead = self._make(max(1, round(BLOCK_S * self.rate_hz)))
        return parts[0] if len(parts) == 1 else Samples.concatenate(parts)

    def _stamps(self, first: int, n: int) -> npt.NDArray[np.int64]:
        """Return the times of samples number `first` and on since the restart, ns."""
        elapsed = np.arange(first, first + n) * (1e9 / self.rate_hz)
        return np.asarray(self._anchor_ns + np.rint(elapsed).astype(np.int64))

    def _make(self, n: int) -> Samples:
        stamps = self._stamps(self._made + 1, n)
        self._made += n
        t = np.asarray((stamps - self._origin_ns) * 1e-9, dtype=np.float64)
        truths = {
            'acceleration': self._motion.specific_force,
            'angular_velocity': self._motion.angular_velocity,
            'magnetic_field': self._motion.magnetic_field,
            'temperature': self._motion.temperature,
        }
        values = self._model.sample(
            {quantity: truths[quantity](t) for quantity in self.quantities}, 1.0 / self.rate_hz
        )
        return Samples(stamps=stamps, **values)
