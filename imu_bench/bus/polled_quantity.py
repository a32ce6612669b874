# SPDX-License-Identifier: Apache-2.0
"""A quantity that is polled because no FIFO holds it."""

from __future__ import annotations

from imu_bench.bus.interface import Clock
from imu_bench.samples import Samples
import numpy as np
import numpy.typing as npt

OVERDUE_PERIODS = 1.5
SILENCE_S = 0.25
SILENCE_PERIODS = 10.0


class PolledQuantity:
    """
    Stamps, losses and silence of such a quantity.

    Parameters
    ----------
    rate_hz : float
        Nominal; 0 if it is switched off.

    Examples
    --------
    >>> from imu_bench.bus.clock import SystemClock
    >>> field = PolledQuantity(SystemClock(), 10.0)
    >>> field.begin()
    >>> field.pass_by(), len(field.found()), field.lost
    ([], 1, 0)
    """

    def __init__(self, clock: Clock, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.lost = 0  # samples that came and went between two looks
        self._clock = clock
        self._looked_ns = self._heard_ns = 0
        self._fresh = True

    def begin(self) -> None:
        """Start to wait for samples; what was overwritten before is not a loss."""
        self._looked_ns = self._heard_ns = self._clock.now_ns()
        self._fresh = True

    def pass_by(self) -> list[Samples]:
        """Take note that nothing was there; return that."""
        self._looked_ns = self._clock.now_ns()
        return []

    def found(self, overrun: bool = False) -> npt.NDArray[np.int64]:
        """
        Take note that a sample was there; return its stamp, shape (1,).

        It was ready some time between the last look and this one, so half way is stamped.

        Parameters
        ----------
        overrun : bool
            The chip says that another one was overwritten.
        """
        last, now = self._looked_ns, self._clock.now_ns()
        self._looked_ns = self._heard_ns = now
        made = int((now - last) * 1e-9 * self.rate_hz)
        self.lost += max(made - 1, int(overrun and not self._fresh))
        self._fresh = False
        return np.array([(last + now) // 2])

    def heard(self) -> None:
        """Take note that samples came by another way, with stamps of their own."""
        self._looked_ns = self._heard_ns = self._clock.now_ns()

    @property
    def overdue(self) -> bool:
        """Whether the next sample must have been made, whatever the chip's flags say."""
        return (self._clock.now_ns() - self._heard_ns) * 1e-9 * self.rate_hz > OVERDUE_PERIODS

    @property
    def silent(self) -> bool:
        """Whether nothing came for so long that the settings may be lost; once per silence."""
        patience_s = max(SILENCE_S, SILENCE_PERIODS / self.rate_hz)
        now = self._clock.now_ns()
        if now - self._heard_ns <= patience_s * 1e9:
            return False
        self._heard_ns = now  # asks again after as long
        return True
