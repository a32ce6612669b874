# SPDX-License-Identifier: Apache-2.0
"""Rolling noise metrics of one stream of Imu messages; knows no ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from imu_bench.errors import DataError, NotReady
from imu_bench.metrology import coefficients
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.noise_fit import fitted
from imu_bench.metrology.rolling import RollingAnalysis, Window
from imu_bench.metrology.stamps import timing
from imu_bench.samples import AXES, IMU_QUANTITIES, Quantity
from msg_conversions.cdr import ImuBlock
import numpy as np
import numpy.typing as npt

METRICS = ('rms', 'noise_density', 'bias_instability')
"""What is published of each axis, in this order."""

STRETCH_S = 2.0
STRETCH_SAMPLES = 20
"""The sample rate is found from at least so much, at the start and again and again."""

HELD_MOST = 1 << 16
"""Samples held back at most while their stamps give no rate."""

OTHER_RATE = 0.1
"""A rate off by more than this share, twice in a row, is another rate."""


@dataclass(frozen=True)
class LiveResult:
    """
    The metrics of one window.

    Attributes
    ----------
    window : Window
        Which samples, and their curves.
    frame_id : str
    quantities : tuple of str
        Those the sensor reports, such as 'linear_acceleration'.
    curves : mapping of str to DeviationCurve or None
        By axis, such as 'linear_acceleration.x'; None for one that is not measured.
    metrics : mapping of str to (mapping of str to Estimate)
        By metric (`METRICS`) and axis.
    """

    window: Window
    frame_id: str
    quantities: tuple[str, ...]
    curves: Mapping[str, DeviationCurve | None]
    metrics: Mapping[str, Mapping[str, Estimate]]


@dataclass
class LiveAnalysis:
    """
    Takes blocks of decoded messages, keeps a sliding window, gives its metrics.

    Attributes
    ----------
    window_s, confidence : float
    received : int
        Samples taken.
    restarts : int
        How often the window was begun anew because the sensor changed its rate.
    rate_hz : float
        Sample rate the window was built for; 0 before that.
    reason : str
        Why there is no result yet.
    """

    window_s: float
    confidence: float = CONFIDENCE
    received: int = 0
    restarts: int = 0
    rate_hz: float = 0.0
    reason: str = 'no samples yet'
    frame_id: str = ''
    _held: list[ImuBlock] = field(default_factory=list)
    _stretch: list[npt.NDArray[np.int64]] = field(default_factory=list)
    _quantities: tuple[Quantity, ...] = ()
    _other_rates: int = 0
    _rolling: RollingAnalysis | None = None

    def add(self, block: ImuBlock) -> None:
        """Take the next messages of the stream."""
        if not len(block):
            return
        self.received += len(block)
        self.frame_id = block.frame_ids[-1]
        self._stretch.append(block.stamps)
        if self._rolling is None:
            self._held.append(block)
        else:
            self._append(self._rolling, block)
        stamps = np.concatenate(self._stretch)
        if stamps.size >= STRETCH_SAMPLES and stamps[-1] - stamps[0] >= STRETCH_S * 1e9:
            self._measure(stamps)
        elif stamps.size >= HELD_MOST:
            self.reason = f'the stamps of {stamps.size} samples do not advance by {STRETCH_S:g} s'
            self._held, self._stretch = [], []

    def result(self) -> LiveResult | None:
        """Return the metrics of the window as it is now; None while there is none."""
        if self._rolling is None:
            return None
        try:
            window = self._rolling.snapshot()
        except NotReady as error:
            self.reason = str(error)
            return None
        names = tuple(f'{each.name}.{axis}' for each in self._quantities for axis in AXES)
        metrics: dict[str, dict[str, Estimate]] = {metric: {} for metric in METRICS}
        for name, curve, rms in zip(names, window.curves, window.rms, strict=True):
            metrics['rms'][name] = rms
            metrics['noise_density'][name], metrics['bias_instability'][name] = self._noise(curve)
        return LiveResult(
            window,
            self.frame_id,
            tuple(quantity.name for quantity in self._quantities),
            dict(zip(names, window.curves, strict=True)),
            metrics,
        )

    def _noise(self, curve: DeviationCurve | None) -> tuple[Estimate, Estimate]:
        if curve is None:
            nothing = Estimate.not_observable(
                '1', 'not measured, or the window is too short yet', confidence=self.confidence
            )
            return nothing, nothing
        model = fitted(curve, self.confidence)
        return coefficients.noise_density(model, 'one'), model.B

    def _measure(self, stamps: npt.NDArray[np.int64]) -> None:
        """Find the rate of a stretch; begin the window with it, or anew if it is another."""
        self._stretch = []
        try:
            rate_hz = 1.0 / timing.analyse(stamps).period_s
        except DataError as error:
            self.reason, self._held = str(error), []
            return
        if self._rolling is None:
            self._begin(rate_hz)
            return
        self._other_rates += 1
        if abs(rate_hz - self.rate_hz) <= OTHER_RATE * self.rate_hz:
            self._other_rates = 0
        elif self._other_rates > 1:
            self.restarts += 1
            self._begin(rate_hz)

    def _begin(self, rate_hz: float) -> None:
        held, self._held = self._held, []
        if held:
            self._quantities = tuple(q for q in IMU_QUANTITIES if _measured(held, q))
        if not self._quantities:
            self.reason = 'no axis holds numbers'
            return
        self.rate_hz, self.reason, self._other_rates = rate_hz, '', 0
        units = tuple(quantity.unit for quantity in self._quantities for _ in AXES)
        self._rolling = RollingAnalysis(
            self.window_s, rate_hz, axes=len(units), units=units, confidence=self.confidence
        )
        for block in held:
            self._append(self._rolling, block)

    def _append(self, rolling: RollingAnalysis, block: ImuBlock) -> None:
        columns = [getattr(block, quantity.field) for quantity in self._quantities]
        rolling.append(block.stamps, columns[0] if len(columns) == 1 else np.hstack(columns))


def _measured(blocks: list[ImuBlock], quantity: Quantity) -> bool:
    """Return whether a quantity is reported, by the covariance (REP-145), and has a number."""
    return any(
        getattr(block, f'has_{quantity.field}')
        and np.isfinite(getattr(block, quantity.field)).any()
        for block in blocks
    )
