# SPDX-License-Identifier: Apache-2.0
"""Rolling noise metrics of one stream of samples; knows no ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from imu_bench.errors import DataError, NotReady
from imu_bench.metrology import coefficients
from imu_bench.metrology.curve import DeviationCurve
from imu_bench.metrology.estimate import CONFIDENCE, Estimate
from imu_bench.metrology.noise_fit import fitted
from imu_bench.metrology.rolling import RollingAnalysis, Window
from imu_bench.metrology.spikes import SpikeCount
from imu_bench.metrology.stamps import timing
from imu_bench.nodes.topic_names import METRICS
from imu_bench.samples import Samples
from msg_conversions.quantities import AXES, IMU_QUANTITIES, Quantity
import numpy as np
import numpy.typing as npt

STRETCH_S = 2.0
STRETCH_SAMPLES = 20
"""The sample rate is found from at least so much, at the start and again and again."""

HELD_MOST = 1 << 16
"""Samples held back at most while their stamps give no rate."""

OTHER_RATE = 0.1
"""A rate off by more than this share, twice in a row, is another rate."""

JUMP_NS = 1_000_000_000
"""Stamps further apart are counted as a jump, whether samples or the clock made it."""

REFRESH = 0.01
"""
Share of the window that has to be new before its metrics are worth computing again: by then an
estimate has changed by √(2 · 0.01), a seventh, of its own standard error.
"""


@dataclass(frozen=True)
class LiveResult:
    """The metrics of one window."""

    window: Window  # which samples, and their curves
    frame_id: str
    quantities: tuple[str, ...]  # those the sensor reports, such as 'linear_acceleration'
    # by axis, such as 'linear_acceleration.x'; None for one that is not measured
    curves: Mapping[str, DeviationCurve | None]
    metrics: Mapping[str, Mapping[str, Estimate]]  # by metric (`METRICS`) and axis
    # single samples in it far off their neighbours: they count in the metrics and raise the noise
    # density, while `imu-bench analyze`, which sees what follows, leaves them out of it
    outliers: int = 0


@dataclass
class LiveAnalysis:
    """Takes samples as they come, keeps a sliding window, gives its metrics."""

    window_s: float
    confidence: float = CONFIDENCE
    received: int = 0  # samples taken
    restarts: int = 0  # how often the window was begun anew because the sensor changed its rate
    rate_hz: float = 0.0  # sample rate the window was built for; 0 before that
    reason: str = 'no samples yet'  # why there is no result yet
    frame_id: str = ''
    zero_stamps: int = 0  # samples whose stamp nobody has set
    jumps: int = 0  # successive stamps apart by more than `JUMP_NS`, forwards or back
    _last_ns: int | None = None
    _held: list[Samples] = field(default_factory=list)
    _stretch: list[npt.NDArray[np.int64]] = field(default_factory=list)
    _quantities: tuple[Quantity, ...] = ()
    _other_rates: int = 0
    _rolling: RollingAnalysis | None = None
    _spikes: SpikeCount = field(default_factory=SpikeCount)

    def add(self, run: Samples, frame_id: str = '') -> None:
        """Take the next samples of the stream."""
        if not len(run):
            return
        self.received += len(run)
        self.frame_id = frame_id
        before = run.stamps[0] if self._last_ns is None else self._last_ns
        steps = np.diff(run.stamps, prepend=before)
        self.jumps += int(np.count_nonzero(np.abs(steps) > JUMP_NS))
        self.zero_stamps += int(np.count_nonzero(run.stamps == 0))
        self._last_ns = int(run.stamps[-1])
        self._stretch.append(run.stamps)
        if self._rolling is None:
            self._held.append(run)
        else:
            self._append(self._rolling, run)
        stamps = np.concatenate(self._stretch)
        if stamps.size >= STRETCH_SAMPLES and stamps[-1] - stamps[0] >= STRETCH_S * 1e9:
            self._measure(stamps)
        elif stamps.size >= HELD_MOST:
            self.reason = f'the stamps of {stamps.size} samples do not advance by {STRETCH_S:g} s'
            self._held, self._stretch = [], []

    def reset(self) -> None:
        """Empty the window; counts go on."""
        self._rolling = None
        self._held, self._stretch = [], []
        self._spikes = SpikeCount()
        self.rate_hz, self.reason, self._other_rates = 0.0, 'no samples since it was reset', 0

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
            self._spikes.since(window.start_ns),
        )

    @property
    def refresh_s(self) -> float:
        """Seconds in which the window changes by as much as is worth a result; 0 at first."""
        return 0.0 if self._rolling is None else REFRESH * self._rolling.span_s

    def _noise(self, curve: DeviationCurve | None) -> tuple[Estimate, Estimate]:
        if curve is None:
            nothing = Estimate.not_observable(
                '1', 'not measured, or the window is too short yet', confidence=self.confidence
            )
            return nothing, nothing
        model = fitted(curve, self.confidence, 'NB')
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
        self._spikes = SpikeCount()
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
        for run in held:
            self._append(self._rolling, run)

    def _append(self, rolling: RollingAnalysis, run: Samples) -> None:
        absent = np.full((len(run), len(AXES)), np.nan)
        columns = [getattr(run, quantity.field) for quantity in self._quantities]
        rows = np.hstack([absent if column is None else column for column in columns])
        rolling.append(run.stamps, rows)
        self._spikes.add(run.stamps, rows)


def _measured(runs: list[Samples], quantity: Quantity) -> bool:
    """Return whether a quantity is reported and has a number."""
    columns = [getattr(run, quantity.field) for run in runs]
    return any(column is not None and np.isfinite(column).any() for column in columns)
